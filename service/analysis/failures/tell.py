"""Examined rollouts as JSON objects: each of them, and the modes that they fall into."""

import struct

import numpy as np

import ce
from service.analysis.failures.events import Events, starts_log_likelihood
from service.analysis.failures.examine import Examined, alone, mode_name
from service.analysis.failures.kinds import kind_of
from service.analysis.failures.lapses import NAMES as LAPSES
from service.analysis.failures.lapses import sentence
from service.analysis.failures.objects import Cause, Failure, Mode
from service.analysis.failures.rerun import Rerun
from service.analysis.failures.shares import (
    mean_estimate,
    mode_estimate,
    replicated_means,
    replicated_p,
    replicated_parts,
    replicated_share,
    share_interval,
)
from service.analysis.failures.typical import typical
from service.world.scenario.base import STARTS, causes
from service.world.scenario.causes import kinds
from service.world.scenario.schema import Scenario


def failure_of(events: Events, i: int, again: Rerun, rank: int, mode: str | None = None) -> Failure:
    """The rollout at position i of the events.

    mode: None where it was not grouped with others
    """
    record = events.record
    ((x, noise_seed),) = events.drawn([i])
    vehicles = record.job.scenario.vehicles
    names = record.job.scenario.start_names
    f = float(events.f[i])
    return Failure(
        rank=rank,
        iteration=int(events.iterations[i]),
        row=int(events.rows[i]),
        noise_seed=str(noise_seed),
        f=f,
        f_again=None if again.error else again.f,
        same_to_the_bit=same_bits(again.f, f),
        outcome=again.outcome,
        error=again.error,
        log_likelihood=float(events.log_likelihood[i]),
        starts_log_likelihood=starts_log_likelihood(record.problem.base, x),
        weight=float(events.weight[i]),
        share=float(events.share[i]),
        mode=mode or alone(again),
        kind=None if again.motion is None else kind_of(again.motion),
        other=None if again.motion is None else vehicles[again.motion.other].name,
        motion=again.motion,
        starts={
            vehicle.name: dict(zip(names, x[STARTS * j : STARTS * (j + 1)].tolist(), strict=True))
            for j, vehicle in enumerate(vehicles)
        },
        causes=_causes(record.job.scenario, x),
        contact=again.contact,
        lapse=again.lapse,
        story=story_of(events, again),
    )


def _causes(scenario: Scenario, x: np.ndarray) -> dict[str, dict[str, float]]:
    """What makes each driver err, by name, as the draw x (d,) has it."""
    drawn = causes(scenario, x)
    return {
        vehicle.name: dict(zip(kinds(scenario), drawn[j].tolist(), strict=True))
        for j, vehicle in enumerate(scenario.vehicles)
        if drawn.size and vehicle.role != "ego"
    }


def story_of(events: Events, again: Rerun) -> str:
    """What came together in a rollout, in one sentence; "" where that is not known."""
    if again.motion is None:
        return ""
    other = events.record.job.scenario.vehicles[again.motion.other].name
    return sentence(again.motion, again.lapse, other, again.contact)


def sample_causes(examined: Examined, rank: dict[int, int]) -> list[Cause]:
    """What the other drivers did wrong in the sample, the largest share of p first.

    rank: of each position in the order asked for
    """
    events, sample = examined.events, examined.sample
    lapses = [examined.reruns[i].lapse for i in sample.tolist()]
    fallen = np.array(["" if lapse is None else lapse.kind for lapse in lapses])
    found = []
    for kind in sorted(set(fallen.tolist()) - {""}):
        member = fallen == kind
        share, low, high = mode_share(examined, member)
        p, ci = mode_p(examined, member, (share, low, high))
        first = min(sample[member].tolist(), key=rank.__getitem__)
        found.append(
            Cause(
                cause=kind,
                name=LAPSES[kind],
                events=int(member.sum()),
                share=share,
                share_ci=(low, high),
                p=p,
                ci=ci,
                rank=rank[first],
                story=story_of(events, examined.reruns[first]),
            )
        )
    return sorted(found, key=lambda c: (-c.share, c.cause))


def sample_modes(examined: Examined, modes: dict[int, str], rank: dict[int, int]) -> list[Mode]:
    """The modes of the sample, the largest share first.

    rank: of each position in the order asked for
    """
    events, sample = examined.events, examined.sample
    names = np.array([modes[i] for i in sample.tolist()])
    found = []
    for mode in sorted(set(names.tolist())):
        member = names == mode
        mine, weight = sample[member], events.weight[sample[member]]
        share, low, high = mode_share(examined, member)
        p, ci = mode_p(examined, member, (share, low, high))
        again = [examined.reruns[i] for i in mine.tolist()]
        agreeing = np.array([alone(a) == ("other" if mode.startswith("other-") else mode) for a in again])
        first = min(mine.tolist(), key=rank.__getitem__)
        found.append(
            Mode(
                mode=mode,
                name=mode_name(mode),
                typical=typical([a.motion for a in again if a.motion is not None], weight),
                events=int(member.sum()),
                share=share,
                share_ci=(low, high),
                p=p,
                ci=ci,
                agreement=float(weight[agreeing].sum() / weight.sum()),
                example=failure_of(events, first, examined.reruns[first], rank[first], mode),
            )
        )
    return sorted(found, key=lambda m: (-m.share, m.mode))


def mode_share(examined: Examined, member: np.ndarray) -> tuple[float, float, float]:
    """What part of p the sample's members (n, bool) have, with its interval."""
    events, sample = examined.events, examined.sample
    sure = events.record.estimate.confidence
    if events.replication is None or events.replicated is None:
        return share_interval(member, events.share[sample], sure)
    return replicated_share(member, events.share[sample], events.replication[sample], events.replicated, sure)


def share_within(examined: Examined, member: np.ndarray, whole: np.ndarray) -> tuple[float, float, float]:
    """What part the sample's members (n, bool) have of the p of `whole` (n, bool), which holds them, with its
    interval."""
    events, sample = examined.events, examined.sample[whole]
    sure = events.record.estimate.confidence
    if events.replication is None or events.replicated is None:
        return share_interval(member[whole], events.share[sample], sure)
    every = examined.sample
    of_whole = replicated_parts(whole, events.share[every], events.replication[every], events.replicated)
    return replicated_share(member[whole], events.share[sample], events.replication[sample], of_whole, sure)


def mode_p(
    examined: Examined, member: np.ndarray, share: tuple[float, float, float]
) -> tuple[float, tuple[float, float]]:
    """p of the mode of the sample's members (n, bool), with its interval."""
    events, sample = examined.events, examined.sample
    estimate = events.record.estimate
    if events.replication is not None and events.replicated is not None:
        parts = replicated_parts(member, events.share[sample], events.replication[sample], events.replicated)
        found = replicated_p(parts, estimate.confidence)
        return found or (0.0, (0.0, share[2] * estimate.ci[1]))
    if isinstance(estimate, ce.ReplicatedEstimate):  # no event at all
        return 0.0, (0.0, estimate.ci[1])
    part = mode_estimate(estimate, events.rows[sample[member]], known_rows(examined))
    low, high = part.ci
    return part.p, (low, min(high, max(estimate.ci[1], part.p)))


def mean_p(examined: Examined, value: np.ndarray) -> tuple[float, tuple[float, float]]:
    """p times the mean of a value between 0 and 1 of the sample's rollouts (n,), with its interval: the probability of
    an event that comes with that probability once the rollout is as it is."""
    events, sample = examined.events, examined.sample
    estimate = events.record.estimate
    if events.replication is not None and events.replicated is not None:
        parts = replicated_means(value, events.share[sample], events.replication[sample], events.replicated)
        return replicated_p(parts, estimate.confidence) or (0.0, (0.0, estimate.ci[1]))
    if isinstance(estimate, ce.ReplicatedEstimate):  # no event at all
        return 0.0, (0.0, estimate.ci[1])
    some = value > 0.0
    part = mean_estimate(estimate, events.rows[sample[some]], value[some], known_rows(examined))
    low, high = part.ci
    return part.p, (low, min(high, max(estimate.ci[1], part.p)))


def known_rows(examined: Examined) -> int:
    """Estimation rollouts, from the first on, whose modes are all known."""
    events, n = examined.events, examined.sample.size
    return events.record.estimate.f.size if n == len(events) else int(events.rows[n])


def same_bits(a: float, b: float) -> bool:
    return struct.pack("<d", a) == struct.pack("<d", b)
