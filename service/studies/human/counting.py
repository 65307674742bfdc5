"""One rollout as the rates see it: the same, to the bit, as `service.world.sim.without_sumo` drives, with what happens
among the environment vehicles written down (`service.studies.human.watching`)."""

import numpy as np

from policies.drivers import DriverModel
from policies.egos import load_ego
from policies.egos.compiled import IDM, act
from policies.egos.lidar import LidarEgo
from policies.jit import kernel
from policies.layout import BEAMS, OUTPUTS
from service.errors import InputError
from service.studies.human.watching import EVENT, nothing_yet, watch
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M
from service.world.sim import step
from service.world.sim.human import advance_vehicles
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.step import observe
from service.world.sim.world import World
from sumo_nets.corridor import Corridor

MOST_EVENTS = 64  # contacts and near-crashes of one way to go on, that are kept


@kernel
def drive_and_watch(
    agents: np.ndarray, n: int, ego: int, ego_kind: int, ew1: np.ndarray, eb1: np.ndarray, ew2: np.ndarray,
    eb2: np.ndarray, ehead: np.ndarray, escale: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray,
    b2: np.ndarray, head: np.ndarray, scale: np.ndarray, noise: np.ndarray, dt_s: float, reference: np.ndarray,
    lanes: np.ndarray, spacing_m: float, beams: np.ndarray, rays: np.ndarray, observations: np.ndarray,
    poses: np.ndarray, minds: np.ndarray, traits: np.ndarray, pairs: np.ndarray, hurt: np.ndarray, history: np.ndarray,
    tallies: np.ndarray, events: np.ndarray, found: int, status: int, k: int, stop: int, moved: bool, halting: bool,
    agents_before: np.ndarray, minds_before: np.ndarray,
) -> tuple[int, int, int, bool]:  # fmt: skip
    """Drive on from the state after k steps, which has been watched, to that after `stop` steps at most.

    noise: (steps, vehicles, 2 or 4), as `service.world.sim.without_sumo` has it
    pairs ... found: see `service.studies.human.watching.watch`
    status: how the rollout stands (`service.world.sim.step`)
    moved: the vehicles have made their next step already, and only have to be watched
    halting: stop as soon as a step has suppressed a glance that would have begun in a conflict; `agents_before` and
        `minds_before` then hold the state before that step, and `moved` is how to go on
    Returns how the rollout stands, its steps, its events and whether it has halted.
    """
    outputs = np.empty(OUTPUTS, np.float32)
    while True:
        if not moved:
            if status != step.RUNNING or k >= stop:
                return status, k, found, False
            acceleration, turn_rate = act(
                ego_kind, observations[ego], ew1, eb1, ew2, eb2, ehead, escale, outputs
            )
            if halting:
                agents_before[:] = agents
                minds_before[:] = minds
            advance_vehicles(
                agents, n, n, ego, acceleration, turn_rate, observations, w1, b1, w2, b2, head, scale, noise[k],
                dt_s, reference, lanes, spacing_m, minds, traits, poses,
            )  # fmt: skip
            if halting:
                for i in range(n):
                    if minds[i, M.RESISTED] != minds_before[i, M.RESISTED]:
                        return status, k, found, True
        moved = False
        status, _ = observe(agents, n, n, ego, reference, lanes, spacing_m, beams, rays, observations)
        k += 1
        found = watch(agents, minds, n, ego, spacing_m, dt_s, k, pairs, hurt, history, tallies, events, found)


class Counter:
    """Counts in rollouts of one scenario with the ego `idm` or `lidar`."""

    def __init__(self, scenario: Scenario, corridor: Corridor, drivers: DriverModel, ego: str) -> None:
        """InputError where the scenario has background traffic, whose vehicles nobody counts."""
        if scenario.background is not None:
            raise InputError(f"scenario {scenario.name} has background traffic; rates are counted without it")
        self.dt_s = scenario.time.step_s
        self.world = world = World.of(scenario, road_of(corridor), drivers, rays=BEAMS)
        net = world.network
        self._draw = Draw(scenario)
        policy = load_ego(ego)
        own = (net.w1, net.b1, net.w2, net.b2, drivers.mu0.astype(np.float32), net.action_scale)
        egos = (policy.kind, *policy.weights) if isinstance(policy, LidarEgo) else (IDM, *own)
        self._who = (world.agents, world.vehicles, world.ego, *egos, net.w1, net.b1, net.w2, net.b2, world.head,
                     net.action_scale)  # fmt: skip
        road = world.road
        self._where = (self.dt_s, road.reference, road.lanes, road.spacing_m, world.beams, world.rays,
                       world.observations, world.poses, world.minds, world.traits)  # fmt: skip
        self.memory = nothing_yet(world.vehicles, self.dt_s)
        self.happens = np.zeros((0, world.vehicles, 0))
        self.agents_before, self.minds_before = world.agents.copy(), world.minds.copy()

    def begin(
        self, x: np.ndarray, noise_seed: int, tallies: np.ndarray, events: np.ndarray
    ) -> tuple[int, int]:
        """Put the vehicles at the start of a rollout and watch them there: how it stands, and its events so far."""
        world = self.world
        world.minds[:] = 0.0
        _, self.happens = self._draw.begin(world, x, noise_seed)
        self.memory = nothing_yet(world.vehicles, self.dt_s)
        status, _ = world.observe()
        found = watch(
            world.agents, world.minds, world.vehicles, world.ego, world.road.spacing_m, self.dt_s, 0, *self.memory,
            tallies, events, 0,
        )  # fmt: skip
        return status, found

    def go_on(
        self, tallies: np.ndarray, events: np.ndarray, found: int, status: int, k: int, stop: int | None = None,
        moved: bool = False, halting: bool = False,
    ) -> tuple[int, int, int, bool]:  # fmt: skip
        """`drive_and_watch` from the present state.

        stop: default, the horizon
        """
        last = self.happens.shape[0]
        return drive_and_watch(
            *self._who, self.happens, *self._where, *self.memory, tallies, events, found, status, k,
            last if stop is None else min(stop, last), moved, halting, self.agents_before, self.minds_before,
        )  # fmt: skip

    def run(self, x: np.ndarray, noise_seed: int, tallies: np.ndarray) -> tuple[int, int, np.ndarray]:
        """How the rollout ended (service.world.sim.step), its steps and its events (n, EVENT); adds to `tallies`."""
        events = np.zeros((MOST_EVENTS, EVENT))
        status, found = self.begin(x, noise_seed, tallies, events)
        status, k, found, _ = self.go_on(tallies, events, found, status, 0)
        return status, k, events[:found]

    @property
    def agents(self) -> np.ndarray:
        """The state in which the last rollout ended."""
        return self.world.agents
