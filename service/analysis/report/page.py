"""The report as an HTML page: facts and pictures put into the templates, everything from outside escaped."""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import jinja2
import msgspec
from markupsafe import Markup

from service.analysis import wording
from service.analysis.report import drawings, figures, ink, learned_figures
from service.analysis.report.dangerous import Findings
from service.analysis.report.ink import Picture
from service.analysis.report.replays import player, player_hash, replay_json
from service.evaluation.record import JobRecord

FOLDER = Path(__file__).parent
SECTIONS = {  # a template each, in this order, with its title in the list of sections; the first is the page's head
    "answer": "",
    "comparison": "In numbers",
    "estimates": "Estimates",
    "search": "The search",
    "learned": "What it learned",
    "modes": "How it fails",
    "verdict": "Severity and prevention",
    "coverage": "Coverage of the domain",
    "dangerous": "Dangerous rollouts",
    "failures": "Failed rollouts",
    "method": "Method and limits",
    "reproduce": "Reproduce",
}


def page_of(facts: dict[str, Any], records: Sequence[JobRecord], seen: Findings) -> str:
    """The page, self-contained: style and pictures are inside it."""
    return render(
        "page.html",
        facts=facts,
        sections=list(SECTIONS),
        titles=[(section, title) for section, title in SECTIONS.items() if title],
        pictures=Pictures(facts, records, seen),
        scenario_json=msgspec.json.format(msgspec.json.encode(facts["scenario"]["file"])).decode(),
        colours={"ego": ink.EGO, "threat": ink.THREAT, "other": ink.OTHER},
        **_scripts(seen),
    )


def _scripts(seen: Findings) -> dict[str, str]:
    """The player, where there is something to play."""
    if not any(rollout.trace is not None for rollout in seen.rollouts):
        return {}
    return {"player": player(), "player_hash": player_hash()}


def environment_of(*templates: Path) -> jinja2.Environment:
    """What pages are made with: everything is escaped, and a name that is not there is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(templates),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render(template: str, **values: Any) -> str:
    """A page of a template in `templates/`."""
    environment = environment_of(FOLDER / "templates")
    environment.filters |= {
        "significant": wording.significant,
        "quantity": wording.quantity,
        "count": wording.count,
        "percent": wording.percent,
        "level": wording.level,
        "factor": wording.factor,
        "duration": wording.duration,
        "colour": ink.colour,
        "told": wording.told,
        "exact": _exact,
    }
    values = {"player": "", "player_hash": ""} | values
    style = Markup((FOLDER / "style.css").read_text(encoding="utf-8"))
    return environment.get_template(template).render(style=style, **values)


def _exact(value: float | None) -> str:
    """Every digit, for the value of a <data> element."""
    return "" if value is None else repr(value)


class Pictures:
    """The page's pictures; drawn when a template asks for them."""

    def __init__(self, facts: dict[str, Any], records: Sequence[JobRecord], seen: Findings):
        self._facts = facts
        self._records = {r.job.id: r for r in records}
        self._rollouts = seen.rollouts

    @cached_property
    def run(self) -> list[Picture]:
        return figures.run_pictures(self._facts, list(self._records.values()))

    def search(self, job: dict[str, Any]) -> list[Picture]:
        return figures.search_pictures(job)

    def learned(self, job: dict[str, Any]) -> list[Picture]:
        return learned_figures.learned_pictures(self._records[job["id"]], self._facts["learned"][job["id"]])

    @cached_property
    def dangerous(self) -> list[tuple[dict[str, Any], Picture | None, Markup | None]]:
        """The facts' dangerous rollouts, each with its picture and what the player needs."""
        return [
            (
                facts,
                drawings.drawing(r, facts, r.record.problem.corridor),
                replay_json(r, r.record.problem.corridor),
            )
            for r, facts in zip(self._rollouts, self._facts["dangerous"], strict=True)
        ]
