"""From a job's record to the shares of P0, of its rollouts and of p by cell of the operational design domain."""

from itertools import combinations

import numpy as np

import ce
from ce.streams import Stream
from service.analysis.coverage.attributes import ATTRIBUTES, Attribute
from service.analysis.coverage.domain import Domain
from service.analysis.coverage.objects import Cell, Coverage, Covered, Pair
from service.analysis.failures.events import events_of
from service.analysis.failures.examine import Examined, sample_of
from service.analysis.failures.question import question_of
from service.analysis.failures.tell import mode_share
from service.evaluation.record import JobRecord
from service.world.scenario.base import base_distribution, before_weights
from service.world.scenario.noise_mode import without_searched_noise

DRAWS = 10_000  # of P0
AT_ONCE = 2_000
STREAM = 0x6F6464  # a stream of its own: the same draws whatever the job's seed and method
EXAMINED = 2_000  # dangerous rollouts at most that shares of p are counted on
LISTED = 20  # pairs of cells


def coverage_of(run: str, record: JobRecord, domain: Domain | None = None) -> Coverage:
    """How a job's rollouts cover the domain: P0's mass, rollouts and p by cell. Nothing is run for it.

    run: what the run is called
    domain: a declared one, whose cells are told apart
    """
    job, estimate = record.job, record.estimate
    drawn, seen = _of_base(record), record.starts
    events = events_of(record)
    examined = Examined(events, sample_of(events, EXAMINED), {})
    columns = before_weights(job.scenario)
    found = [x[:columns] for x, _ in events.drawn(examined.sample.tolist())]
    dangerous = np.array(found).reshape(len(found), columns)
    numbers = [_Numbers(record, attribute, drawn, seen, dangerous) for attribute in ATTRIBUTES]
    attributes = tuple(_covered(one, examined, domain) for one in numbers)
    pairs, pairs_seen, never = _pairs(numbers, len(seen) > 0)
    return Coverage(
        **question_of(run, record),
        confidence=estimate.confidence,
        p=estimate.p if estimate.estimation_rollouts else None,
        draws=len(drawn),
        looked_at=len(seen),
        events=len(events),
        examined=int(examined.sample.size),
        attributes=attributes,
        pairs=pairs,
        pairs_seen=pairs_seen,
        pairs_never_seen=never,
        domain="" if domain is None else domain.name,
        missing=_missing(attributes, domain),
        notes=_notes(record, len(events), int(examined.sample.size)),
    )


def _of_base(record: JobRecord) -> np.ndarray:
    """Draws of P0, the coordinates before the drivers' weights, (DRAWS, k)."""
    scenario = without_searched_noise(record.job.scenario)  # noise that is searched comes after them
    base, columns = base_distribution(scenario, record.problem.drivers), before_weights(scenario)
    # the drivers' weights, which decide no cell, are left uncorrelated
    stream = Stream(base, STREAM, "estimate", 0)
    parts = [stream.draw(first, min(first + AT_ONCE, DRAWS), correlated=False)[0][:, :columns].copy()
             for first in range(0, DRAWS, AT_ONCE)]  # fmt: skip
    return np.concatenate(parts)


class _Numbers:
    """The cells of one attribute that draws of P0, rollouts and dangerous rollouts lie in, by number."""

    def __init__(
        self,
        record: JobRecord,
        attribute: Attribute,
        drawn: np.ndarray,
        seen: np.ndarray,
        dangerous: np.ndarray,
    ):
        self.attribute = attribute

        def of(x: np.ndarray) -> np.ndarray:
            if not len(x):
                return np.zeros(0, np.int64)
            return attribute.cell_of(record.job.scenario, record.problem.corridor, x)

        self.drawn, self.seen, self.dangerous = of(drawn), of(seen), of(dangerous)
        self.known = len(seen) > 0


def _covered(of: _Numbers, examined: Examined, domain: Domain | None) -> Covered:
    confidence = examined.events.record.estimate.confidence
    declared = None if domain is None else domain.domain.get(of.attribute.name)
    cells = []
    for number, name in enumerate(of.attribute.cells):
        k, n = int((of.drawn == number).sum()), of.drawn.size
        low, high = ce.interval.clopper_pearson(k, n, confidence)
        member = of.dangerous == number
        share = mode_share(examined, member) if member.size else None
        rollouts = int((of.seen == number).sum()) if of.known else None
        cells.append(
            Cell(
                cell=name,
                mass=k / n,
                mass_ci=(float(low), float(high)),
                rollouts=rollouts,
                rollouts_share=None if rollouts is None else rollouts / of.seen.size,
                events=int(member.sum()),
                share=None if share is None else share[0],
                share_ci=None if share is None else share[1:],
                times=share[0] * n / k if share is not None and k else None,
                inside=None if domain is None else declared is None or name in declared,
            )
        )
    return Covered(
        attribute=of.attribute.name,
        heading=of.attribute.heading,
        unit=of.attribute.unit,
        cells=tuple(cells),
        never_drawn=tuple(c.cell for c in cells if c.mass == 0.0),
        never_seen=tuple(c.cell for c in cells if c.mass > 0.0 and c.rollouts == 0),
    )


def _pairs(numbers: list[_Numbers], known: bool) -> tuple[int, int | None, tuple[Pair, ...]]:
    """Cells of two attributes that P0 draws, how many of them a rollout lies in, and the others whose two cells hold
    rollouts apart from each other."""
    there = reached = 0
    never = []
    for a, b in combinations(numbers, 2):
        wide = len(b.attribute.cells)
        drawn, times = np.unique(a.drawn * wide + b.drawn, return_counts=True)
        there += drawn.size
        seen = np.isin(drawn, a.seen * wide + b.seen)
        reached += int(seen.sum())
        never += [
            Pair(
                attributes=(a.attribute.name, b.attribute.name),
                cells=(a.attribute.cells[key // wide], b.attribute.cells[key % wide]),
                mass=count / a.drawn.size,
            )
            for key, count in zip(drawn[~seen].tolist(), times[~seen].tolist(), strict=True)
            if key // wide in a.seen and key % wide in b.seen
        ]
    if not known:
        return there, None, ()
    return there, reached, tuple(sorted(never, key=lambda pair: -pair.mass)[:LISTED])


def _missing(attributes: tuple[Covered, ...], domain: Domain | None) -> tuple[str, ...]:
    """Cells that the domain's file names and no rollout lies in."""
    if domain is None:
        return ()
    return tuple(
        f"{one.attribute}: {cell.cell}"
        for one in attributes
        for cell in one.cells
        if cell.cell in domain.domain.get(one.attribute, ()) and not cell.rollouts
    )


def _notes(record: JobRecord, events: int, examined: int) -> tuple[str, ...]:
    found = []
    if not len(record.starts):
        found.append(
            f"The rollouts of method {record.job.method} are parts of paths, which start anew: cells are counted on P0 "
            "and on the dangerous ones alone."
        )
    if examined < events:
        found.append(f"Shares of p are counted on {examined:,} of {events:,} dangerous rollouts.")
    if record.job.scenario.weather is None:
        found.append("The scenario draws no weather and no light: every rollout is on a clear afternoon.")
    return tuple(found)
