"""The method for paths behind an ask-and-tell interface: a pilot that trains a committor, then independent batches.

    round 0     naive paths; their lowest values give the first levels, their states the first lessons
                -> naive paths to the end where at least COMMON of them are events
    round r     paths kept, split and ended by what was learned, aimed at the lowest level with enough hits
                -> the estimate once gamma has been reached twice with a fifth of the budget spent, or with the
                   training's share of it
    estimate    batches of one size with everything fixed; no path of the pilot enters

A batch is a pure function of the problem, the plan and its roots: any part of it may be driven elsewhere.
"""

import functools
import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.checks import checked_problem
from ce.codec import digest_of, from_bytes, to_bytes
from ce.errors import ResponseError, StateError
from ce.paths.levels import ENOUGH_HITS, ladder, reached, to_label
from ce.paths.network import NetworkCommittor
from ce.paths.path_estimate import PathEstimate
from ce.paths.path_options import PathOptions
from ce.paths.path_state import (
    POOLED,
    Falls,
    PathBatch,
    PathState,
    PathTotals,
    Round,
    Sample,
    joined_samples,
    pooled,
    result,
)
from ce.paths.plan import Committor, schedule
from ce.paths.process import Process
from ce.paths.simulator import checked_checkpoints
from ce.paths.starts import all_starts, kept_starts, reference_features
from ce.paths.training import lessons, trained, untrained
from ce.paths.tree import Driven, Fallen, seen_by
from ce.streams import checked_seed

Array = NDArray[np.float64]

# Steps and rates of the first training, of the later ones and of the last.
FIRST_TRAINING, LATER_TRAINING, LAST_TRAINING = (1000, 4e-3), (800, 3e-3), (3000, 4e-3)
# Share of the budget that the pilot takes at least: what the committor learns more pays for itself.
LEAST_TRAINING = 0.2
# Starts by which E0 L_b is known, and the stream of the pilot that has them.
REFERENCE_STARTS, REFERENCE_STREAM = 20_000, 1_000_000
# Paths of a batch of the estimate in the middle of the horizon; more budget makes more batches.
POPULATION = 400.0
# Of what the pilot leaves, to be planned for.
PLANNED = 0.92
# Naive paths are fewer by this where a committor is given and not trained on.
SHARE_OF_NAIVE = 4
# Aimed rounds with a committor that was given: the first tells how many paths to plan for, the second what they cost.
GIVEN_ROUNDS = 2
# Share of events among the naive paths from which nothing else is driven.
COMMON = 0.2
# Enough hits, this many times, end the pilot.
TWICE = 2


class PathSampling:
    """The method for paths as pure functions of a frozen `PathState`.

    process: the simulator
    gamma: threshold of the event, in the unit of its measure
    options: of the method
    committor: fixed beforehand, as an earlier run has trained it; None to train one. It must not know of this run's
        paths.
    """

    method = "paths"

    def __init__(
        self,
        process: Process[Any],
        gamma: float,
        options: PathOptions | None = None,
        committor: Committor | None = None,
    ) -> None:
        self.process, self.options, self.given = process, options or PathOptions(), committor
        self.base, self.gamma = checked_problem(process.base, gamma)
        self.checkpoints = checked_checkpoints(process.checkpoints)

    @functools.cached_property
    def digest(self) -> str:
        """Of the problem, the options and the committor that was given: a state belongs to one digest."""
        known = getattr(self.given, "checksum", None if self.given is None else type(self.given).__name__)
        return digest_of(self.base, self.method, self.gamma, self.checkpoints, self.options, known)

    @property
    def horizon(self) -> int:
        """Steps of a whole path."""
        return self.checkpoints[-1]

    @property
    def _trains(self) -> bool:
        return self.given is None or self.options.train_on

    def init(self, seed: int = 0) -> PathState:
        """The state before any path."""
        own = self.given if isinstance(self.given, NetworkCommittor) else None
        if self.options.train_on and own is None:
            raise StateError(
                "train_on needs a committor of ce.paths.NetworkCommittor, as a run has trained it"
            )
        return PathState(self.digest, checked_seed(seed), committor=own)

    def committor(self, state: PathState) -> Committor | None:
        """The committor that the state's plan is for."""
        return self.given if self.given is not None and not self.options.train_on else state.committor

    def propose(self, state: PathState) -> PathBatch | None:
        """The next paths; None when finished."""
        if state.phase == "done":
            return None
        levels = np.array([self.gamma])
        if state.plan is None:
            pilot = state.phase == "pilot"
            count = self._naive_paths() if pilot else state.starts
            phase = "train" if pilot else "estimate"
            roots = all_starts(self.process, state.seed, phase, state.iteration, count)
            return PathBatch(phase, state.iteration, roots, count, levels, pilot, None, None)
        phase = "train" if state.phase == "pilot" else "estimate"
        committor = self.committor(state)
        assert committor is not None
        roots = kept_starts(
            self.process, committor, state.plan, state.seed, phase, state.iteration, state.starts
        )
        own = committor if isinstance(committor, NetworkCommittor) else None
        record = phase == "train"
        return PathBatch(phase, state.iteration, roots, state.starts, levels, record, state.plan, own)

    def update(self, state: PathState, batch: PathBatch, driven: Driven) -> tuple[PathState, PathTotals]:
        """The state after its batch was driven, and what came of it."""
        expected = ("train" if state.phase == "pilot" else "estimate", state.iteration)
        if state.phase == "done" or (batch.phase, batch.iteration) != expected:
            raise StateError(
                f"the batch {(batch.phase, batch.iteration)} does not answer this state, which expects {expected}"
            )
        if driven.steps.size != batch.roots.size:
            raise ResponseError(
                f"{batch.roots.size} roots were to be driven, the answer has {driven.steps.size}"
            )
        answered = self._learned if state.phase == "pilot" else self._estimated
        return answered(state, batch, driven), result(batch, driven, self.gamma)

    def estimate(self, state: PathState) -> PathEstimate:
        """The estimate so far; p is NaN during the pilot."""
        return state.estimate(self.base, self.gamma, self.options.confidence, self.horizon)

    def to_bytes(self, state: PathState) -> bytes:
        """The state as MessagePack."""
        return to_bytes(state)

    def from_bytes(self, data: bytes) -> PathState:
        """The state that `to_bytes` wrote for the same problem, options and committor; StateError otherwise."""
        return from_bytes(data, PathState, self.digest)

    # -- the pilot -------------------------------------------------------------------------------------------

    def _learned(self, state: PathState, batch: PathBatch, driven: Driven) -> PathState:
        """The state after a round of the pilot."""
        made = result(batch, driven, self.gamma)
        state = msgspec.structs.replace(
            state,
            iteration=state.iteration + 1,
            steps=state.steps + made.steps,
            begun=state.begun + made.begun,
            training_steps=state.training_steps + made.steps,
            training_begun=state.training_begun + made.begun,
            failed=(*state.failed, *made.failed),
        )
        # The naive round's paths tell of nothing that the first aimed round's do not.
        earlier = state.falls if state.iteration > TWICE else ()
        falls = (*earlier, Falls(driven.fallen, batch.starts))[-POOLED:]
        all_falls = pooled(falls)
        low = reached(all_falls.fallen)
        aim = max(self.gamma, low if batch.plan is None else min(low, state.aim))
        this = Round(made, state.aim, aim, state.population)
        state = msgspec.structs.replace(state, falls=falls)
        if batch.plan is None:
            state = msgspec.structs.replace(state, naive_f=driven.value, naive_steps=made.steps)
        state = msgspec.structs.replace(state, aim=aim, rounds=(*state.rounds, this))
        if batch.plan is None and made.hits >= COMMON * batch.starts:
            return self._naive(state)
        if self._trains:
            state = self._trained(state, batch, driven)
        if not math.isfinite(aim) and self._trains:
            return self._finished_without(state)
        levels = ladder(all_falls.fallen, all_falls.starts, aim, self.gamma)
        if self._over(state):  # the estimate aims at gamma, whether the pilot has come there or not
            levels = np.append(levels[levels > self.gamma], self.gamma)
        if not self._trains:
            levels = state.plan.levels if state.plan else self._levels_by(state, driven.fallen)
        return self._planned(state, levels, self._over(state), batch, driven)

    def _trained(self, state: PathState, batch: PathBatch, driven: Driven) -> PathState:
        labelled = to_label(driven.fallen, self.gamma)
        if labelled.size == 0 or not driven.record:
            return state
        taught = (*state.lessons, lessons(driven.record, labelled, state.seed + state.iteration))
        committor = state.committor
        steps, rate = LAST_TRAINING if self._over(state) else LATER_TRAINING
        if committor is None or (self.given is None and self._over(state)):
            steps, rate = max(steps, FIRST_TRAINING[0]), FIRST_TRAINING[1]
            features = np.concatenate([r.features for r in driven.record])
            top = float(labelled[0]) if committor is None else committor.level_high
            committor = untrained(features, self.gamma, top, state.seed)
        committor = trained(committor, taught, steps, rate, state.seed + state.iteration)
        return msgspec.structs.replace(state, committor=committor, lessons=taught)

    def _over(self, state: PathState) -> bool:
        """Whether the pilot ends with this round."""
        o, rounds = self.options, state.rounds
        if not self._trains:
            return len(rounds) > min(GIVEN_ROUNDS, max(o.rounds, 1))
        there = rounds[-1].reached <= self.gamma
        hits = sum(r.totals.hits for r in rounds)
        stuck = len(rounds) > 5 and rounds[-1].reached >= rounds[-5].reached > self.gamma
        next_round = max((r.totals.steps for r in rounds[1:]), default=0)
        whole = o.budget * self._path_steps(state)
        spent = state.training_steps + next_round > o.training_share * whole
        enough = state.training_steps + next_round > LEAST_TRAINING * whole
        common = len(rounds) == 1 and hits >= TWICE * ENOUGH_HITS
        taught = there and hits >= TWICE * ENOUGH_HITS and enough
        return taught or stuck or spent or common or len(rounds) > o.rounds

    def _naive_paths(self) -> int:
        """Paths of the pilot's first round."""
        return self.options.naive if self._trains else max(self.options.naive // SHARE_OF_NAIVE, 25)

    def _naive(self, state: PathState) -> PathState:
        """The state before an estimate of naive paths: the event is too common for anything else to be worth it."""
        left = int(PLANNED * (self.options.budget - state.naive_f.size))
        batches = self.options.batches
        if left < batches:
            return msgspec.structs.replace(state, phase="done")
        return msgspec.structs.replace(
            state, phase="estimate", iteration=0, batches=batches, starts=left // batches, falls=()
        )

    def _path_steps(self, state: PathState) -> float:
        return state.naive_steps / max(state.naive_f.size, 1)

    def _levels_by(self, state: PathState, naive: Fallen) -> Array:
        """Levels of the importance by a committor that was given: where it holds them for as much more probable."""
        committor = self.committor(state)
        assert committor is not None
        top = reached(naive, 10)
        if not self.gamma < top < math.inf:
            return np.array([self.gamma])
        grid = np.linspace(top, self.gamma, 33)
        hazard = np.minimum(committor.log_hazard(self._reference(state.seed), grid), 0.0)
        p = np.exp(hazard).mean(axis=0)
        wanted = [int(np.argmin(np.abs(np.log(p) - np.log(p[-1] * ratio)))) for ratio in (40.0, 10.0, 3.0)]
        return np.append(np.unique(grid[[k for k in wanted if k < grid.size - 1]])[::-1], self.gamma)

    @functools.lru_cache(maxsize=1)  # noqa: B019 (one array; the algorithm outlives it anyway)
    def _reference(self, seed: int) -> NDArray[np.float32]:
        """Features of starts drawn from the base, of a stream of their own."""
        return reference_features(self.process, seed, REFERENCE_STREAM, REFERENCE_STARTS)

    # -- the estimate ----------------------------------------------------------------------------------------

    def _planned(
        self, state: PathState, levels: Array, final: bool, batch: PathBatch, driven: Driven
    ) -> PathState:
        """The state before the next round, or before the first batch of the estimate, as the last round's paths
        tell."""
        committor = self.committor(state)
        if committor is None:
            return self._finished_without(state)
        population, batches = self.options.population, 0
        if final:
            population, batches = self._sizes(state)
        starts = int(max(population * self.options.starts_a_path, 500))
        hazard = committor.log_hazard(self._reference(state.seed), levels)
        seen = seen_by(committor, levels, driven.record, batch.starts, self.gamma)
        plan = schedule(
            self.gamma, levels, hazard, self.checkpoints, starts, population, self.options.floor, seen
        )
        state = msgspec.structs.replace(state, plan=plan, starts=starts, population=population)
        if not final:
            return state
        return msgspec.structs.replace(
            state,
            phase="estimate" if batches else "done",
            iteration=0,
            batches=batches,
            lessons=(),
            falls=(),
        )

    def _sizes(self, state: PathState) -> tuple[float, int]:
        """Paths of a batch of the estimate, and batches, that what is left of the budget pays for."""
        whole = self._path_steps(state)
        left = PLANNED * (self.options.budget * whole - state.steps)
        sized = [r for r in state.rounds if r.population > 0.0][-2 if self._trains else -1 :]
        steps = sum(r.totals.steps for r in sized) / sum(r.population for r in sized) if sized else whole
        affordable = left / max(steps, 1.0)
        least = self.options.batches
        batches = max(least, int(affordable / POPULATION))
        return (affordable / batches, batches) if affordable >= least else (1.0, 0)

    def _estimated(self, state: PathState, batch: PathBatch, driven: Driven) -> PathState:
        """The state after a batch of the estimate."""
        made = result(batch, driven, self.gamma)
        over = state.iteration + 1 == state.batches
        return msgspec.structs.replace(
            state,
            iteration=state.iteration + 1,
            phase="done" if over else state.phase,
            steps=state.steps + made.steps,
            begun=state.begun + made.begun,
            failed=(*state.failed, *made.failed),
            sample=joined_samples(state.sample, Sample.of(batch, driven), state.iteration),
        )

    def _finished_without(self, state: PathState) -> PathState:
        """The state of a run whose pilot came to no level at all."""
        return msgspec.structs.replace(state, phase="done")
