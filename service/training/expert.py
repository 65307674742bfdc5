"""The driver that labels aggregated states: car following and lane keeping, fitted to the recordings.

acceleration = a (1 - (v / v0)^4 - ((s0 + max(0, T v + v dv / (2 sqrt(a b)))) / gap)^2)
turn rate    = v curvature - (w^2 offset + 2 zeta w v sin(heading)) / v

It is the intelligent driver model (Treiber et al. 2000) and a damped oscillator across the lane. Both carry white
noise, because people do not repeat themselves.

How each parameter is found (`fit`):
T, b                    simulated follower against recorded follower over whole car-following events (Zhu et al.),
                        least squares of the logarithm of the spacing; s0 is taken from the literature: the events
                        are all faster than 5 m/s and hardly show it
a, v0                   mean acceleration of recorded drivers without a leader within 60 m, by least squares
w                       stationary moments of lane keeping away from lane changes: the oscillator's w is s.d. of lateral
                        speed / s.d. of offset within a driver and lane (a regression on noisy offsets would
                        underestimate it). Drivers also differ in where they keep within the lane (s.d. 0.25 m); a
                        driver without memory cannot, so that part is left out
noise                   turn rate: the white noise that gives the recorded s.d. of the offset in the stationary state;
                        acceleration: s.d. of the free drivers' accelerations
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.optimize import minimize

from policies import layout as O
from policies.data.scenes import Scene

DT_S = 0.1
DAMPING_RATIO = 0.9  # lane keeping hardly overshoots; not identifiable from stationary moments
STEERING_SPEED_FLOOR_MPS = 4.0
FREE_GAP_M = 60.0
SPEED_LIMIT_MPS = (
    24.6  # 55 mph: nobody wants to go faster; few recorded drivers are free enough to show what they want
)
LANE_HALF_WIDTH_M = 1.8


@dataclass(frozen=True)
class Expert:
    """Parameters in SI units; see the module."""

    standstill_gap_m: float = 2.0
    time_headway_s: float = 1.2
    comfort_mps2: float = 2.0
    acceleration_mps2: float = 0.6
    desired_speed_mps: float = 21.0
    lateral_rate_per_s: float = 0.6
    offset_sd_m: float = 0.2
    acceleration_noise_mps2: float = 0.5

    def as_dict(self) -> dict[str, float]:
        return {key: round(float(value), 6) for key, value in asdict(self).items()}

    def lateral_acceleration(self, seen: np.ndarray) -> np.ndarray:
        """Acceleration across the lane (n,) in m/s^2, positive to the left, for observations (n, 51)."""
        rate = self.lateral_rate_per_s
        damping = 2.0 * DAMPING_RATIO * rate * lateral_speed(seen)
        return -(rate**2) * seen[:, O.LANE_OFFSET_M] - damping

    def lateral_noise(self, seen: np.ndarray) -> np.ndarray:
        """Strength (n,) of the white lateral acceleration, in m/s^1.5.

        The oscillator's stationary variance is S / (4 zeta w^3), S the square of the strength.
        """
        density = 4.0 * DAMPING_RATIO * self.lateral_rate_per_s**3 * self.offset_sd_m**2
        return np.full(len(seen), np.sqrt(density))


def lateral_speed(seen: np.ndarray) -> np.ndarray:
    """Speed across the lane (n,) in m/s, positive to the left."""
    return seen[:, O.SPEED_MPS].astype(np.float64) * np.sin(seen[:, O.LANE_HEADING_RAD])


def mean_action(expert: Expert, seen: np.ndarray) -> np.ndarray:
    """Action (n, 2) for observations (n, 51): m/s^2 and rad/s, without noise."""
    v = seen[:, O.SPEED_MPS].astype(np.float64)
    gap, closing = leader(seen)
    free = expert.acceleration_mps2 * (1.0 - (v / expert.desired_speed_mps) ** 4)
    accel = free - _interaction(expert, v, gap, closing)
    across = expert.lateral_acceleration(seen)
    turn = v * seen[:, O.LANE_CURVATURE_PER_M] + across / np.maximum(v, STEERING_SPEED_FLOOR_MPS)
    accel = np.clip(accel, -O.MAX_DECELERATION_MPS2, O.MAX_ACCELERATION_MPS2)
    return np.column_stack([accel, np.clip(turn, -O.MAX_TURN_RATE_RADPS, O.MAX_TURN_RATE_RADPS)])


def noise_sd(expert: Expert, seen: np.ndarray) -> np.ndarray:
    """Standard deviations (n, 2) of the white noise of a 0.1 s step.

    The lateral noise fades out below the floor: nobody turns while standing.
    """
    speed = seen[:, O.SPEED_MPS].astype(np.float64)
    v = np.maximum(speed, STEERING_SPEED_FLOOR_MPS)
    turn = expert.lateral_noise(seen) / np.sqrt(DT_S) / v * (speed / v)
    return np.column_stack([np.full(len(v), expert.acceleration_noise_mps2), turn])


def leader(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bumper gap (m, inf for none) and closing speed (m/s) of the vehicle in the own path, from the lidar."""
    steps = np.array([-2, -1, 0, 1, 2])
    beams = steps % O.BEAMS
    angle = 2.0 * np.pi * steps / O.BEAMS
    distance = seen[:, O.RANGE_M + beams].astype(np.float64)
    hit = (distance < O.LIDAR_RANGE_M - 1e-3) & (np.abs(distance * np.sin(angle)) < LANE_HALF_WIDTH_M)
    ahead = np.where(hit, distance * np.cos(angle) - 0.5 * seen[:, O.LENGTH_M, None], np.inf)
    best = ahead.argmin(axis=1)
    row = np.arange(len(seen))
    gap = ahead[row, best]
    closing = -seen[row, O.RANGE_RATE_MPS + beams[best]].astype(np.float64)
    return gap, np.where(np.isfinite(gap), closing, 0.0)


def _interaction(expert: Expert, v: np.ndarray, gap: np.ndarray, closing: np.ndarray) -> np.ndarray:
    root = 2.0 * np.sqrt(expert.acceleration_mps2 * expert.comfort_mps2)
    wanted = expert.standstill_gap_m + np.maximum(0.0, expert.time_headway_s * v + v * closing / root)
    return expert.acceleration_mps2 * (wanted / np.maximum(gap, 0.5)) ** 2


@dataclass(frozen=True)
class Evidence:
    """What the expert is fitted to, by driver, so that drivers can be resampled.

    following: (events, steps, 3) gap, own speed, leader's speed, NaN after the end
    free: (n, 2) speed and acceleration, with free_track (n,)
    lateral: (drivers and lanes, 3) rows, mean square offset about the driver's mean, mean square lateral speed
    """

    following: np.ndarray
    free: np.ndarray
    free_track: np.ndarray
    lateral: np.ndarray


def evidence(following: np.ndarray, scenes: list[Scene], train: list[np.ndarray]) -> Evidence:
    """Collect the evidence from car-following events and scenes.

    train: (N,) bool for each scene's vehicles
    """
    free, track, lateral = [], [], []
    for number, (scene, keep) in enumerate(zip(scenes, train, strict=True)):
        spacing, lanes = scene.road.lane_width_m, len(scene.road.lane_left)
        offset = scene.lateral - ((lanes - 1) / 2.0 - scene.lane) * spacing
        sideways = np.gradient(scene.lateral, DT_S, axis=0)
        for j in np.flatnonzero(keep):
            use = scene.usable[:, j]
            keeping = use & ~_near_lane_change(scene.lane[:, j])
            ahead = _next_ahead(scene, int(j))
            clear = use & (ahead > FREE_GAP_M) & (scene.speed[:, j] > 5.0)
            free.append(np.column_stack([scene.speed[clear, j], scene.accel[clear, j]]))
            track.append(np.full(int(clear.sum()), 1000 * number + j))
            for lane in np.unique(scene.lane[use, j]):
                there = keeping & (scene.lane[:, j] == lane) & (scene.speed[:, j] > 3.0)
                if there.sum() >= 60:
                    o, u = offset[there, j], sideways[there, j]
                    lateral.append([there.sum(), o.var(), np.mean(u**2)])
    return Evidence(following, np.concatenate(free), np.concatenate(track), np.array(lateral))


def _near_lane_change(lane: np.ndarray, frames: int = 40) -> np.ndarray:
    """(F,) bool: within `frames` of a change of lane."""
    near = np.zeros(len(lane), dtype=bool)
    for change in np.flatnonzero(np.diff(lane) != 0):
        near[max(0, change - frames) : change + frames + 1] = True
    return near


def _next_ahead(scene: Scene, j: int) -> np.ndarray:
    """Bumper gap (F,) to the next vehicle ahead in the same lane, inf if none is recorded."""
    same = (scene.lane == scene.lane[:, j : j + 1]) & (scene.station > scene.station[:, j : j + 1])
    free = scene.station - scene.station[:, j : j + 1] - 0.5 * (scene.length_m + scene.length_m[j])
    return np.where(same, free, np.inf).min(axis=1)


def fit(found: Evidence, start: Expert | None = None, rng: np.random.Generator | None = None) -> Expert:
    """The expert fitted to the evidence, or to a bootstrap resample of its drivers if `rng` is given."""
    following, lateral, free = found.following, found.lateral, found.free
    if rng is not None:
        following = following[rng.integers(0, len(following), len(following))]
        lateral = lateral[rng.integers(0, len(lateral), len(lateral))]
        tracks, inverse = np.unique(found.free_track, return_inverse=True)
        count = np.bincount(rng.integers(0, len(tracks), len(tracks)), minlength=len(tracks))
        free = np.repeat(free, count[inverse], axis=0)
    expert = _fit_free(start or Expert(), free)
    _, variance, square = np.average(lateral, axis=0, weights=lateral[:, 0])
    offset_sd, rate = float(np.sqrt(variance)), float(np.sqrt(square / variance))
    expert = replace(expert, lateral_rate_per_s=rate, offset_sd_m=offset_sd)
    return _fit_following(expert, following, 60 if start is not None else 300)


def _fit_free(expert: Expert, free: np.ndarray) -> Expert:
    """a and v0 from mean accelerations, which are linear in a and a / v0^4."""
    v, a = free.T
    design = np.column_stack([np.ones_like(v), -(v**4)])
    (f, ratio), *_ = np.linalg.lstsq(design, a, rcond=None)
    f = float(np.clip(f, 0.1, 2.0))
    v0 = float(np.clip((f / max(ratio, 1e-9)) ** 0.25, 15.0, SPEED_LIMIT_MPS))
    sd = float((a - f * (1.0 - (v / v0) ** 4)).std())
    return replace(expert, acceleration_mps2=f, desired_speed_mps=v0, acceleration_noise_mps2=sd)


def _fit_following(expert: Expert, following: np.ndarray, evaluations: int) -> Expert:
    names = ("time_headway_s", "comfort_mps2")
    low, high = np.log([0.3, 0.5]), np.log([3.0, 6.0])

    def with_values(logs: np.ndarray) -> Expert:
        return replace(expert, **dict(zip(names, np.exp(np.clip(logs, low, high)).tolist(), strict=True)))

    def loss(logs: np.ndarray) -> float:
        outside = np.sum(np.square(logs - np.clip(logs, low, high)))
        return _spacing_error(with_values(logs), following) + outside

    first = np.log([getattr(expert, name) for name in names])
    simplex = np.vstack([first, first + 0.3 * np.eye(len(first))])
    options = {"maxfev": evaluations, "xatol": 1e-3, "initial_simplex": simplex}
    found = minimize(loss, first, method="Nelder-Mead", options=options)
    return with_values(found.x)


def _spacing_error(expert: Expert, following: np.ndarray) -> float:
    """Mean square of log(simulated gap / recorded gap) when the follower is simulated from its first row."""
    gap, v = following[:, 0, 0].copy(), following[:, 0, 1].copy()
    total, count = 0.0, 0
    for k in range(1, following.shape[1]):
        recorded, lead = following[:, k, 0], following[:, k, 2]
        accel = expert.acceleration_mps2 * (1.0 - (v / expert.desired_speed_mps) ** 4)
        accel = accel - _interaction(expert, v, gap, v - following[:, k - 1, 2])
        new = np.maximum(v + np.clip(accel, -8.0, 4.0) * DT_S, 0.0)
        gap = np.maximum(gap + DT_S * (0.5 * (lead + following[:, k - 1, 2]) - 0.5 * (v + new)), 0.1)
        v = new
        here = np.isfinite(recorded) & (recorded > 0.5)
        total += float(np.sum(np.log(gap[here] / recorded[here]) ** 2))
        count += int(here.sum())
    return total / count
