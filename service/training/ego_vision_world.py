"""Where the vision ego learns: states on I-80 to look at, and drives in our world without SUMO."""

from dataclasses import dataclass

import numpy as np

from policies import layout
from policies.columns import Columns
from policies.drivers import load_drivers
from policies.egos.protocol import EgoPolicy, Observation
from service.errors import InputError
from service.training.demonstrator import NOTHING, avoid
from service.training.world import standard_starts
from service.world import agents as A
from service.world.camera import Camera, Scene, Weather, build_scene, poses_of, weather_of
from service.world.camera.start import first_draw
from service.world.scenario import Scenario, load_scenario
from service.world.scenario.base import base_distribution, unpack
from service.world.scenario.check import check_road
from service.world.sim import step
from service.world.sim.human import traits_of
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.world import DriverNetwork, World, action_noise

VEHICLES = 6
SCENARIOS = ("i80-paper-10s", "i80-paper-data")
# the widest weather that is learned from: half of the pictures are drawn evenly from it, the others as
# i80-paper-data draws them
LOW = (-20.0, 0.0, 0.1, -12.0, -1.5)
HIGH = (78.0, 360.0, 45.0, 18.0, 1.5)
WEATHER_KINDS: dict[str, Weather] = {
    "clear day": Weather(45.0, 215.0, 0.15, 0.0, 0.0),
    "low sun ahead": Weather(6.0, 345.0, 0.3, 0.0, 0.0),
    "dusk": Weather(-3.0, 300.0, 0.3, 0.0, 0.0),
    "night": Weather(-16.0, 0.0, 0.2, 0.0, 0.0),
    "fog, 200 m": Weather(35.0, 200.0, 19.5, 0.0, 0.0),
    "fog at night, 130 m": Weather(-16.0, 0.0, 30.0, 0.0, 0.0),
    "rain, 8 mm/h": Weather(30.0, 200.0, 0.5, 8.0, 0.0),
    "rain at night, 8 mm/h": Weather(-16.0, 0.0, 0.5, 8.0, 0.0),
}


@dataclass(frozen=True)
class States(Columns):
    """n moments: poses (n, 6, 6) of all vehicles, the row that looks (n,), what it perceives (n, 51), and what avoiding
    conflicts asks of it (n, 2) (service.training.demonstrator)."""

    poses: np.ndarray
    own: np.ndarray
    seen: np.ndarray
    avoidance: np.ndarray


@dataclass(frozen=True)
class Drive:
    """What became of an ego's drive: how it ended (service.world.sim.step), offsets and speeds (steps,), moments."""

    status: int
    offset_m: np.ndarray
    speed_mps: np.ndarray
    states: States


class VisionWorld:
    """The road, the drivers and the camera of the built-in scenarios."""

    def __init__(self, drivers: str, scenarios: tuple[str, str] = SCENARIOS, attentive: bool = True):
        """Open the drives of these scenarios, the second one with weather.

        attentive: whether conflicts are avoided
        """
        self.names, self.attentive = scenarios, attentive
        self.scenarios: dict[str, Scenario] = {name: load_scenario(name) for name in scenarios}
        scenario = self.scenarios[scenarios[0]]
        self.corridor = check_road(scenario, scenario.name)
        self.model = load_drivers(drivers)
        self.base = {name: base_distribution(s, self.model) for name, s in self.scenarios.items()}
        self.ego = scenario.ego
        self.world = World(
            road_of(self.corridor),
            DriverNetwork.of(self.model),
            VEHICLES,
            self.ego,
            scenario.time.step_s,
            traits=traits_of(scenario),
        )
        if len({one.human is None for one in self.scenarios.values()}) == 2:
            raise InputError(
                f"scenarios {' and '.join(scenarios)}: human drivers in both or in neither are needed"
            )
        self.scene: Scene = build_scene(self.corridor)
        self.camera = Camera(scenario.camera)

    def weather(self, rng: np.random.Generator) -> Weather:
        """A weather to learn from."""
        if rng.random() < 0.5:
            return weather_of(self.scenarios[self.names[1]], self._draw(self.names[1], rng))
        return Weather(*rng.uniform(LOW, HIGH).tolist())

    def scattered(self, count: int, rng: np.random.Generator) -> States:
        """Moments with every vehicle anywhere: in its lane or beside it, turned, slow or fast; all of them look."""
        parts: list[States] = []
        while sum(len(part) for part in parts) < count:
            agents = standard_starts(rng, self.world.road, VEHICLES, wide=True)
            agents[:, A.X_M : A.Y_M + 1] += rng.normal(0.0, 0.35, (VEHICLES, 2))
            agents[:, A.HEADING_RAD] += rng.normal(0.0, 0.02, VEHICLES)
            long = rng.random(VEHICLES) < 0.15
            agents[long, A.LENGTH_M] = rng.uniform(5.6, 14.0, int(long.sum()))
            agents[long, A.WIDTH_M] = rng.uniform(2.1, 2.5, int(long.sum()))
            self._put(agents)
            self.world.observe()
            seen = self.world.observations.copy()
            poses = poses_of(self.world.agents)
            if not np.isfinite(poses).all():  # one of them stands where its lane has ended
                continue
            good = np.flatnonzero((seen[:, layout.INCIDENT] == 0.0) & (agents[:, A.LENGTH_M] < 5.6))
            avoidance = np.array([self._avoidance(row) for row in good.tolist()]).reshape(-1, 2)
            parts.append(States(np.repeat(poses[None], len(good), 0), good, seen[good], avoidance))
        return States.joined(parts)

    def pictures(
        self, states: States, rows: np.ndarray, rng: np.random.Generator, weathers: int = 4
    ) -> np.ndarray:
        """Pictures (n, h, w, 3) of the states in `rows`, in `weathers` weathers drawn anew."""
        made = []
        for part in np.array_split(rows, weathers):
            weather = self.weather(rng)
            for row in part.tolist():
                seed = int(rng.integers(2**31))
                made.append(
                    self.camera.render(self.scene, states.poses[row], int(states.own[row]), weather, seed)
                )
        return np.array(made)

    def drive(self, ego: EgoPolicy, weather: Weather, scenario: str, steps: int, rng: np.random.Generator,
              sway: float = 0.0, every: int = 0) -> Drive:  # fmt: skip
        """Let `ego` drive a draw of the scenario; `sway` disturbs its actions, every `every`-th moment is kept."""
        world = self.world
        drawn, x = self.scenarios[scenario], self._draw(scenario, rng)
        human = drawn.human is not None
        if human:
            seed = int(rng.integers(2**31))
            _, happens = Draw(drawn).begin(world, x, seed)
            steps = min(steps, len(happens))
        else:
            world.reset(*unpack(drawn, x))
        if sway:
            world.agents[self.ego, A.HEADING_RAD] += rng.normal(0.0, 0.02)
            world.agents[self.ego, A.SPEED_MPS] = rng.uniform(6.0, 24.0)
        if not human:  # drives may last longer than the scenario
            seed = int(rng.integers(2**31))
            happens = action_noise(seed, steps, VEHICLES)
        ego.reset(seed)
        status, _ = world.observe()
        observation = Observation(world.observations[self.ego], 0.0)
        offset, speed, kept = [], [], []
        push = np.zeros(2)
        for k in range(steps):
            if status != step.RUNNING:
                break
            poses = poses_of(world.agents)
            observation.frame = self.camera.render(self.scene, poses, self.ego, weather, seed, k)
            if every and k % every == 0:
                kept.append((poses, world.observations[self.ego].copy(), self._avoidance(self.ego)))
            offset.append(world.agents[self.ego, A.LANE_OFFSET_M])
            speed.append(world.agents[self.ego, A.SPEED_MPS])
            action = ego.act(observation)
            if sway:
                push = 0.9 * push + rng.normal(0.0, sway, 2) * (0.5, 0.012)
            world.advance(action[0] + push[0], action[1] + push[1], happens[k])
            status, _ = world.observe()
        states = States(
            np.array([poses for poses, _, _ in kept]).reshape(-1, VEHICLES, 6),
            np.full(len(kept), self.ego),
            np.array([seen for _, seen, _ in kept]).reshape(-1, layout.OBSERVATION_SIZE),
            np.array([avoidance for _, _, avoidance in kept]).reshape(-1, 2),
        )
        return Drive(status, np.array(offset), np.array(speed), states)

    def _avoidance(self, own: int) -> tuple[float, float]:
        if not self.attentive:
            return NOTHING
        return avoid(self.world.agents[:VEHICLES], own, self.world.road.spacing_m)

    def _put(self, agents: np.ndarray) -> None:
        self.world.reset([], np.zeros(layout.HEAD_SIZE))
        self.world.agents[:VEHICLES] = agents

    def _draw(self, scenario: str, rng: np.random.Generator) -> np.ndarray:
        return first_draw(self.base[scenario], int(rng.integers(2**31)))
