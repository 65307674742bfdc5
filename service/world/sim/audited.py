"""Rollouts without SUMO of which a share is run in SUMO too, and must have the same bits."""

import numpy as np

from service.closing import Closing
from service.errors import SimulationError
from service.world.scenario.noise import Noise
from service.world.sim.rollout import Rollout, Simulator
from service.world.sim.without_sumo import WithoutSumo

EVERY = 100  # one rollout of so many, chosen by its noise seed, is run in SUMO too


class Audited(Closing):
    """Runs rollouts without SUMO, and one of EVERY in both worlds; use as a context manager.

    Which ones depends on their noise seeds alone, so that a run that is repeated audits the same.
    """

    def __init__(self, alone: WithoutSumo, simulator: Simulator):
        self._alone, self._simulator = alone, simulator
        self.compared = 0

    def close(self) -> None:
        self._simulator.close()

    def run(self, x: np.ndarray, noise_seed: Noise) -> Rollout:
        """The rollout of `x` (d,); SimulationError where the two worlds differ in a bit."""
        rollout = self._alone.run(x, noise_seed)
        if int(noise_seed) % EVERY == 0:
            again = self._simulator.run(x, noise_seed)
            same = np.array_equal(again.f, rollout.f, equal_nan=True)
            same = same and (again.outcome, again.steps, again.contact) == (
                rollout.outcome,
                rollout.steps,
                rollout.contact,
            )
            if not same:
                raise SimulationError(
                    f"the rollout with noise seed {int(noise_seed)} came to f = {rollout.f!r} ({rollout.outcome}, "
                    f"{rollout.steps} steps) without SUMO and to f = {again.f!r} ({again.outcome}, {again.steps} "
                    "steps) with it: they must be the same to the bit. Run with --sumo, and report this"
                )
            self.compared += 1
        return rollout
