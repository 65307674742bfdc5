"""The verdict on several egos: how probable contacts are, how severe, what people would have prevented, beside people.

Every ego drives the same draws in two worlds: one of drivers who err as people do, in which contacts are so rare that
mostly their upper bound is told, beside people; and the paper's, whose drivers never react, in which there are contacts
enough to tell how severe they are and who would have prevented them. Naive Monte Carlo, so that nothing rests on a
search.
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

PEOPLE, PAPER = "i80-10s", "i80-paper-10s"
MEASURE, GAMMA = "ttc-impact", 0.0
EGOS = {  # rollouts in both worlds at the scale `paper`; those that SUMO or a camera must drive are slower
    "lidar": (400_000, 100_000), "idm": (400_000, 100_000), "lidar-paper": (400_000, 100_000),
    "sumo:Krauss": (30_000, 30_000), "vision": (2_000, 4_000),
}  # fmt: skip
SHARES = {"smoke": 0.0003, "small": 0.003, "medium": 0.03, "large": 0.3, "paper": 1.0}


class Judged(msgspec.Struct, frozen=True, kw_only=True):
    """What an ego's run in a scenario came to.

    seconds: of workers
    """

    scenario: str
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
    people, paper = (
        [_judge(world, ego, most[i], scale, seed, out, workers, tell) for ego, most in EGOS.items()]
        for i, world in enumerate((PEOPLE, PAPER))
    )
    judged = [*people, *paper]
    return Page(
        f"verdict-{scale}",
        f"The verdict on five egos ({scale})",
        [made_by(command), _introduction(), made_with()],
        [_people(people), _contacts(paper), _severity(judged), _preventable(judged), _by_mode(judged)],
        [],
        [_kept(one) for one in judged],
    )


def _judge(
    scenario: str,
    ego: str,
    most: int,
    scale: str,
    seed: int,
    out: Path,
    workers: int,
    tell: Callable[[str], None],
) -> Judged:
    budget = max(round(most * SHARES[scale]), 20)
    tell(f"{ego} in {scenario}: {budget:,} rollouts")
    folder = out / f"verdict-{scale}" / f"{scenario}-{ego.replace(':', '-')}"
    jobs = jobs_of(scenario, ego, GAMMA, "naive", budget=budget, seed=seed, measure=MEASURE)
    folder.parent.mkdir(parents=True, exist_ok=True)
    run = carry_out(folder, jobs, workers)
    job = run.jobs[0]
    estimate = run.estimate
    if estimate.p is None:
        raise StoreError(f"{folder} has no estimate")
    severity = run.severity()
    return Judged(
        scenario=scenario,
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
        f"Five egos with the measure `{MEASURE}`, threshold 0: the event is a contact, however light. Naive Monte "
        "Carlo; every ego drives the same draws; all intervals are 95%. "
        f"In `{PEOPLE}` the others see, react and sometimes do not look, as often as people crash; contacts are so "
        "rare that an ego without any has an upper bound alone, which more rollouts lower. "
        f"In `{PAPER}` the others drive as in the paper and never react to a conflict: contacts are thousands of times "
        "as frequent as among people, so that what is said of them compares egos and is no rate of a road. "
        "Severity: plastic delta-v with masses by class, P(MAIS3+) by delta-v and the area hit. Preventable: the same "
        "draw driven again, the ego replaced from the onset of the conflict (4 s to contact) by a reference driver who "
        "brakes in his lane; what comes from behind braking does not prevent. At most 400 contacts of an ego are run "
        "again, which the intervals hold. Egos without a contact have no row in the tables of what contacts are like."
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
    head = ("ego", "rollouts", "contacts", "p(contact)", "cost, one core")
    return _table(f"Contacts in `{PAPER}`", head, rows)


def _with_contacts(judged: list[Judged]) -> list[Judged]:
    return [j for j in judged if j.contact.events]


def _severity(judged: list[Judged]) -> Table:
    rows = [
        [
            f"`{j.scenario}`",
            f"`{j.ego}`",
            *(_likely(one) for one in j.severity.at_least),
            _likely(j.severity.injury),
            _share(
                j.severity.injury.given_contact, j.severity.injury.given_contact_ci, j.severity.contact.events
            ),
        ]
        for j in _with_contacts(judged)
    ]
    head = [
        "scenario",
        "ego",
        "p(delta-v >= 5 m/s)",
        "p(delta-v >= 10 m/s)",
        "p(MAIS3+)",
        "MAIS3+ of a contact",
    ]
    note = "The logistic model gives 0.7% to 1.5% for a touch at no speed: p(MAIS3+) is an upper figure here."
    return _table("Severity", head, rows, note)


def _preventable(judged: list[Judged]) -> Table:
    rows = []
    for j in _with_contacts(judged):
        parts = [one.preventable for one in j.prevention.references]
        cells = [_share(part.share, part.share_ci, j.prevention.examined) for part in parts]
        rows.append([f"`{j.scenario}`", f"`{j.ego}`", *cells, _said(*_unpreventable(j))])
    head = ["scenario", "ego", *(f"by `{name}`" for name in DEFAULT), f"p not preventable by `{DEFAULT[0]}`"]
    return _table("Preventable share of p(contact)", head, rows)


def _unpreventable(j: Judged) -> tuple[float, tuple[float, float]]:
    part = j.prevention.references[0].unpreventable
    return part.p, part.ci


def _by_mode(judged: list[Judged]) -> Table:
    rows = [
        [f"`{j.scenario}`", f"`{j.ego}`", mode.name, count(mode.events), count(mode.prevented),
         _share(mode.share, mode.share_ci, mode.events)]
        for j in _with_contacts(judged)
        for mode in j.prevention.references[0].modes[:4]
    ]  # fmt: skip
    head = ["scenario", "ego", "failure mode", "contacts", "prevented", "preventable share"]
    return _table(f"By failure mode, by {DEFAULT[0]}", head, rows, "The four with the largest share of p.")


def _people(judged: list[Judged]) -> Table:
    rows = []
    for j in judged:
        begins = [
            f"`{j.ego}`",
            count(j.rollouts),
            count(j.contact.events),
            _likely(j.contact),
            _likely(j.severity.injury),
        ]
        if j.risk is None or j.risk.per_million_km is None:
            rows.append([*begins, "not known", "not known", f"{j.seconds:,.0f} s"])
            continue
        low, high = j.risk.per_million_km_ci
        least, most = j.risk.times_baseline_ci
        rate = f"{significant(j.risk.per_million_km, 2)} ({significant(low, 2)} to {_end(high)})"
        rows.append([*begins, rate, f"{significant(least, 2)} to {_end(most)}", f"{j.seconds:,.0f} s"])
    baseline = next((j.risk.baseline for j in judged if j.risk is not None), None)
    note = (
        ""
        if baseline is None
        else f"People: {significant(baseline.per_million_km)} per million km ({baseline.source})."
    )
    head = ["ego", "rollouts", "contacts", "p(contact)", "p(MAIS3+)", "contacts per million km",
            "times people's crashes", "cost, one core"]  # fmt: skip
    return _table(f"Contacts in `{PEOPLE}`, beside people", head, rows, note)


def _end(value: float | None) -> str:
    return "∞" if value is None else significant(value, 2)


def _kept(one: Judged) -> Any:
    """What results.json says: without the lists of rollouts."""
    whole = msgspec.to_builtins(one)
    whole["severity"].pop("contacts")
    whole["prevention"].pop("rollouts")
    return whole
