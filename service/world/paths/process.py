"""The paths of one scenario with a compiled ego, as `ce` asks for them (`ce.paths`)."""

import numpy as np

import ce
from policies.drivers import DriverModel
from service.errors import InputError
from service.world.paths.begin import begin, layout_of
from service.world.paths.drive import drive_all
from service.world.paths.features import features_of
from service.world.paths.level import climbed_of, lower_nearest
from service.world.paths.lineage import draw_of
from service.world.paths.noise import constants_of
from service.world.paths.states import States, empty_states
from service.world.safety.contact import contact_of
from service.world.safety.contact_numbers import NUMBERS, numbers_of
from service.world.scenario.base import base_distribution
from service.world.scenario.causes import GRID
from service.world.scenario.noise import PathNoise
from service.world.scenario.schema import Scenario
from service.world.sim import step
from service.world.sim.latent import Latent
from service.world.sim.segment import IMPACT
from service.world.sim.without_sumo import MEASURES, WithoutSumo, can_leave_out_sumo, compiled_egos
from sumo_nets.corridor import Corridor

CHECKPOINT_S = 0.5  # between checkpoints


def check_paths(scenario: Scenario, ego: str) -> None:
    """InputError, by name, where the rollouts of a scenario with this ego cannot be driven as paths."""
    if scenario.drivers.noise_mode != "drawn":
        raise InputError(
            f"paths draw the drivers' noise on the way, and scenario {scenario.name} has noise_mode "
            f'"{scenario.drivers.noise_mode}"; give --noise-mode drawn, or another method'
        )
    if not can_leave_out_sumo(scenario, ego):
        raise InputError(
            f"paths need states that can be copied, which scenario {scenario.name} with ego {ego!r} has not: what has "
            f"them are the compiled egos ({', '.join(compiled_egos())}), with the measures {' and '.join(MEASURES)}, "
            "without background traffic; give another method"
        )


class HighwayPaths:
    """The paths of one scenario; checkpoints: steps at which paths are looked at, 0 first, the horizon last."""

    starts_without_normals = True  # features of a start do not depend on the drivers' weights xi

    def __init__(
        self,
        scenario: Scenario,
        corridor: Corridor,
        drivers: DriverModel,
        ego: str,
        checkpoint_s: float = CHECKPOINT_S,
    ):
        """InputError where the scenario or the ego needs SUMO."""
        check_paths(scenario, ego)
        self._scenario = scenario
        self._alone = WithoutSumo(scenario, corridor, drivers, ego)
        self._has_contacts = self._alone.parts.measure == IMPACT
        self._layout = layout_of(scenario)
        self._latent = None if scenario.human is None else Latent(scenario)
        self._constants = constants_of(scenario, self._latent)
        self.base: ce.Product = base_distribution(scenario, drivers)
        every = max(round(checkpoint_s / scenario.time.step_s), 1)
        self.checkpoints: tuple[int, ...] = (*range(0, scenario.steps, every), scenario.steps)

    def begin(self, x: np.ndarray, seeds: np.ndarray) -> States:
        """The states at step 0 of draws x (n, d); a compiled ego takes nothing from the seeds (n,)."""
        s = empty_states(len(x), len(self._scenario.vehicles), self._scenario.human is not None)
        parts = self._alone.parts
        begin(
            np.ascontiguousarray(x, dtype=np.float64), self._layout, *parts.road, parts.measure, GRID, s.agents,
            s.observations, s.minds, s.causes, s.heads, s.smallest, s.status,
        )  # fmt: skip
        self._look(s)
        return s

    def _look(self, states: States) -> None:
        if self._has_contacts:
            lower_nearest(states, self._layout.ego, self._alone.parts.road[2])

    def measure(self, states: States) -> np.ndarray:
        """The smallest value so far (n,)."""
        return states.smallest

    def level(self, states: States) -> np.ndarray:
        """What leads to a contact (n,), where the measure tells contacts; the measure elsewhere."""
        return climbed_of(states) if self._has_contacts else states.smallest

    def alive(self, states: States) -> np.ndarray:
        """Which go on (n,)."""
        running = (states.status == step.RUNNING) & ~np.isnan(states.smallest)
        return np.asarray(running & (states.at < self._scenario.steps))

    def steps(self, states: States) -> np.ndarray:
        """Steps of the segment last driven (n,)."""
        return states.driven

    def outcomes(self, states: States) -> np.ndarray:
        """How each stands (n,), as `service.world.sim.step` has it."""
        return states.status

    def finals(self, states: States, rows: np.ndarray) -> np.ndarray:
        """The ego's contact in each of these (k, NUMBERS), as `service.world.safety.contact_numbers` has it."""
        told = np.full((len(rows), NUMBERS), np.nan)
        for i, row in enumerate(rows.tolist()):
            if states.status[row] == step.COLLIDED:
                agents = states.agents[row]
                told[i] = numbers_of(contact_of(agents, len(agents), self._layout.ego))
        return told

    def features(self, states: States) -> np.ndarray:
        """(n, other vehicles, FEATURES) float32."""
        parts = self._alone.parts
        return features_of(
            states, self._layout.ego, parts.ego, parts.network, parts.road[2], self._scenario.time.step_s
        )

    def take(self, states: States, rows: np.ndarray) -> States:
        """Copies of these rows."""
        return states.take(rows)

    def advance(self, states: States, keys: np.ndarray, until: int) -> States:
        """The states at step `until`, or where they ended before; the noise of each is a function of its key alone."""
        s = states.take(np.arange(len(states)))
        parts = self._alone.parts
        drive_all(
            np.ascontiguousarray(keys, dtype=np.uint64), until, self._layout.ego, parts.ego, parts.network, parts.road,
            self._constants, self._scenario.time.step_s, parts.measure, parts.traits, s.agents, s.observations, s.minds,
            s.noise, s.causes, s.heads, s.smallest, s.status, s.at, s.driven,
        )  # fmt: skip
        self._look(s)
        return s

    def drawn(self, x: np.ndarray, seed: int, keys: np.ndarray) -> tuple[np.ndarray, PathNoise]:
        """The draw and the noise of a whole path, for any world to drive.

        x (d,), seed: of its root
        keys: (segments,) uint64 of its segments, 0 where it had ended before
        """
        own = [int(k) for k in keys[: max(np.count_nonzero(keys), 1)]]
        noise = PathNoise(seed, self.checkpoints[: len(own)], tuple(own))
        return draw_of(self._scenario, self._layout, self._latent, self._constants, x, noise), noise
