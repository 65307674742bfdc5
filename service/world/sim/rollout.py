"""One rollout: a pure function of (scenario, ego, x, noise seed)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

import numpy as np

from policies.drivers import DriverModel
from policies.egos import EgoPolicy, Observation
from service.errors import EgoError
from service.world import agents as A
from service.world.safety.contact import Contact, contact_of
from service.world.safety.measure import open_monitor
from service.world.scenario.base import causes, searched_action_noise, unpack
from service.world.scenario.causes import REACTION_S
from service.world.scenario.noise import Noise, PathNoise
from service.world.scenario.schema import Scenario
from service.world.sim import step
from service.world.sim.interrupts import is_users, listen, signals_seen
from service.world.sim.latent import Latent
from service.world.sim.road import road_of
from service.world.sim.streams import normals_of
from service.world.sim.sumo import SumoSession
from service.world.sim.sumo_background import BackgroundTraffic
from service.world.sim.world import World, action_noise
from sumo_nets.corridor import Corridor

OUTCOMES = {
    step.RUNNING: "horizon",
    step.FINISHED: "finished",
    step.COLLIDED: "collision",
    step.OFF_ROAD: "off-road",
    step.REVERSED: "reversing",
}
FROZEN_NOISE_SEED = 0  # scenarios with noise_mode = "frozen" drive every rollout with this stream
BACKGROUND_ROWS = 1000  # background vehicles at most


@dataclass(frozen=True)
class Rollout:
    """What a rollout came to.

    f: value of the scenario's safety measure; low is dangerous
    outcome: one of OUTCOMES, or "error"
    steps: that were driven
    error: what failed; None where nothing did
    contact: of the ego, where it ended the rollout
    """

    f: float
    outcome: str
    steps: int
    error: str | None = None
    contact: Contact | None = None


def seed_and_action_noise(
    scenario: Scenario, x: np.ndarray, noise_seed: Noise, vehicles: int, given: np.ndarray | None = None
) -> tuple[int, np.ndarray]:
    """The rollout's seed, and its action noise as standard normals.

    x: (d,) a draw from P0
    noise_seed: of the rollout; one for all where the scenario's noise mode is "frozen"; that of a path counts as given
    given: (steps, vehicles, channels) action noise to use as it is; None: from x where the noise mode is "searched",
    else from
        the seed

    Returns the seed and the action noise (steps, vehicles, channels). Raises ValueError for action noise of another
    shape.
    """
    mode = scenario.drivers.noise_mode
    if isinstance(noise_seed, PathNoise) and given is None:
        given = normals_of(noise_seed, scenario.steps, vehicles, scenario.noise_channels)
    seed = FROZEN_NOISE_SEED if mode == "frozen" and given is None else int(noise_seed)
    if given is not None:
        normals = given
    elif mode == "searched":
        normals = searched_action_noise(scenario, x)
    else:
        normals = action_noise(seed, scenario.steps, vehicles, scenario.noise_channels)
    shape = (scenario.steps, vehicles, scenario.noise_channels)
    if normals.shape != shape or normals.dtype != np.float64:
        raise ValueError(
            f"action noise must be float64 of shape {shape}, not {normals.dtype} of shape {normals.shape}"
        )
    return seed, normals


class Draw:
    """What a draw x and a rollout's noise come to in the world of one scenario: one place for both ways to run one."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._latent = None if scenario.human is None else Latent(scenario)

    def begin(
        self, world: World, x: np.ndarray, noise_seed: Noise, given: np.ndarray | None = None
    ) -> tuple[int, np.ndarray]:
        """Put the vehicles of `world` at their starts; the arguments as `seed_and_action_noise` has them.

        Returns the rollout's seed, and what its drivers do: their action noise (steps, vehicles, 2), or a table
        (steps, vehicles, 4) of `service.world.sim.latent` where they are human.
        """
        seed, normals = seed_and_action_noise(self._scenario, x, noise_seed, world.vehicles, given)
        starts, driver_weights = unpack(self._scenario, x)
        if self._latent is None:
            world.reset(starts, driver_weights)
            return seed, normals
        named = causes(self._scenario, x)
        world.reset(starts, driver_weights, named[:, REACTION_S])
        return seed, self._latent.realise(normals, named)


class Observer(Protocol):
    """Looks on at a rollout, a call a step, the last one at the state in which it ended."""

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None: ...


class FrameSource(Protocol):
    """Where the frames of an ego's camera come from."""

    def begin(self, x: np.ndarray, seed: int) -> None: ...

    def picture(self, agents: np.ndarray, count: int, ego: int, step: int) -> np.ndarray: ...


def _onboard(scenario: Scenario, corridor: Corridor) -> FrameSource:
    from service.world.camera.onboard import OnboardCamera  # its kernels take a moment to load

    return OnboardCamera(scenario, corridor)


class Simulator:
    """Runs rollouts of one scenario with one ego in this process; use as a context manager."""

    def __init__(
        self,
        scenario: Scenario,
        corridor: Corridor,
        drivers: DriverModel,
        ego: EgoPolicy,
        fcd: Path | None = None,
        gui: bool = False,
        open_camera: "Callable[[], FrameSource] | None" = None,
    ):
        """Open SUMO with the scenario's road and vehicles.

        open_camera: makes the camera of an ego that wants one; None: one that renders in this process
        """
        listen()
        self._scenario = scenario
        self._ego = ego
        self._steps = scenario.steps
        self._dt_s = scenario.time.step_s
        background = scenario.background
        rows = BACKGROUND_ROWS if background else 0
        self._world = World.of(scenario, road_of(corridor), drivers, background_rows=rows)
        self._draw = Draw(scenario)
        self._open_camera = open_camera or (lambda: _onboard(scenario, corridor))
        self._camera: FrameSource | None = None
        self._monitor = open_monitor(scenario, len(self._world.agents))
        stations = [scenario.of(vehicle, "station_m") for vehicle in scenario.vehicles]
        self._has_background = background is not None
        self.in_sumo = 0  # rollouts so far
        own = scenario.vehicles[scenario.ego].name
        enter = getattr(ego, "enter", None)  # of an ego that SUMO itself drives
        self._sumo = SumoSession(
            corridor,
            [vehicle.name for vehicle in scenario.vehicles],
            [(scenario.of(v, "length_m"), scenario.of(v, "width_m")) for v in scenario.vehicles],
            self._dt_s,
            background=None
            if background is None
            else BackgroundTraffic(
                background.density_veh_per_km_lane,
                background.speed_mps,
                min(s.low for s in stations),
                max(s.high for s in stations),
                scenario.time.horizon_s,
            ),
            fcd=fcd,
            gui=own if gui else None,
            follower=None if enter is None else (own, getattr(ego, "model", "")),
        )
        if enter is not None:
            enter(self._sumo, own)
        if (
            see := getattr(ego, "see_world", None)
        ) is not None:  # of a reference driver, which sees everybody
            see(self._world)

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._sumo.close()
        for part in (self._ego, self._camera):
            if (leave := getattr(part, "close", None)) is not None:
                leave()

    def begin_chunk(self) -> None:
        """The rollouts that come now are of a new chunk."""

    def _frame_source(self) -> FrameSource | None:
        """The ego's camera where it wants one; asked when a rollout has begun: an ego elsewhere has to be met first."""
        if not getattr(self._ego, "wants_camera", False):
            return None
        if self._camera is None:  # only where an ego looks: the scene takes a second
            self._camera = self._open_camera()
        return self._camera

    @property
    def world(self) -> World:
        """Its vehicles, as the last rollout left them."""
        return self._world

    def measured(self) -> np.ndarray | None:
        """The measure at each state of the last rollout, (states,); None for `ttc`, which observers are shown."""
        return None if self._monitor is None else self._monitor.trace()

    def run(
        self,
        x: np.ndarray,
        noise_seed: Noise = 0,
        observer: Observer | None = None,
        *,
        action_noise: np.ndarray | None = None,
    ) -> Rollout:
        """The rollout of `x` (d,) with action noise from its noise seed, or given as standard normals
        (steps, vehicles, channels).

        An exception on the way, from the ego or from SUMO, makes a recorded rollout with outcome "error" and
        f = NaN; it is not raised. Only the user's Ctrl-C is.
        """
        self.in_sumo += 1
        interrupts = signals_seen()
        try:
            return self._run(x, noise_seed, observer, action_noise)
        except KeyboardInterrupt as error:
            if is_users(interrupts):
                raise
            return Rollout(math.nan, "error", 0, f"{type(error).__name__}: {error}")
        # any failure of a black box, sys.exit included, is a result with its seed, never a lost rollout
        except (Exception, SystemExit) as error:
            return Rollout(math.nan, "error", 0, f"{type(error).__name__}: {error}")

    def _run(
        self, x: np.ndarray, noise_seed: Noise, observer: Observer | None, given: np.ndarray | None
    ) -> Rollout:
        world, ego, sumo, monitor = self._world, self._ego, self._sumo, self._monitor
        seed, happens = self._draw.begin(world, x, noise_seed, given)
        ego.reset(seed)
        status, ttc = world.observe()
        world.write_poses()
        looked_at = observer is not None or sumo.tells_speeds
        speeds = world.agents[: world.vehicles, A.SPEED_MPS] if looked_at else None
        sumo.begin(world.poses, seed, speeds)
        if self._has_background:
            world.count = sumo.read_background(world.agents, world.vehicles)
            status, ttc = world.observe()

        observation = Observation(world.observations[world.ego], 0.0, world.agents[world.ego])
        camera = self._frame_source()
        if camera is not None:
            camera.begin(x, seed)
        f = ttc
        if monitor is not None:
            monitor.reset()
            monitor.see(world.agents, world.count, ttc)
        k = 0
        while status == step.RUNNING and k < self._steps:
            observation.time_s = k * self._dt_s
            if camera is not None:
                observation.frame = camera.picture(world.agents, world.count, world.ego, k)
            acceleration, turn_rate = ego.act(observation)
            if not (math.isfinite(acceleration) and math.isfinite(turn_rate)):
                raise EgoError(
                    f"ego {ego.name!r} answered ({acceleration}, {turn_rate}) at {observation.time_s:.1f} s"
                )
            # a policy may answer with another kind of number; the kernels are compiled for this one
            acceleration, turn_rate = float(acceleration), float(turn_rate)
            if observer is not None:
                observer.see(world, observation.time_s, ttc, (acceleration, turn_rate))
            world.advance(acceleration, turn_rate, happens[k])
            sumo.step(world.poses, speeds)
            if self._has_background:
                world.count = sumo.read_background(world.agents, world.vehicles)
            status, ttc = world.observe()
            if monitor is not None:
                monitor.see(world.agents, world.count, ttc)
            elif ttc < f:
                f = ttc
            k += 1
        if observer is not None:
            observer.see(world, k * self._dt_s, ttc, None)
        contact = contact_of(world.agents, world.count, world.ego) if status == step.COLLIDED else None
        return Rollout(f if monitor is None else monitor.value(), OUTCOMES[status], k, contact=contact)
