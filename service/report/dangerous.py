"""The most dangerous rollouts: which they are, and what happened in them, by running them once more."""

import multiprocessing
import struct
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

import msgspec
import numpy as np

from service import agents as A
from service.job import Job, Problem
from service.record import JobRecord
from service.safety.ttc import ego_time_to_collision
from service.sensors.lidar import beam_directions
from service.sim.rollout import Simulator
from service.trace import Trace, record


@dataclass(frozen=True)
class Ranked:
    """An estimation rollout with f <= gamma: row `row` of its job's estimation stream.

    log_likelihood: log p0(x), nats; weight: p0(x) over the proposal's density (1 for naive Monte Carlo); share: of
    the estimate that this rollout carries.
    """

    record: JobRecord
    rank: int  # 1 is the first
    row: int
    x: np.ndarray
    noise: int
    f: float
    log_likelihood: float
    weight: float
    share: float


@dataclass(frozen=True)
class Retold:
    """A ranked rollout, run once more.

    trace: None where the run failed, for which `error` has the reason; threat: the vehicle that the smallest time to
    collision is to, a row of the scenario's vehicles, None where it is background traffic; same: f came out the same
    to the bit as on record.
    """

    ranked: Ranked
    trace: Trace | None
    threat: int | None
    same: bool
    error: str | None


def pick(records: Sequence[JobRecord], total: int) -> list[Ranked]:
    """At most `total` events of the run, as evenly from its jobs as they have them, best rank first."""
    counts = [0] * len(records)
    left = total
    while left > 0 and any(c < r.event_rows.size for c, r in zip(counts, records, strict=True)):
        for i, job_record in enumerate(records):
            if left > 0 and counts[i] < job_record.event_rows.size:
                counts[i] += 1
                left -= 1
    return [r for job_record, n in zip(records, counts, strict=True) for r in ranked(job_record, n)]


def ranked(job_record: JobRecord, count: int) -> list[Ranked]:
    """The first `count` events: of naive Monte Carlo by f, the lowest first; of a proposal by what they add to p.

    That is their likelihood under P0 over that under the proposal. The likelihood under P0 itself (the paper's
    order) is given beside it; in hundreds of dimensions it mostly tells how close driver weights that hardly
    matter are to their mean.
    """
    estimate, rows = job_record.estimate, job_record.event_rows
    f = estimate.f[rows]
    log_weights = np.zeros(rows.size) if estimate.log_weights is None else estimate.log_weights[rows]
    weights = np.exp(log_weights)
    key = f if estimate.log_weights is None else -log_weights
    found = []
    for rank, i in enumerate(np.lexsort((rows, key))[:count].tolist(), start=1):
        row = int(rows[i])
        x, noise = job_record.redraw("estimate", job_record.estimate_iteration, row)
        found.append(
            Ranked(
                job_record,
                rank,
                row,
                x,
                noise,
                float(f[i]),
                float(job_record.event_log_likelihood[i]),
                float(weights[i]),
                float(weights[i] / weights.sum()),
            )
        )
    return found


def rerun(chosen: Sequence[Ranked]) -> list[Retold]:
    """Run the chosen rollouts once more, in a process of their own (SUMO allows one simulation a process)."""
    worlds: dict[bytes, list[int]] = {}
    for i, r in enumerate(chosen):
        job = r.record.job
        worlds.setdefault(msgspec.msgpack.encode((job.scenario, job.ego, job.weights_sha256)), []).append(i)
    retold: dict[int, Retold] = {}
    for members in worlds.values():
        with ProcessPoolExecutor(
            1,
            multiprocessing.get_context("spawn"),
            initializer=_open,
            initargs=(chosen[members[0]].record.job,),
        ) as pool:
            for i in members:
                retold[i] = _rerun_one(pool, chosen[i])
    return [retold[i] for i in range(len(chosen))]


def _rerun_one(pool: ProcessPoolExecutor, r: Ranked) -> Retold:
    try:
        trace, threat = pool.submit(_record, r.x, r.noise).result()
    except BrokenProcessPool:
        return Retold(r, None, None, False, "the process that ran it, or one before it, died")
    if trace.rollout.error is not None:
        return Retold(r, None, None, False, trace.rollout.error)
    return Retold(r, trace, threat, _same_bits(trace.rollout.f, r.f), None)


_problem: Problem | None = None
_simulator: Simulator | None = None  # of the child process


def _open(job: Job) -> None:
    global _problem, _simulator
    _problem = Problem(job)
    _simulator = _problem.simulator()


def _record(x: np.ndarray, noise: int) -> tuple[Trace, int | None]:
    assert _problem is not None
    assert _simulator is not None
    trace = record(_problem, _simulator, x, noise)
    return trace, _threat(trace, _problem.job.scenario.safety.rays)


def _threat(trace: Trace, rays: int) -> int | None:
    """The vehicle whose time to collision alone is the smallest of the rollout; None if no controlled one's is."""
    if not trace.ttc_s.size:
        return None
    k = int(np.argmin(trace.ttc_s))
    directions = beam_directions(rays)
    for i in range(len(trace.names)):
        if i == trace.ego or trace.agents[k, i, A.ACTIVE] == 0.0:
            continue
        pair = np.ascontiguousarray(trace.agents[k, [trace.ego, i]])
        ttc_s = ego_time_to_collision(pair, 2, 0, directions, np.empty(rays), np.empty(rays))
        if ttc_s == trace.ttc_s[k]:
            return i
    return None


def _same_bits(a: float, b: float) -> bool:
    return struct.pack("<d", a) == struct.pack("<d", b)
