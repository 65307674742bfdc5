"""What the card measures of a scene, recorded or driven by a model: the same code for both.

Motion (speed, acceleration, jerk, turn rate) is of positions smoothed as the recordings are, so that a model's white
noise and a camera's are treated alike; hard brakes are counted in the actions as applied.
"""

from dataclasses import dataclass, replace

import numpy as np

from policies.columns import Values
from policies.data.neighbours import leader_of
from policies.data.scenes import EDGE_FRAMES, Scene, smoothed_motion
from policies.realism.driven import Driven
from policies.realism.lane_changes import crossings

HARD_BRAKE_MPS2 = -3.0
MOVING_MPS = 1.0  # headways of standing vehicles mean nothing
LONGEST_HEADWAY_S = 10.0
LONGEST_TTC_S = 30.0
QUANTITIES = {
    "speed_mps": "speed, m/s",
    "accel_mps2": "acceleration, m/s²",
    "jerk_mps3": "jerk, m/s³",
    "turn_rate_radps": "turn rate, rad/s",
    "headway_s": f"time headway up to {LONGEST_HEADWAY_S:g} s",
    "ttc_s": f"time to collision with the leader up to {LONGEST_TTC_S:g} s, closing in, s",
}


@dataclass(frozen=True)
class Counts:
    """Of one vehicle in one window: frames, and how many with a box touching another's, with a hard brake, off the
    road; lane changes; km driven."""

    frames: int
    touching: int
    hard_brakes: int
    off_road: int
    lane_changes: int
    km: float


def resmoothed(driven: Driven) -> Scene:
    """The scene with the model's vehicles smoothed as recorded ones are."""
    scene = driven.scene
    columns = {name: getattr(scene, name).copy() for name in ("speed", "accel", "turn_rate")}
    for v in driven.who:
        motion = smoothed_motion(scene.station[:, v], scene.lateral[:, v], scene.road)
        for name, values in columns.items():
            values[:, v] = motion[name]
    return replace(scene, **columns)


def quantities(scene: Scene, who: np.ndarray, every: int = 5) -> dict[str, Values]:
    """QUANTITIES of columns `who` at every `every`-th frame, ends left out (smoothing is one-sided there)."""
    rows = np.arange(EDGE_FRAMES, len(scene.frame) - EDGE_FRAMES - 1, every)
    if not len(who):
        return {name: Values(np.zeros(0), np.zeros(0, np.int64)) for name in QUANTITIES}
    ahead = np.column_stack([leader_of(scene, int(v)) for v in who])
    lead = np.maximum(ahead, 0)
    frames = np.arange(len(scene.frame))[:, None]
    half = 0.5 * (scene.length_m[lead] + scene.length_m[who])
    gap = np.where(ahead >= 0, scene.station[frames, lead] - scene.station[:, who] - half, np.nan)
    speed = scene.speed[:, who]
    closing = speed - scene.speed[frames, lead]
    jerk = np.gradient(np.nan_to_num(scene.accel[:, who]), scene.dt_s, axis=0, edge_order=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        headway = np.where(speed > MOVING_MPS, (gap + scene.length_m[lead]) / speed, np.nan)
        ttc = np.where((closing > 0.0) & (gap > 0.0), gap / closing, np.nan)
    found = {
        "speed_mps": speed,
        "accel_mps2": scene.accel[:, who],
        "jerk_mps3": jerk,
        "turn_rate_radps": scene.turn_rate[:, who],
        "headway_s": np.where((headway > 0.0) & (headway < LONGEST_HEADWAY_S), headway, np.nan),
        "ttc_s": np.where(ttc < LONGEST_TTC_S, ttc, np.nan),
    }
    number = np.broadcast_to(scene.vehicle_id[who], (len(rows), len(who)))
    out = {}
    for name, values in found.items():
        values = values[rows]
        good = np.isfinite(values) & scene.present[rows][:, who]
        out[name] = Values(values[good], number[good])
    return out


def touching(scene: Scene, who: np.ndarray) -> np.ndarray:
    """(F, n): the box of each column of `who`, parallel to the road, overlaps another's."""
    found = np.zeros((len(scene.frame), len(who)), dtype=bool)
    for i, v in enumerate(who):
        apart = np.abs(scene.station - scene.station[:, v : v + 1])
        aside = np.abs(scene.lateral - scene.lateral[:, v : v + 1])
        overlap = apart < 0.5 * (scene.length_m + scene.length_m[v])
        overlap &= (aside < 0.5 * (scene.width_m + scene.width_m[v])) & scene.present
        overlap[:, v] = False
        found[:, i] = overlap.any(axis=1)
    return found


def counts(scene: Scene, who: np.ndarray, accel: np.ndarray) -> list[Counts]:
    """Counts of columns `who`.

    accel: (T, n) as applied
    """
    contact = touching(scene, who)
    half = 0.5 * len(scene.road.lane_left) * scene.road.lane_width_m
    rows = []
    for i, v in enumerate(who):
        s = scene.station[:, v]
        rows.append(
            Counts(
                len(s),
                int(contact[:, i].sum()),
                int((accel[:-1, i] <= HARD_BRAKE_MPS2).sum()),
                int((np.abs(scene.lateral[:, v]) > half).sum()),
                len(crossings(scene.lane[:, v], scene.dt_s)),
                float(np.abs(np.diff(s)).sum() / 1000.0),
            )
        )
    return rows


def errors(driven: Driven, horizons: list[int]) -> np.ndarray:
    """(n, horizons, 3) of the model's vehicles: distance m (>= 0), speed difference m/s, lane offset difference m."""
    of = np.ix_(np.array(horizons), driven.who)
    along, across, faster = (
        getattr(driven.scene, name)[of] - getattr(driven.recorded, name)[of]
        for name in ("station", "lateral", "speed")
    )
    return np.stack([np.hypot(along, across), faster, across], axis=-1).transpose(1, 0, 2)
