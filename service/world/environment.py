"""A scenario as a Gymnasium environment: the ego is the agent, the traffic around it is drawn from P0.

The world is the compiled one of `service.world.sim.world`, without SUMO: states, observations and contacts have the
bits of a rollout, so that what an agent meets here is what `estimate` asks about. Episodes are the rollouts of a naive
run: seed and row are told in `info`, and `tailroad rollout SCENARIO --ego onnx:FILE --seed N --row R` drives one again,
with a film.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces

import ce
from policies import layout
from policies.drivers import load_drivers
from service.errors import InputError
from service.world import agents as A
from service.world.safety.boxes import box_time_to_collision
from service.world.safety.measure import open_monitor
from service.world.scenario import Scenario, load_scenario
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.sim import step
from service.world.sim.road import road_of
from service.world.sim.rollout import OUTCOMES, Draw
from service.world.sim.world import World

if TYPE_CHECKING:
    from service.world.camera.onboard import OnboardCamera

STATE, CAMERA = "state", "camera"
MAX_TURN_RATE_RADPS = 0.05  # of a full-scale action: a lane change at 20 m/s takes a third of it
SPEED_REWARDED_MPS = 25.0
COMFORT_MPS2, COMFORT_RADPS = 3.0, 0.05
NEAR_S = 3.0
ENDED_BADLY = -10.0
SEEDS = 1 << 32  # those that are drawn are below it
DRAWN_AT_ONCE = 1000  # rows of P0: a chunk of `ce.draw`


def _bounds() -> tuple[np.ndarray, np.ndarray]:
    """The least and the greatest value of each observed quantity, (51,) each, in the units of `policies.layout`."""
    high = np.full(layout.OBSERVATION_SIZE, 1.0)
    low = np.zeros(layout.OBSERVATION_SIZE)
    both = {
        layout.LANE_OFFSET_M: 10.0,
        layout.LANE_HEADING_RAD: math.pi,
        layout.LANE_CURVATURE_PER_M: 0.1,
        layout.LEFT_MARKING_M: 10.0,
        layout.RIGHT_MARKING_M: 10.0,
    }
    for column, bound in both.items():
        low[column], high[column] = -bound, bound
    high[layout.SPEED_MPS] = 60.0
    high[layout.LENGTH_M], high[layout.WIDTH_M] = 25.0, 4.0
    ranges = slice(layout.RANGE_M, layout.RANGE_M + layout.BEAMS)
    rates = slice(layout.RANGE_RATE_MPS, layout.RANGE_RATE_MPS + layout.BEAMS)
    high[ranges] = layout.LIDAR_RANGE_M
    low[rates], high[rates] = -60.0, 60.0
    return low, high


LOW, HIGH = _bounds()


class Step(NamedTuple):
    """What a reward is given for.

    speed_mps: of the ego after the step
    action: as asked for, acceleration in m/s^2 and turn rate in rad/s
    ttc_s: time until the ego's box touches another if all keep their velocities; infinite where none
    outcome: how the episode has ended, one of `service.world.sim.rollout.OUTCOMES`; None while it goes on
    step_s: of the scenario
    """

    speed_mps: float
    action: tuple[float, float]
    ttc_s: float
    outcome: str | None
    step_s: float


def default_reward(told: Step) -> float:
    """A second at 25 m/s counts 1, less for harsh actions and for times to collision below 3 s; a bad end -10."""
    acceleration, turn_rate = told.action
    harsh = 0.1 * (acceleration / COMFORT_MPS2) ** 2 + 0.1 * (turn_rate / COMFORT_RADPS) ** 2
    near = max(0.0, 1.0 - told.ttc_s / NEAR_S)
    reward = told.step_s * (min(told.speed_mps / SPEED_REWARDED_MPS, 1.0) - harsh - near)
    return reward + (ENDED_BADLY if told.outcome in ("collision", "off-road", "reversing") else 0.0)


class TrafficEnv(gymnasium.Env[Any, np.ndarray]):
    """The ego of a scenario as a Gymnasium agent.

    observation space: the 51 values of `policies.layout`, float32, as they are or, where `scaled`, from -1 to 1;
        with "camera" a dictionary of these (`observation`) and the picture (`frame`, uint8, height x width x 3)
    action space: two numbers from -1 to 1, of the greatest acceleration (4 m/s^2; -1 is 8 m/s^2 of braking) and of
        `max_turn_rate_radps`, counter-clockwise
    reward: of `reward`, a function of a `Step`
    info: `rollout`, its seed and row, at the start; `f`, the scenario's measure so far; `outcome`, at the end

    After `reset(seed=N)` the episodes are rows 0, 1, 2, ... of the rollouts of seed N; without a seed, of one that the
    operating system draws. `reset(options={"rollout": (N, R)})` is row R of seed N, whatever comes next.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012 as its base class declares it

    def __init__(
        self,
        scenario: str | Scenario = "i80-10s",
        observation: str = STATE,
        scaled: bool = False,
        reward: Callable[[Step], float] = default_reward,
        max_turn_rate_radps: float = MAX_TURN_RATE_RADPS,
        render_mode: str | None = None,
    ):
        """InputError for a scenario with background traffic, which needs SUMO, and for options that are none."""
        chosen = load_scenario(scenario) if isinstance(scenario, str) else scenario
        if chosen.background is not None:
            raise InputError(
                f"scenario {chosen.name} has background traffic, which SUMO drives: give one without [background]"
            )
        if observation not in (STATE, CAMERA):
            raise InputError(f"observation must be {STATE!r} or {CAMERA!r}, not {observation!r}")
        if not 0 < max_turn_rate_radps <= layout.MAX_TURN_RATE_RADPS:
            raise InputError(
                f"max_turn_rate_radps must be above 0 and at most {layout.MAX_TURN_RATE_RADPS}, "
                f"not {max_turn_rate_radps}"
            )
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode must be None or 'rgb_array', not {render_mode!r}")
        self.scenario, self.observed = chosen, observation
        self.scaled, self.max_turn_rate_radps = scaled, max_turn_rate_radps
        self.render_mode = render_mode
        self._reward = reward
        corridor = check_road(chosen, chosen.name)
        drivers = load_drivers(chosen.drivers.weights)
        self._base = base_distribution(chosen, drivers)
        self._world = World.of(chosen, road_of(corridor), drivers)
        self._draw = Draw(chosen)
        self._monitor = open_monitor(chosen, len(self._world.agents))
        self._happens = np.zeros((0, 0, 0))
        self._status, self._k, self._f = step.FINISHED, 0, math.nan
        self._stream: tuple[int, int] | None = None  # seed and row of the next episode
        self._block: tuple[int, int, np.ndarray, np.ndarray] | None = None
        low, high = (-np.ones_like(LOW), np.ones_like(HIGH)) if scaled else (LOW, HIGH)
        state = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space: spaces.Space[Any] = state
        if observation == CAMERA:
            shape = (chosen.camera.height_px, chosen.camera.width_px, 3)
            frame = spaces.Box(0, 255, shape, np.uint8)
            self.observation_space = spaces.Dict({"observation": state, "frame": frame})
        self._corridor = corridor
        self._camera: OnboardCamera | None = None  # opened when it is first looked through
        self._looked_from: tuple[np.ndarray, int] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next rollout, or the one of `options["rollout"]`."""
        super().reset(seed=seed)
        if seed is not None or self._stream is None:
            self._stream = (int(self.np_random.integers(SEEDS)) if seed is None else seed, 0)
        rollout = (options or {}).get("rollout")
        if rollout is None:
            rollout = self._stream
            self._stream = (rollout[0], rollout[1] + 1)
        x, noise = self._drawn(*rollout)
        drawn, self._happens = self._draw.begin(self._world, x, noise)
        self._status, ttc = self._world.observe()
        self._k, self._f = 0, math.inf
        if self._monitor is not None:
            self._monitor.reset()
        self._looked_from = (x, drawn)
        if self._camera is not None:
            self._camera.begin(x, drawn)
        self._measure(ttc)
        return self._observed(), {"rollout": rollout, "f": self._f}

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive one step of the scenario; RuntimeError where no episode is under way."""
        if self._status != step.RUNNING or self._k >= self.scenario.steps:
            raise RuntimeError("the episode is over, or none has begun: call reset()")
        asked = self.physical(action)
        self._world.advance(*asked, self._happens[self._k])
        self._status, ttc = self._world.observe()
        self._k += 1
        self._measure(ttc)
        terminated = self._status != step.RUNNING
        truncated = not terminated and self._k >= self.scenario.steps
        outcome = OUTCOMES[self._status] if terminated or truncated else None
        world = self._world
        told = Step(
            float(world.agents[world.ego, A.SPEED_MPS]),
            asked,
            box_time_to_collision(world.agents, world.count, world.ego),
            outcome,
            self.scenario.time.step_s,
        )
        info = {"f": self._f} | ({} if outcome is None else {"outcome": outcome})
        return self._observed(), float(self._reward(told)), terminated, truncated, info

    def render(self) -> np.ndarray:
        """The camera's picture (height, width, 3) uint8; RuntimeError before the first episode."""
        if self._looked_from is None:
            raise RuntimeError("no episode has begun: call reset()")
        if self._camera is None:
            from service.world.camera.onboard import OnboardCamera  # its kernels take a moment to load

            self._camera = OnboardCamera(self.scenario, self._corridor)
            self._camera.begin(*self._looked_from)
        return self._camera.picture(self._world.agents, self._world.count, self._world.ego, self._k)

    def physical(self, action: np.ndarray) -> tuple[float, float]:
        """Acceleration in m/s^2 and turn rate in rad/s of an action, clipped to the action space."""
        along, turn = (float(value) for value in np.clip(np.asarray(action, np.float64), -1.0, 1.0))
        most = layout.MAX_ACCELERATION_MPS2 if along > 0 else layout.MAX_DECELERATION_MPS2
        return along * most, turn * self.max_turn_rate_radps

    def _drawn(self, seed: int, row: int) -> tuple[np.ndarray, int]:
        """x (d,) and the noise seed of a row of a seed's rollouts; many are drawn together, at the cost of one."""
        block = row // DRAWN_AT_ONCE
        if self._block is None or self._block[:2] != (seed, block):
            first = block * DRAWN_AT_ONCE
            drawn = ce.draw(self._base, seed, "estimate", 0, first, first + DRAWN_AT_ONCE)
            self._block = (seed, block, *drawn)
        _, _, x, noise = self._block
        return x[row % DRAWN_AT_ONCE], int(noise[row % DRAWN_AT_ONCE])

    def _measure(self, ttc_s: float) -> None:
        if self._monitor is None:
            self._f = min(self._f, ttc_s)
        else:
            self._monitor.see(self._world.agents, self._world.count, ttc_s)
            self._f = self._monitor.value()

    def _observed(self) -> Any:
        world = self._world
        state = np.clip(world.observations[world.ego], LOW, HIGH)
        if self.scaled:
            state = 2.0 * (state - LOW) / (HIGH - LOW) - 1.0
        state = state.astype(np.float32)
        return state if self.observed == STATE else {"observation": state, "frame": self.render()}
