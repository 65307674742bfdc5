"""Dangerous rollouts run again in worker processes: as they were, then with each reference driver from the onset on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from policies.egos import EgoPolicy
from policies.references import REFERENCES, reference_driver
from service.analysis.failures.motion import Motion, motion_of
from service.analysis.failures.rerun import Rerun
from service.analysis.prevention.onset import TTC_S, Onset, onset_of
from service.analysis.trace import Trace, record
from service.closing import Closing
from service.evaluation.job import Job, Problem
from service.evaluation.process_pool import DIED, NumberedParts, ProcessPool, of_lists
from service.evaluation.processes import context_for
from service.world.egos.handover import Handover
from service.world.egos.here import HERE
from service.world.egos.open import check_ego, open_ego
from service.world.egos.reference import ReferenceEgo
from service.world.scenario.noise import Noise
from service.world.sim.rollout import Rollout, Simulator

AT_ONCE = 4  # rollouts that a worker is given at once
Draw = tuple[np.ndarray, Noise]  # x (d,) and its noise
Part = tuple[int, Draw]  # number and draw


@dataclass(frozen=True)
class Conflict:
    """A dangerous rollout that was run again.

    f, outcome, error: as it was
    motion: as of `service.analysis.failures`
    onset: None where the rollout failed
    driven: what it came to with each reference driver, by name; empty where it failed
    traces: of these, where they were asked for
    """

    f: float
    outcome: str
    error: str | None
    motion: Motion | None = None
    onset: Onset | None = None
    driven: dict[str, Rollout] | None = None
    traces: dict[str, Trace] | None = None


def check_reference(name: str) -> None:
    """InputError for what is neither a reference driver nor an ego that this process can use."""
    if name not in REFERENCES:
        check_ego(name)


def reference_ego(name: str, problem: Problem) -> EgoPolicy:
    """A reference driver, or any other ego, by name."""
    scenario = problem.job.scenario
    if name in REFERENCES:
        return ReferenceEgo(reference_driver(name), scenario.time.step_s)
    return open_ego(name, scenario, problem.corridor)


class HandedOver(Closing):
    """A world for this process in which the job's ego can hand over; use as a context manager."""

    def __init__(self, problem: Problem, references: Sequence[str]):
        self.problem = problem
        self.references = tuple(references)
        self._wheel = Handover(problem.ego(), {name: reference_ego(name, problem) for name in references})
        self._simulator: Simulator = problem.simulator(ego=self._wheel)

    def close(self) -> None:
        """End the simulation."""
        self._simulator.close()

    def as_it_was(self, x: np.ndarray, noise_seed: Noise) -> Trace:
        """The rollout with the job's ego alone."""
        self._wheel.to(None)
        return record(self.problem, self._simulator, x, noise_seed)

    def driven_by(self, reference: str, step: int, x: np.ndarray, noise_seed: Noise) -> Rollout:
        """The rollout with the reference driver from step `step` on."""
        self._wheel.to(reference, step)
        return self._simulator.run(x, noise_seed)

    def trace_of(self, reference: str, step: int, x: np.ndarray, noise_seed: Noise) -> Trace:
        """The same, recorded."""
        self._wheel.to(reference, step)
        return record(self.problem, self._simulator, x, noise_seed)

    def look(self, x: np.ndarray, noise_seed: Noise, ttc_s: float, traced: bool = False) -> Conflict:
        """Run the rollout again: as it was, then with each reference driver; ttc_s: see `onset_of`."""
        trace = self.as_it_was(x, noise_seed)
        result = trace.rollout
        if result.error is not None:
            return Conflict(result.f, result.outcome, result.error)
        motion = motion_of(trace, self.problem.job.scenario.safety.rays, self.problem.corridor)
        onset = onset_of(trace, partner(trace, motion), ttc_s)
        if traced:
            traces = {name: self.trace_of(name, onset.step, x, noise_seed) for name in self.references}
            driven = {name: one.rollout for name, one in traces.items()}
            return Conflict(result.f, result.outcome, None, motion, onset, driven, traces)
        driven = {name: self.driven_by(name, onset.step, x, noise_seed) for name in self.references}
        return Conflict(result.f, result.outcome, None, motion, onset, driven)


def partner(trace: Trace, motion: Motion | None) -> int | None:
    """Row of the vehicle that the conflict is with: the one hit, else the one that the smallest value is to; None for
    background traffic."""
    contact = trace.rollout.contact
    if contact is not None:
        return contact.other if contact.other < len(trace.names) else None
    return None if motion is None else motion.other


class Conflicts(NumberedParts[Part, Conflict]):
    """Worker processes for one job, started when first needed; use as a context manager."""

    def __init__(
        self, job: Job, references: Sequence[str], ttc_s: float, workers: int = 1, traced: bool = False
    ):
        here = next((name for name in (job.ego, *references) if name.startswith(HERE)), job.ego)
        arguments = (job, tuple(references), ttc_s, traced)
        super().__init__(ProcessPool(workers, LOOKS, _open, arguments, lambda: context_for(here)))

    def look(
        self, drawn: Sequence[Draw], on_done: Callable[[int], None] = lambda count: None
    ) -> list[Conflict]:
        """Run the rollouts again, in order; on_done: told how many more."""
        return self._in_order(list(enumerate(drawn)), AT_ONCE, on_done)


def driven_by(job: Job, reference: str, x: np.ndarray, noise_seed: Noise, ttc_s: float = TTC_S) -> Rerun:
    """A rollout with a reference driver in the ego's place from the onset of its conflict on, traced.

    What the motion is about is as it was without it.
    """
    with Conflicts(job, (reference,), ttc_s, traced=True) as conflicts:
        (found,) = conflicts.look([(x, noise_seed)])
    if found.traces is None:
        return Rerun(found.f, found.outcome, found.error)
    trace = found.traces[reference]
    result = trace.rollout
    return Rerun(
        result.f, result.outcome, result.error, motion=found.motion, trace=trace, contact=result.contact
    )


_world: HandedOver | None = None  # of the worker process
_ttc_s, _traced = 0.0, False


def _open(job: Job, references: tuple[str, ...], ttc_s: float, traced: bool) -> None:
    global _world, _ttc_s, _traced
    _world, _ttc_s, _traced = HandedOver(Problem(job), references), ttc_s, traced


def _run(part: list[Part]) -> list[Conflict]:
    assert _world is not None
    return [_world.look(*draw, _ttc_s, _traced) for _, draw in part]


LOOKS = of_lists(_run, lambda part: Conflict(np.nan, "error", DIED))
