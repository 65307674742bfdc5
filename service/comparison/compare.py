"""From the records of two jobs to their comparison."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import ce
from service.comparison.differences import bounds_of, difference_of, pairs_of
from service.comparison.objects import Comparison, Curves, Difference, ModeChange, ModeSide, Side
from service.comparison.words import said_of
from service.errors import InputError
from service.failures.events import events_of
from service.failures.examine import (
    EXAMINED,
    Examined,
    Watch,
    examine,
    look_away,
    mode_name,
    modes_by_position,
)
from service.failures.find import notes_on
from service.failures.rerun import Rerunner
from service.failures.shares import mode_estimate, share_interval
from service.failures.tell import known_rows, mode_p
from service.record import JobRecord
from service.thresholds import curve_gammas


def comparison_of(
    a: JobRecord,
    b: JobRecord,
    runs: tuple[str, str],
    most: int = EXAMINED,
    workers: int = 1,
    folders: tuple[Path | None, Path | None] = (None, None),
    watch: Watch = look_away,
) -> Comparison:
    """B against A. InputError where they do not ask the same question; ce.OptionsError where confidences differ.

    runs: what the two are called; most: dangerous rollouts of each at most that are run again and grouped (0: no
    modes); folders: where each remembers them; watch: told of (done, total), for A and then for B.
    """
    if a.job.gamma != b.job.gamma:
        raise InputError(
            f"{runs[0]} has gamma {a.job.gamma:g} and {runs[1]} gamma {b.job.gamma:g}: p of different events says "
            "nothing about the egos; run one of them again with the other's --gamma"
        )
    for record, run in zip((a, b), runs, strict=True):
        if not record.estimate.estimation_rollouts:
            raise InputError(
                f"{run} has no answered rollout by {record.job.method} yet: let it run, or give --method"
            )
    if a.job.scenario.safety != b.job.scenario.safety:
        raise InputError(
            f"{runs[0]} and {runs[1]} measure safety differently; compare runs with the same [safety]"
        )
    difference = difference_of(a.estimate, b.estimate)
    examined = []
    for record, folder in zip((a, b), folders, strict=True):
        with Rerunner(record.job, workers) as rerunner:
            examined.append(examine(events_of(record), rerunner, (), most, (), folder, watch))
    sides = (_side(a, runs[0], a.job.ego), _side(b, runs[1], b.job.ego))
    if sides[0].name == sides[1].name:
        sides = (_side(a, runs[0], runs[0]), _side(b, runs[1], runs[1]))
    modes = _modes(*examined)
    return Comparison(
        gamma=a.job.gamma,
        confidence=a.estimate.confidence,
        a=sides[0],
        b=sides[1],
        difference=difference,
        pairs=pairs_of(a.estimate, b.estimate),
        modes=tuple(modes),
        curves=_curves(a, b),
        said=said_of(sides, difference, modes, a.job.gamma, a.estimate.confidence),
        notes=tuple(_notes(a, b, runs, examined, difference.paired)),
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


def _modes(a: Examined, b: Examined) -> list[ModeChange]:
    """The modes of both, their rollouts grouped together."""
    in_a, in_b = modes_by_position([a, b])
    found = [
        _change(mode, a, _members(a, in_a, mode), b, _members(b, in_b, mode))
        for mode in sorted({*in_a.values(), *in_b.values()})
    ]
    return sorted(found, key=lambda m: (-abs(m.difference.difference), m.mode))


def _members(examined: Examined, modes: dict[int, str], mode: str) -> np.ndarray:
    return np.array([modes[i] == mode for i in examined.sample.tolist()], dtype=bool)


def _change(mode: str, a: Examined, in_a: np.ndarray, b: Examined, in_b: np.ndarray) -> ModeChange:
    sides = _mode_side(a, in_a), _mode_side(b, in_b)
    difference = _mode_difference(a, in_a, b, in_b, sides)
    if sides[0].events == 0 or sides[1].events == 0:
        change = "appeared" if sides[0].events == 0 else "vanished"
    elif difference.clear:
        change = "more" if difference.difference > 0 else "less"
    else:
        change = "unclear"
    return ModeChange(
        mode=mode, name=mode_name(mode), a=sides[0], b=sides[1], difference=difference, change=change
    )


def _mode_side(examined: Examined, member: np.ndarray) -> ModeSide:
    events, estimate = examined.events, examined.events.record.estimate
    worth = estimate.ess if isinstance(estimate, ce.ReplicatedEstimate) else None
    share = share_interval(member, events.share[examined.sample], estimate.confidence, worth)
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


def _curves(a: JobRecord, b: JobRecord) -> Curves:
    gammas = curve_gammas([a, b])
    of_a, of_b = a.estimate.curve(gammas), b.estimate.curve(gammas)
    return Curves(
        gamma=tuple(gammas.tolist()),
        a=tuple(of_a.p.tolist()),
        a_low=tuple(of_a.low.tolist()),
        a_high=tuple(of_a.high.tolist()),
        b=tuple(of_b.p.tolist()),
        b_low=tuple(of_b.low.tolist()),
        b_high=tuple(of_b.high.tolist()),
    )


def _notes(
    a: JobRecord, b: JobRecord, runs: tuple[str, str], examined: Sequence[Examined], paired: bool
) -> list[str]:
    notes = []
    if a.job.scenario != b.job.scenario:
        notes.append(
            "The two have different scenarios: a difference may come from them rather than from the ego."
        )
    if a.job.weights_sha256 != b.job.weights_sha256:
        notes.append("The two have different driver weights, and so different traffic.")
    if not paired:
        notes.append(
            "The two did not run the same draws, so their variances add: naive Monte Carlo with the same seed and "
            "budget (`tailroad compare SCENARIO --ego A --ego B`) needs far fewer rollouts to tell them apart."
        )
    for record, run, one in zip((a, b), runs, examined, strict=True):
        notes += [f"{run}: {warning.name}: {warning.message}" for warning in record.estimate.warnings]
        notes += [f"{run}: {note}" for note in notes_on(one)]
    return notes
