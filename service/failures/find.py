"""From a job's record to its failures: rank, run again, group, count."""

import struct
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ce
from service.failures.events import Events, Order, events_of, starts_log_likelihood
from service.failures.kinds import NAMES, kind_of
from service.failures.memory import Memory
from service.failures.modes import modes_of
from service.failures.objects import Failure, Failures, Mode
from service.failures.rerun import Again, rerun
from service.failures.shares import p_of_mode, share_interval
from service.failures.typical import typical
from service.record import JobRecord
from service.scenario.base import PER_VEHICLE

EXAMINED = 400  # dangerous rollouts that are run again and grouped: shares to within 5% of p
BACKGROUND = "background"
UNSEEN = "unseen"
MORE_NAMES = NAMES | {
    BACKGROUND: "a vehicle of the background traffic comes close",
    UNSEEN: "could not be run again",
}
Watch = Callable[[int, int], None]


def _look_away(done: int, total: int) -> None:
    pass


@dataclass(frozen=True)
class Examined:
    """Dangerous rollouts of a job that were run again.

    positions: of all that were; sample: the first `examined` of them by row, which the shares are counted from;
    modes: of each.
    """

    events: Events
    positions: list[int]
    sample: np.ndarray
    again: dict[int, Again]
    modes: dict[int, str]


def examine(
    events: Events,
    ranking: Sequence[int],
    most: int = EXAMINED,
    workers: int = 1,
    traced: Collection[int] = (),
    folder: Path | None = None,
    watch: Watch = _look_away,
) -> Examined:
    """Run the first `most` rollouts by row and those of `ranking` again, except what `folder` remembers.

    traced: positions to return the traces of; these are always run. watch: told of (done, total).
    """
    sample = np.arange(min(len(events), most))
    positions = sorted({*sample.tolist(), *ranking, *traced})
    memory = Memory(events.record.job, folder)
    keys = {i: ((int(events.iterations[i]), int(events.rows[i])), float(events.f[i])) for i in positions}
    again = {i: known for i in positions if i not in traced and (known := memory.get(*keys[i])) is not None}
    todo = [i for i in positions if i not in again]
    done = [len(again)]

    def on_done(count: int) -> None:
        done[0] += count
        watch(done[0], len(positions))

    fresh = rerun(
        events.record.job,
        events.drawn(todo),
        workers,
        [n for n, i in enumerate(todo) if i in traced],
        on_done,
    )
    for i, a in zip(todo, fresh, strict=True):
        again[i] = a
        memory.add(*keys[i], a)
    if todo:
        memory.save()
    modes = _named([again[i] for i in positions])
    return Examined(events, positions, sample, again, dict(zip(positions, modes, strict=True)))


def _named(again: Sequence[Again]) -> list[str]:
    grouped = iter(modes_of([a.motion for a in again if a.motion is not None]))
    return [next(grouped) if a.motion is not None else UNSEEN if a.error else BACKGROUND for a in again]


def failures_of(
    run: str,
    record: JobRecord,
    order: Order = "likelihood",
    limit: int = 20,
    most: int = EXAMINED,
    workers: int = 1,
    folder: Path | None = None,
    watch: Watch = _look_away,
) -> Failures:
    """The failures of a job: its modes, and the first `limit` of its dangerous rollouts in the order asked for.

    run: what the run is called; folder: where to remember what was run again; the rest as in `examine`.
    """
    events = events_of(record)
    ranking = events.ranking(order)
    examined = examine(events, ranking[:limit].tolist(), most, workers, (), folder, watch)
    rank = {int(position): i for i, position in enumerate(ranking, start=1)}
    job, estimate = record.job, record.estimate
    return Failures(
        run=run,
        job=job.id,
        scenario=job.scenario.name,
        ego=job.ego,
        method=job.method,
        gamma=job.gamma,
        confidence=estimate.confidence,
        p=estimate.p if estimate.estimation_rollouts else None,
        ci=estimate.ci,
        order=order,
        events=len(events),
        examined=examined.sample.size,
        modes=tuple(_modes(examined, rank)),
        failures=tuple(_failure(examined, int(i), rank[int(i)]) for i in ranking[:limit]),
        notes=tuple(_notes(examined)),
    )


def _modes(examined: Examined, rank: dict[int, int]) -> list[Mode]:
    events, sample = examined.events, examined.sample
    estimate = events.record.estimate
    replicated = isinstance(estimate, ce.ReplicatedEstimate)
    names = np.array([examined.modes[int(i)] for i in sample])
    found = []
    for name in sorted(set(names.tolist())):
        member = names == name
        mine = sample[member]
        share, *share_ci = share_interval(
            member, events.share[sample], estimate.confidence, estimate.ess if replicated else None
        )
        if replicated:  # the modes of other rollouts are not known, and these are no independent sample
            p, low, high = share * estimate.p, share_ci[0] * estimate.ci[0], share_ci[1] * estimate.ci[1]
        else:
            stop = estimate.f.size if sample.size == len(events) else int(events.rows[sample[-1] + 1])
            p, low, high = p_of_mode(estimate, events.rows[mine], stop)
        first = min(mine.tolist(), key=rank.__getitem__)
        motions = [m for i in mine if (m := examined.again[int(i)].motion) is not None]
        agreeing = np.array(
            [m is None or _matches(name, kind_of(m)) for m in (examined.again[int(i)].motion for i in mine)]
        )
        weight = events.weight[mine]
        found.append(
            Mode(
                mode=name,
                name=MORE_NAMES["other" if name.startswith("other-") else name],
                typical=typical(motions, weight),
                events=int(member.sum()),
                share=share,
                share_ci=(share_ci[0], share_ci[1]),
                p=p,
                ci=(low, high),
                agreement=float(weight[agreeing].sum() / weight.sum()),
                example=_failure(examined, first, rank[first]),
            )
        )
    return sorted(found, key=lambda mode: (-mode.share, mode.mode))


def _matches(mode: str, kind: str) -> bool:
    return kind == mode or (kind == "other" and mode.startswith("other-"))


def _failure(examined: Examined, i: int, rank: int) -> Failure:
    return told(examined.events, i, examined.again[i], rank, examined.modes[i])


def told(events: Events, i: int, again: Again, rank: int, mode: str | None = None) -> Failure:
    """What is told of the rollout at position i of the events; mode: None where it was not grouped with others."""
    record = events.record
    ((x, noise),) = events.drawn([i])
    vehicles = record.job.scenario.vehicles
    f = float(events.f[i])
    return Failure(
        rank=rank,
        iteration=int(events.iterations[i]),
        row=int(events.rows[i]),
        noise_seed=str(noise),
        f=f,
        f_again=None if again.error else again.f,
        same_to_the_bit=struct.pack("<d", again.f) == struct.pack("<d", f),
        outcome=again.outcome,
        error=again.error,
        log_likelihood=float(events.log_likelihood[i]),
        starts_log_likelihood=starts_log_likelihood(record.problem.base, x),
        weight=float(events.weight[i]),
        share=float(events.share[i]),
        mode=mode or _named([again])[0],
        kind=None if again.motion is None else kind_of(again.motion),
        other=None if again.motion is None else vehicles[again.motion.other].name,
        motion=again.motion,
        starts={
            vehicle.name: dict(zip(PER_VEHICLE, x[4 * j : 4 * j + 4].tolist(), strict=True))
            for j, vehicle in enumerate(vehicles)
        },
    )


def _notes(examined: Examined) -> list[str]:
    events = examined.events
    notes = []
    if not len(events):
        notes.append("No rollout of the estimation has had f <= gamma.")
    if examined.sample.size < len(events):
        notes.append(
            f"Modes, shares and their p come from the first {examined.sample.size} of {len(events)} dangerous rollouts."
        )
    if isinstance(events.record.estimate, ce.ReplicatedEstimate):
        notes.append(
            "The rollouts come from Markov chains: shares count those met, worth the estimate's effective number."
        )
    pack = struct.Struct("<d").pack
    differing = sum(pack(examined.again[i].f) != pack(float(events.f[i])) for i in examined.positions)
    if differing:
        notes.append(
            f"{differing} of {len(examined.positions)} rollouts did not come out the same to the bit when run again: "
            "another version of tailroad, or of what it uses, made the run."
        )
    return notes
