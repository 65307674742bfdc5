"""Runs and estimates as a notebook shows them: a few lines of HTML without scripts, in the notebook's colours."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from service.analysis.wording import level, one_in, quantity, significant, told, treatment

if TYPE_CHECKING:
    from service.analysis.comparison.objects import Comparison
    from service.analysis.estimated import Estimated

CELL = 'style="text-align:left;padding:2px 12px 2px 0;vertical-align:top"'


def estimate_html(estimate: "Estimated") -> str:
    """One estimate: the question, p with its interval, the rollouts, and every warning with its remedy."""
    return estimates_html([estimate])


def estimates_html(estimates: Sequence["Estimated"], title: str = "") -> str:
    """Estimates beside each other, a column each."""
    first = estimates[0]
    about = f"{first.scenario}, ego {first.ego}"
    heads = [e.job for e in estimates] if len(estimates) > 1 else ["p of a rollout"]
    rows = [
        ("event", [f"f ≤ {quantity(e.gamma, e.unit)}" for e in estimates]),
        ("p", [p_html(e) for e in estimates]),
        (f"{level(first.confidence)} interval", [interval(e) for e in estimates]),
        ("method, seed", [f"{escape(e.method)}, {e.seed}" for e in estimates]),
        (
            "rollouts (of them training)",
            [f"{e.rollouts.total:,} ({e.rollouts.training:,})" for e in estimates],
        ),
        ("events (effective)", [f"{e.events:,} ({significant(e.ess, 2)})" for e in estimates]),
    ]
    warnings = [
        f"<li><b>{escape(e.job if len(estimates) > 1 else '')} {escape(w.name)}</b>: {escape(w.message)}. "
        f"Remedy: {escape(w.remedy)}.</li>"
        for e in estimates
        for w in e.warnings
    ]
    return (
        f"<div><p><b>{escape(title or 'tailroad')}</b>: {escape(about)}</p>{table(heads, rows)}"
        + (f"<ul>{''.join(warnings)}</ul>" if warnings else "")
        + "</div>"
    )


def table(heads: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """A table of cells that are HTML already."""
    top = "".join(f"<th {CELL}>{escape(head)}</th>" for head in heads)
    body = "".join(
        f"<tr><th {CELL}>{escape(name)}</th>{''.join(f'<td {CELL}>{cell}</td>' for cell in cells)}</tr>"
        for name, cells in rows
    )
    return f"<table><thead><tr><td></td>{top}</tr></thead><tbody>{body}</tbody></table>"


def p_html(estimate: "Estimated") -> str:
    """p with its standard error, or why it is not to be relied on, and how failed rollouts were treated."""
    treated = treatment(estimate.rollouts.failed, estimate.rollouts.total)
    return _p(estimate) + (f"<br>{escape(treated)}" if treated else "")


def _p(estimate: "Estimated") -> str:
    if estimate.p is None:
        return "not known"
    if not estimate.variance_reliable:
        return f"{told(estimate.p, estimate.ci).value} (see the warnings: rely on the interval)"
    return (
        f"{told(estimate.p, estimate.ci).value} ± {significant(estimate.std_error, 2)}, {one_in(estimate.p)}"
    )


def interval(estimate: "Estimated") -> str:
    """The interval of p."""
    return told(estimate.p, estimate.ci).span


def comparison_html(found: "Comparison") -> str:
    """Runs beside each other, and what each pair comes to."""
    sides = found.sides
    rows = [
        ("scenario, ego", [escape(f"{s.scenario}, {s.ego}") for s in sides]),
        ("method, rollouts", [escape(f"{s.method}, {s.rollouts:,}") for s in sides]),
        ("p", [told(s.p, s.ci).value for s in sides]),
        (f"{level(found.confidence)} interval", [told(s.p, s.ci).span for s in sides]),
    ]
    event = escape(quantity(found.gamma, found.unit))
    summaries = "".join(f"<p>{escape(pair.summary)}</p>" for pair in found.pairs)
    notes = "".join(f"<li>{escape(note)}</li>" for note in found.notes)
    return (
        f"<div><p>p of f ≤ {event}</p>{table([s.name for s in sides], rows)}{summaries}"
        + (f"<ul>{notes}</ul>" if notes else "")
        + "</div>"
    )
