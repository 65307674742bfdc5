"""From the records of jobs to their comparison."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

import ce
from service.analysis.comparison.differences import bounds_of, difference_of, pairs_of
from service.analysis.comparison.objects import (
    Comparison,
    Curves,
    Difference,
    Line,
    ModeChange,
    ModeSide,
    Pair,
    Side,
)
from service.analysis.comparison.words import pair_summary
from service.analysis.failures.events import events_of
from service.analysis.failures.examine import (
    EXAMINED,
    Examined,
    Watch,
    examine,
    look_away,
    mode_name,
    modes_by_position,
)
from service.analysis.failures.find import notes_on
from service.analysis.failures.rerun import Open, Rerunner
from service.analysis.failures.shares import mode_estimate
from service.analysis.failures.tell import known_rows, mode_p, mode_share
from service.analysis.thresholds import curve_gammas
from service.analysis.wording import quantity
from service.errors import InputError
from service.evaluation.record import JobRecord
from service.world.scenario.measures import measure_kind


def comparison_of(
    records: Sequence[JobRecord],
    runs: Sequence[str],
    most: int = EXAMINED,
    workers: int = 1,
    folders: Sequence[Path | None] | None = None,
    watch: Watch = look_away,
    opened: Open | None = None,
) -> Comparison:
    """Each against each. InputError where they do not ask the same question; ce.OptionsError where confidences differ.

    runs: what each is called
    most: dangerous rollouts of each at most that are run again and grouped (0: no modes)
    folders: where each remembers them
    watch: told of (done, total), of one after the other
    opened: rerunners of jobs, else new ones with `workers` processes
    """
    check_comparable(records, runs)
    examined = []
    for record, folder in zip(records, folders or [None] * len(records), strict=True):
        with (opened or (lambda job: Rerunner(job, workers)))(record.job) as rerunner:
            examined.append(examine(events_of(record), rerunner, (), most, (), folder, watch))
    egos = Counter(record.job.ego for record in records)
    sides = [
        _side(record, run, record.job.ego if egos[record.job.ego] == 1 else run)
        for record, run in zip(records, runs, strict=True)
    ]
    modes = modes_by_position(examined)
    pairs = [_pair(a, b, sides, examined, modes) for a, b in combinations(range(len(records)), 2)]
    return Comparison(
        gamma=records[0].estimate.gamma,
        unit=measure_kind(records[0].job.scenario.safety.measure).unit,
        confidence=records[0].estimate.confidence,
        sides=tuple(sides),
        pairs=tuple(pairs),
        curves=_curves(records),
        notes=tuple(_notes(records, runs, examined, pairs)),
    )


def check_comparable(records: Sequence[JobRecord], runs: Sequence[str]) -> None:
    """InputError where the jobs do not ask the same question, or one has no answer yet."""
    if len(records) < 2 or len(set(runs)) < len(runs):
        raise InputError(f"give two or more different runs to compare, not {', '.join(runs) or 'none'}")
    first = records[0]
    for record, run in zip(records, runs, strict=True):
        if record.estimate.gamma != first.estimate.gamma:
            raise InputError(
                f"{runs[0]} has gamma {first.estimate.gamma:g} and {run} gamma {record.estimate.gamma:g}: p of "
                "different events says nothing about the egos; give one threshold for all with gamma (--gamma)"
            )
        if not record.estimate.estimation_rollouts:
            raise InputError(
                f"{run} has no answered rollout by {record.job.method} yet: let it run, or name another job of it"
            )
        if record.job.scenario.safety != first.job.scenario.safety:
            raise InputError(
                f"{runs[0]} and {run} measure safety differently; compare runs with the same [safety]"
            )


def _pair(
    a: int, b: int, sides: Sequence[Side], examined: Sequence[Examined], modes: Sequence[dict[int, str]]
) -> Pair:
    first, second = (examined[i].events.record.estimate for i in (a, b))
    difference = difference_of(first, second)
    unit = measure_kind(examined[a].events.record.job.scenario.safety.measure).unit
    event = f"f <= {quantity(first.gamma, unit)}"
    changes = [
        _change(
            mode,
            examined[a],
            _members(examined[a], modes[a], mode),
            examined[b],
            _members(examined[b], modes[b], mode),
        )
        for mode in sorted({*modes[a].values(), *modes[b].values()})
    ]
    changes.sort(key=lambda m: (-abs(m.difference.difference), m.mode))
    draws = pairs_of(first, second)
    summary = pair_summary((sides[a], sides[b]), difference, changes, event, first.confidence, draws)
    return Pair(
        a=a,
        b=b,
        difference=difference,
        draws=draws,
        modes=tuple(changes),
        summary=summary,
        said=summary,
    )


def _side(record: JobRecord, run: str, name: str) -> Side:
    job, estimate = record.job, record.estimate
    known = estimate.estimation_rollouts > 0
    return Side(
        name=name,
        run=run,
        scenario=job.scenario.name,
        ego=job.ego,
        method=job.method,
        seed=job.seed,
        rollouts=estimate.rollouts,
        events=estimate.events,
        ess=estimate.ess,
        p=estimate.p if known else None,
        std_error=estimate.std_error if known else None,
        ci=estimate.ci,
        warnings=tuple(warning.name for warning in estimate.warnings),
    )


def _members(examined: Examined, modes: dict[int, str], mode: str) -> np.ndarray:
    return np.array([modes[i] == mode for i in examined.sample.tolist()], dtype=bool)


def _change(mode: str, a: Examined, in_a: np.ndarray, b: Examined, in_b: np.ndarray) -> ModeChange:
    sides = _mode_side(a, in_a), _mode_side(b, in_b)
    difference = _mode_difference(a, in_a, b, in_b, sides)
    change = change_of(difference, sides[0].events, sides[1].events)
    return ModeChange(
        mode=mode, name=mode_name(mode), a=sides[0], b=sides[1], difference=difference, change=change
    )


def change_of(difference: Difference, events_a: int, events_b: int) -> str:
    """What became of a mode (`ModeChange`): that one of the two did not meet it may be chance."""
    if not difference.clear:
        return "unclear"
    if events_a == 0 or events_b == 0:
        return "appeared" if events_a == 0 else "vanished"
    return "more" if difference.difference > 0 else "less"


def _mode_side(examined: Examined, member: np.ndarray) -> ModeSide:
    share = mode_share(examined, member)
    p, ci = mode_p(examined, member, share)
    return ModeSide(events=int(member.sum()), p=p, ci=ci)


def _mode_difference(
    a: Examined, in_a: np.ndarray, b: Examined, in_b: np.ndarray, sides: tuple[ModeSide, ModeSide]
) -> Difference:
    estimates = a.events.record.estimate, b.events.record.estimate
    if any(isinstance(estimate, ce.ReplicatedEstimate) for estimate in estimates):
        return bounds_of((sides[0].p, *sides[0].ci), (sides[1].p, *sides[1].ci))
    known = known_rows(a), known_rows(b)
    if estimates[0].f.size == estimates[1].f.size:
        known = (min(known),) * 2  # of as many rollouts of each, so that pairs keep their partners
    parts = []
    for examined, member, estimate, stop in zip((a, b), (in_a, in_b), estimates, known, strict=True):
        rows = examined.events.rows[examined.sample[member]]
        parts.append(mode_estimate(estimate, rows[rows < stop], stop))
    return difference_of(*parts)


def _curves(records: Sequence[JobRecord]) -> Curves:
    gammas = curve_gammas(records)
    lines = []
    for record in records:
        curve = record.estimate.curve(gammas)
        p = tuple(v if math.isfinite(v) else None for v in curve.p.tolist())
        lines.append(Line(p=p, low=tuple(curve.low.tolist()), high=tuple(curve.high.tolist())))
    return Curves(gamma=tuple(gammas.tolist()), sides=tuple(lines))


def _notes(
    records: Sequence[JobRecord], runs: Sequence[str], examined: Sequence[Examined], pairs: Sequence[Pair]
) -> list[str]:
    notes = []
    first, others = records[0], records[1:]
    if any(record.job.scenario != first.job.scenario for record in others):
        notes.append(
            "They have different scenarios: a difference may come from them rather than from the ego."
        )
    if any(record.job.weights_sha256 != first.job.weights_sha256 for record in others):
        notes.append("They have different driver weights, and so different traffic.")
    apart = [f"{runs[p.a]} and {runs[p.b]}" for p in pairs if not p.difference.paired]
    if apart:
        notes.append(
            f"{'; '.join(apart)}: not the same draws, so that variances add. A method that searches looks for each "
            "ego's own failures, and so draws for each from another distribution; splitting moves chains, which have "
            "no draws to share. Naive Monte Carlo with the same seed and budget (`tailroad compare SCENARIO --ego A "
            "--ego B`) runs the same draws, and needs far fewer rollouts to tell egos apart where the "
            "event is not too rare for it."
        )
    for record, run, one in zip(records, runs, examined, strict=True):
        notes += [f"{run}: {warning.name}: {warning.message}" for warning in record.estimate.warnings]
        notes += [f"{run}: {note}" for note in notes_on(one)]
    return notes
