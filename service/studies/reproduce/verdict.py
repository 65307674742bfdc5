"""The verdict on several egos: how probable contacts are, how severe, what people would have prevented, beside people.

Every ego drives the same draws; naive Monte Carlo, so that nothing rests on a search.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from service.analysis.prevention.objects import Prevention
from service.analysis.prevention.prevent import DEFAULT
from service.analysis.risk import Risk
from service.analysis.run import carry_out, jobs_of
from service.analysis.severity.objects import Likely, Severity
from service.analysis.wording import count, percent, significant
from service.errors import StoreError
from service.studies.reproduce.page import Page, made_by, made_with
from service.studies.reproduce.tables import Table

SCENARIO, MEASURE, GAMMA = "i80-paper-10s", "ttc-impact", 0.0
EGOS = {  # rollouts at the scale `paper`; those that SUMO or a camera must drive are slower
    "lidar": 1_000_000, "idm": 1_000_000, "lidar-paper": 1_000_000, "sumo:Krauss": 100_000, "vision": 30_000,
}  # fmt: skip
SHARES = {"smoke": 0.0003, "small": 0.003, "medium": 0.03, "large": 0.3, "paper": 1.0}


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """What an ego's run came to.

    seconds: of workers
    """

    ego: str
    rollouts: int
    seconds: float
    contact: Likely
    severity: Severity
    prevention: Prevention
    risk: Risk | None


def verdict_page(
    scale: str, seed: int, out: Path, workers: int, tell: Callable[[str], None], command: str
) -> Page:
    """Run the egos, from wherever their run directories below `out` stand, and judge them; their page."""
    judged = []
    for ego, most in EGOS.items():
        budget = max(round(most * SHARES[scale]), 20)
        tell(f"{ego}: {budget:,} rollouts")
        judged.append(_judge(ego, budget, seed, out / f"verdict-{scale}" / ego.replace(":", "-"), workers))
    return Page(
        f"verdict-{scale}",
        f"The verdict on five egos ({scale})",
        [made_by(command), _introduction(), made_with()],
        [_contacts(judged), _severity(judged), _preventable(judged), _by_mode(judged), _people(judged)],
        [],
        [_kept(one) for one in judged],
    )


def _judge(ego: str, budget: int, seed: int, folder: Path, workers: int) -> Judged:
    jobs = jobs_of(SCENARIO, ego, GAMMA, "naive", budget=budget, seed=seed, measure=MEASURE)
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = carry_out(folder, jobs, workers)
    job = run.jobs[0]
    estimate = run.estimate
    if estimate.p is None:
        raise StoreError(f"{folder} has no estimate")
    severity = run.severity()
    return Judged(
        ego=ego,
        rollouts=estimate.rollouts.total,
        seconds=estimate.worker_s,
        contact=Likely(events=estimate.events, p=estimate.p, ci=estimate.ci),
        severity=severity,
        prevention=run.prevent(),
        risk=run.risks().get(job.id),
    )


def _introduction() -> str:
    return (
        f"Five egos in `{SCENARIO}` with the measure `{MEASURE}`, threshold 0: the event is a contact. Naive Monte "
        "Carlo; all intervals are 95%. The environment drives as in the paper and never reacts to a conflict, so that "
        "contacts are thousands of times as frequent as among people: the figures compare egos and show the method, "
        "and are no rates of a road. Severity: plastic delta-v with masses by class, P(MAIS3+) by delta-v and the area "
        "hit. Preventable: the same draw driven again, the ego replaced from the onset of the conflict (4 s to "
        "contact) by a reference driver who brakes in his lane; what comes from behind braking does not prevent. At "
        "most 400 contacts of an ego are run again, which the intervals hold."
    )


def _said(p: float, ci: tuple[float, float]) -> str:
    return f"{significant(p, 2)} ({significant(ci[0], 2)} to {significant(ci[1], 2)})"


def _likely(one: Likely) -> str:
    return _said(one.p, one.ci)


def _share(share: float, ci: tuple[float, float], events: int) -> str:
    """A share with its interval; a dash where there is nothing to share."""
    return f"{percent(share)} ({percent(ci[0])} to {percent(ci[1])})" if events else "–"


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]], note: str = "") -> Table:
    return Table(title, tuple(head), tuple(tuple(row) for row in rows), note)


def _contacts(judged: list[Judged]) -> Table:
    rows = [[f"`{j.ego}`", count(j.rollouts), count(j.contact.events), _likely(j.contact), f"{j.seconds:,.0f} s"]
            for j in judged]  # fmt: skip
    return _table("Contacts", ("ego", "rollouts", "contacts", "p(contact)", "cost, one core"), rows)


def _severity(judged: list[Judged]) -> Table:
    rows = [
        [
            f"`{j.ego}`",
            *(_likely(one) for one in j.severity.at_least),
            _likely(j.severity.injury),
            _share(
                j.severity.injury.given_contact, j.severity.injury.given_contact_ci, j.severity.contact.events
            ),
        ]
        for j in judged
    ]
    head = ["ego", "p(delta-v >= 5 m/s)", "p(delta-v >= 10 m/s)", "p(MAIS3+)", "MAIS3+ of a contact"]
    note = "The logistic model gives 0.7% to 1.5% for a touch at no speed: p(MAIS3+) is an upper figure here."
    return _table("Severity", head, rows, note)


def _preventable(judged: list[Judged]) -> Table:
    rows = []
    for j in judged:
        parts = [one.preventable for one in j.prevention.references]
        cells = [_share(part.share, part.share_ci, j.prevention.examined) for part in parts]
        rows.append([f"`{j.ego}`", *cells, _said(*_unpreventable(j))])
    head = ["ego", *(f"by `{name}`" for name in DEFAULT), f"p not preventable by `{DEFAULT[0]}`"]
    return _table("Preventable share of p(contact)", head, rows)


def _unpreventable(j: Judged) -> tuple[float, tuple[float, float]]:
    part = j.prevention.references[0].unpreventable
    return part.p, part.ci


def _by_mode(judged: list[Judged]) -> Table:
    rows = [
        [f"`{j.ego}`", mode.name, count(mode.events), count(mode.prevented),
         _share(mode.share, mode.share_ci, mode.events)]
        for j in judged
        for mode in j.prevention.references[0].modes[:4]
    ]  # fmt: skip
    head = ["ego", "failure mode", "contacts", "prevented", "preventable share"]
    return _table(f"By failure mode, by {DEFAULT[0]}", head, rows, "The four with the largest share of p.")


def _people(judged: list[Judged]) -> Table:
    rows = []
    for j in judged:
        if j.risk is None or j.risk.per_million_km is None:
            rows.append([f"`{j.ego}`", "not known", "not known"])
            continue
        low, high = j.risk.per_million_km_ci
        least, most = j.risk.times_baseline_ci
        rows.append(
            [
                f"`{j.ego}`",
                f"{significant(j.risk.per_million_km, 2)} ({significant(low, 2)} to {_end(high)})",
                f"{significant(least, 2)} to {_end(most)}",
            ]
        )
    baseline = next((j.risk.baseline for j in judged if j.risk is not None), None)
    note = (
        ""
        if baseline is None
        else f"People: {significant(baseline.per_million_km)} per million km ({baseline.source})."
    )
    return _table("Beside people", ["ego", "contacts per million km", "times people's crashes"], rows, note)


def _end(value: float | None) -> str:
    return "∞" if value is None else significant(value, 2)


def _kept(one: Judged) -> Any:
    """What results.json says: without the lists of rollouts."""
    whole = msgspec.to_builtins(one)
    whole["severity"].pop("contacts")
    whole["prevention"].pop("rollouts")
    return whole
