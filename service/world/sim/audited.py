"""Rollouts as one compiled call, of which those that matter and a share of the others are driven in SUMO too.

SUMO stays the reference: a rollout that it drives must have the bits that the compiled one has.
"""

from collections.abc import Callable

import numpy as np

from service.closing import Closing
from service.errors import SimulationError
from service.world.scenario.noise import Noise
from service.world.sim.rollout import Rollout, Simulator
from service.world.sim.without_sumo import WithoutSumo

# Of the rollouts that are no event, one of so many, chosen by its noise seed, is driven in SUMO too.
EVERY = 100
EVENTS = 4  # of the events in a chunk, the first so many are all driven in SUMO
EVERY_EVENT = 10  # of its further events, one of so many, chosen by its noise seed


class Audited(Closing):
    """Runs rollouts without SUMO, and those that matter in both worlds; use as a context manager.

    Which ones depends on their place in the chunk, their f and noise seed alone, so that a run that is repeated audits
    the same.
    """

    def __init__(self, alone: WithoutSumo, open_simulator: Callable[[], Simulator], gamma: float):
        """Begin with no rollout.

        alone: runs every rollout, without SUMO
        open_simulator: opens SUMO's world, when it is first needed
        gamma: threshold of the event f <= gamma, in the measure's unit
        """
        self._alone, self._open, self._gamma = alone, open_simulator, gamma
        self._simulator: Simulator | None = None
        self._events = 0
        self.in_sumo = 0

    def close(self) -> None:
        if self._simulator is not None:
            self._simulator.close()

    def begin_chunk(self) -> None:
        """The rollouts that come now are of a new chunk."""
        self._events = 0

    def run(self, x: np.ndarray, noise_seed: Noise) -> Rollout:
        """The rollout of `x` (d,); SimulationError where the two worlds differ in a bit."""
        rollout = self._alone.run(x, noise_seed)
        if self._matters(rollout.f, int(noise_seed)):
            self._compare(rollout, x, noise_seed)
        return rollout

    def _matters(self, f: float, noise_seed: int) -> bool:
        if not f <= self._gamma:  # a failed rollout, whose f is NaN, is compared like any other
            return noise_seed % EVERY == 0
        self._events += 1
        return self._events <= EVENTS or noise_seed % EVERY_EVENT == 0

    def _compare(self, rollout: Rollout, x: np.ndarray, noise_seed: Noise) -> None:
        if self._simulator is None:
            self._simulator = self._open()
        again = self._simulator.run(x, noise_seed)
        self.in_sumo += 1
        same = np.array_equal(again.f, rollout.f, equal_nan=True)
        same = same and (again.outcome, again.steps, again.contact) == (
            rollout.outcome,
            rollout.steps,
            rollout.contact,
        )
        if not same:
            raise SimulationError(
                f"the rollout with noise seed {noise_seed} came to f = {rollout.f!r} ({rollout.outcome}, "
                f"{rollout.steps} steps) without SUMO and to f = {again.f!r} ({again.outcome}, {again.steps} steps) "
                "with it: they must be the same to the bit. Run with --in-sumo all, and report this"
            )
