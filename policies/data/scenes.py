"""Recorded scenes: every vehicle of a stretch of road at 10 Hz, smoothed, with lanes, boxes and flags.

The lateral coordinate is rectified. NGSIM lane positions wander by up to 0.7 m along the road for all lanes
together (camera joints), and the US-101 lane map is 0.1 to 0.4 m off its tracks. So at each station the
recorded lateral position is mapped piecewise linearly such that the empirical lane centres become parallel
lines one mean lane spacing apart. A vehicle's offset from its own lane's centre, the quantity drivers control,
is kept; the camera's wander is gone. Then station and lateral offset are smoothed (smoothing.py) and position,
heading, speed, acceleration and turn rate are derived from the smoothed functions:

    s' = v cos(psi) / (1 - curvature d),   d' = v sin(psi),   heading = reference heading + psi

At low speed psi = atan2(d', max(s', SLOW_MPS)), so that a standing vehicle points along its lane.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from scipy.spatial import cKDTree

from policies.data.smoothing import (
    DT_S,
    LATERAL_CUTOFF_HZ,
    LONGITUDINAL_CUTOFF_HZ,
    MIN_LENGTH,
    derivative,
    smooth,
    split_at_gaps,
)

I80_FILE = "scenes/i80_carpe_platoon_0400-0415.parquet"
I80_LANES = "scenes/i80_lanes.json"
US101_FILE = "scenes/us101_commonroad_merged.parquet"
US101_LANES = "scenes/us101_lanes.json"

# x, y, heading and curvature of a curve, (n,) each
Samples = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

# The last vehicles of each recording are held out, so that train and test drivers differ.
I80_HELD_OUT_FROM = 2470
I80_RESERVED = (0,)  # lane 1 is for high-occupancy vehicles
US101_HELD_OUT_FROM = 500

SLOW_MPS = 2.0  # below it the heading fades to the lane's
EDGE_FRAMES = 8  # smoothed ends of a track: one-sided, so not used as demonstrations
I80_WIDTH_M = 1.9  # not recorded; between the 1.8 m of the data pack's check and NGSIM's median of 2.1 m
I80_LENGTH_EXCESS_M = 1.1  # the estimated lengths' median is 5.6 m, that of NGSIM cars 4.5 m

# Flags: why a row is not physical. Flagged rows stay in the scene and are seen by the others.
BACKWARD, HARD, JERKY, SIDEWAYS, OVERLAP = 1, 2, 4, 8, 16
FLAG_NAMES = {
    BACKWARD: "moves backward faster than 0.2 m/s",
    HARD: "acceleration beyond [-8, 4] m/s^2",
    JERKY: "jerk beyond 12 m/s^3",
    SIDEWAYS: "turn rate beyond 0.3 rad/s or heading beyond 0.3 rad from the lane above 3 m/s",
    OVERLAP: "box overlaps another vehicle's in the same lane",
}


class DataError(ValueError):
    """A recording that cannot be used: names the file, what was found and what was expected."""


@dataclass(frozen=True)
class SceneRoad:
    """A recorded road in the terms of the simulated one: the field names are those of a corridor.

    station_m (K+1,) every `ds_m`; reference line ref_x, ref_y (m), ref_heading (rad, unwrapped), ref_curvature
    (1/m); lane_left, lane_right (L, K+1) lateral offsets in m, positive to the left, lane 1 (leftmost) first;
    road_left, road_right (K+1,) outermost edges; reserved (L, K+1) bool: high-occupancy lanes.
    """

    name: str
    ds_m: float
    station_m: np.ndarray
    ref_x: np.ndarray
    ref_y: np.ndarray
    ref_heading: np.ndarray
    ref_curvature: np.ndarray
    lane_left: np.ndarray
    lane_right: np.ndarray
    road_left: np.ndarray
    road_right: np.ndarray
    reserved: np.ndarray

    @property
    def length_m(self) -> float:
        return float(self.station_m[-1])

    @property
    def lane_width_m(self) -> float:
        return float(self.lane_left[0, 0] - self.lane_right[0, 0])


@dataclass(frozen=True)
class Scene:
    """F frames of N vehicles. Arrays are (F, N), NaN (or lane -1, False) where a vehicle is absent.

    frame (F,) recorded frame numbers; vehicle_id (N,), length_m (N,), width_m (N,); x, y, heading, speed, accel,
    turn_rate in m, rad, s: accel and turn_rate are the actions that lead from one frame to the next (forward
    differences); station, lateral in the road's frame (lateral after rectification); lane (0 = leftmost); flags a sum
    of FLAG_NAMES.

    usable: neighbours recorded, no flag, not at a track's end, action known
    held_out_from: vehicles from this number on are kept from training
    """

    name: str
    dt_s: float
    road: SceneRoad
    frame: np.ndarray
    vehicle_id: np.ndarray
    length_m: np.ndarray
    width_m: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    accel: np.ndarray
    turn_rate: np.ndarray
    station: np.ndarray
    lateral: np.ndarray
    lane: np.ndarray
    flags: np.ndarray
    usable: np.ndarray
    held_out_from: int

    @property
    def present(self) -> np.ndarray:
        return np.isfinite(self.x)


def straight_lanes(
    name: str,
    length_m: float,
    lanes: int,
    width_m: float,
    curve: tuple | None = None,
    ds_m: float = 1.0,
    reserved: tuple[int, ...] = (),
) -> SceneRoad:
    """Parallel lanes along the x axis, or along `curve` = (x, y, heading, curvature) sampled every ds_m.

    reserved: indices of high-occupancy lanes (0 = leftmost).

    The reference line is the boundary between the middle lanes shifted so that lane 1's centre lies at
    (lanes - 1) / 2 * width_m to its left.
    """
    k = round(length_m / ds_m) + 1
    station = np.arange(k) * ds_m
    zero = np.zeros(k)
    x, y, heading, curvature = (station, zero, zero, zero) if curve is None else curve
    edges = (lanes / 2 - np.arange(lanes + 1))[:, None] * width_m + np.zeros(k)
    arrays = (station, x, y, heading, curvature, edges[:-1], edges[1:], edges[0], edges[-1])
    lines = [np.ascontiguousarray(a, dtype=np.float64) for a in arrays]
    lines.append(np.repeat(np.isin(np.arange(lanes), reserved)[:, None], k, axis=1))
    return SceneRoad(name, ds_m, *lines)


def read_i80(data: Path | str, lanes_json: Path | str | None = None, road_length_m: float = 600.0) -> Scene:
    """The I-80 platoon (94 vehicles, 157 s) from the data pack's folder, or from a file in its schema."""
    path, lanes_path = _locate(data, I80_FILE, I80_LANES, lanes_json)
    table = _read(path, ["vehicle_id", "frame", "x_m", "y_m", "length_est_m", "lane", "leader_known"])
    lanes = json.loads(lanes_path.read_text())
    grid = np.asarray(lanes["centre_y_m"], dtype=np.float64)
    centres = np.array([lanes["centre_local_x_m"][str(i)] for i in range(1, 7)])  # to the right of the median
    centres = np.vstack([centres, centres[-1] + 1.95 + 1.85])  # on-ramp lane beside lane 6
    width = float((centres[5] - centres[0]).mean() / 5.0)
    road = straight_lanes("ngsim-i80", road_length_m, 7, width, reserved=I80_RESERVED)
    s_raw, d_raw = table["x_m"].to_numpy(), table["y_m"].to_numpy()
    d = rectify(s_raw, -d_raw, grid, centres, width)
    length = np.clip(table["length_est_m"].to_numpy() - I80_LENGTH_EXCESS_M, 3.6, None)
    table = table.with_columns(
        pl.Series("s", s_raw - 0.5 * length),  # the recording gives the front's centre
        pl.Series("d", d),
        pl.Series("length", length),
        pl.lit(I80_WIDTH_M).alias("width"),
    )
    return assemble("i80", table, road, I80_HELD_OUT_FROM)


def read_us101(data: Path | str) -> list[Scene]:
    """The US-101 recordings of the data pack, one scene each, on the map's curved reference line (lane 3)."""
    path, lanes_path = _locate(data, US101_FILE, US101_LANES, None)
    table = _read(
        path, ["scene_id", "vehicle_id", "frame", "s_m", "d_m", "length_m", "lane", "lane_offset_m"]
    )
    lanes = json.loads(lanes_path.read_text())["lanes"]
    curve, station = smooth_curve(np.asarray(lanes["3"]["centre"], dtype=np.float64))
    shift = {
        int(row["lane"]): row["lane_offset_m"]
        for row in table.filter(pl.col("lane") > 0)
        .group_by("lane")
        .agg(pl.col("lane_offset_m").median())
        .to_dicts()
    }
    projected = [project(np.asarray(lanes[str(i)]["centre"], dtype=np.float64), curve) for i in range(1, 6)]
    grid = np.arange(0.0, station[-1], 10.0)
    centres = np.array([-np.interp(grid, s, d) - shift[i + 1] for i, (s, d) in enumerate(projected)])
    width = float((centres[4] - centres[0]).mean() / 4.0)
    centres = np.vstack([centres, centres[-1] + width])
    road = straight_lanes("ngsim-us101", station[-1], 6, width, curve)
    xy = np.column_stack([table["x_m"].to_numpy(), table["y_m"].to_numpy()])
    s, d_map = project(xy, curve)
    d = rectify(s, -d_map, grid, centres, width)
    table = table.with_columns(
        pl.Series("s", s),
        pl.Series("d", d),
        pl.col("length_m").alias("length"),
        pl.col("width_m").alias("width"),
    )
    return [
        assemble(str(key[0]), part, road, US101_HELD_OUT_FROM)
        for key, part in table.group_by("scene_id", maintain_order=True)
    ]


def _locate(data: str | Path, file: str, lanes: str, lanes_json: str | Path | None) -> tuple[Path, Path]:
    data = Path(data)
    path = data if data.is_file() else data / file
    lanes_path = Path(lanes_json) if lanes_json is not None else data / lanes
    for needed in (path, lanes_path):
        if not needed.is_file():
            raise DataError(
                f"{needed}: no such file; --data must name the data pack's folder, which holds {file}"
            )
    return path, lanes_path


def _read(path: Path, needed: list[str]) -> pl.DataFrame:
    try:
        table = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise DataError(f"{path}: not a readable Parquet file ({error})") from error
    missing = [name for name in needed if name not in table.columns]
    if missing:
        raise DataError(f"{path}: columns {missing} are missing; found {table.columns}")
    if table.height == 0:
        raise DataError(f"{path}: no rows")
    order = [c for c in ("scene_id", "vehicle_id", "frame") if c in table.columns]
    return table.sort(order)


def rectify(
    s: np.ndarray, right: np.ndarray, grid: np.ndarray, centres: np.ndarray, width: float
) -> np.ndarray:
    """Lateral offset (positive left, 0 = road middle) of points `right` m to the right of the reference.

    centres (L, G): lane centres to the right of the reference at stations `grid`; they become parallel.
    """
    lanes = len(centres)
    knots = np.array([np.interp(s, grid, c) for c in centres])  # (L, n)
    knots = np.vstack([knots[:1] - width, knots, knots[-1:] + width])
    target = np.concatenate([[-1.0], np.arange(lanes), [float(lanes)]])
    piece = np.clip((right[None] >= knots).sum(axis=0) - 1, 0, lanes)
    here = np.arange(len(s))
    low, high = knots[piece, here], knots[piece + 1, here]
    lane_number = target[piece] + (right - low) / (high - low) * (target[piece + 1] - target[piece])
    return ((lanes - 1) / 2.0 - lane_number) * width


def smooth_curve(points: np.ndarray, ds_m: float = 1.0) -> tuple[Samples, np.ndarray]:
    """A polyline resampled every ds_m with a smooth heading: (x, y, heading, curvature), station."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    station = np.arange(0.0, s[-1], ds_m)
    x, y = (_smooth_line(np.interp(station, s, points[:, i])) for i in range(2))
    heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    curvature = np.gradient(heading, ds_m)
    return (x, y, heading, curvature), station


def _smooth_line(z: np.ndarray) -> np.ndarray:
    """Smooth along the road: halves waves of 60 m, far shorter than the curves of a freeway."""
    return smooth(z, cutoff_hz=1.0 / 60.0, dt_s=1.0)


def project(points: np.ndarray, curve: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Station and lateral offset (positive left) of points (n, 2) relative to a curve sampled every metre."""
    x, y, heading, _ = curve
    _, k = cKDTree(np.column_stack([x, y])).query(points)
    dx, dy = points[:, 0] - x[k], points[:, 1] - y[k]
    cos, sin = np.cos(heading[k]), np.sin(heading[k])
    return k + dx * cos + dy * sin, -dx * sin + dy * cos


def assemble(name: str, table: pl.DataFrame, road: SceneRoad, held_out_from: int) -> Scene:
    """Smooth every gap-free piece of every track and lay them out on a common (frame, vehicle) grid.

    table: sorted by vehicle and frame, with s, d (station and rectified offset of the centre, m), length, width,
        followers_known and leader_known
    """
    numbers = table["frame"].to_numpy()
    frames = np.arange(numbers.min(), numbers.max() + 1)
    ids = np.sort(table["vehicle_id"].unique().to_numpy())
    shape = (len(frames), len(ids))
    out = {
        key: np.full(shape, np.nan) for key in ("x", "y", "heading", "speed", "accel", "turn_rate", "s", "d")
    }
    flags, usable = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=bool)
    length, width = np.zeros(len(ids)), np.zeros(len(ids))
    for (vehicle,), track in table.group_by(["vehicle_id"], maintain_order=True):
        column = int(np.searchsorted(ids, vehicle))
        length[column], width[column] = (np.median(track[key].to_numpy()) for key in ("length", "width"))
        frame = track["frame"].to_numpy()
        if (np.diff(frame) <= 0).any():
            raise DataError(f"{name}: vehicle {vehicle} has two rows with the same frame")
        known = (track["followers_known"] & track["leader_known"]).to_numpy()
        s, d = track["s"].to_numpy(), track["d"].to_numpy()
        for piece in split_at_gaps(frame):
            if piece.stop - piece.start < MIN_LENGTH:
                continue
            rows = slice(frame[piece.start] - frames[0], frame[piece.stop - 1] - frames[0] + 1)
            motion = smoothed_motion(s[piece], d[piece], road)
            for key, values in motion.items():
                if key != "flags":
                    out[key][rows, column] = values
            flags[rows, column] = motion["flags"]
            inner = np.zeros(piece.stop - piece.start, dtype=bool)
            inner[EDGE_FRAMES : -EDGE_FRAMES - 1] = True
            usable[rows, column] = inner & known[piece]
    spacing = road.lane_width_m
    lanes = len(road.lane_left)
    number = np.floor(lanes / 2.0 - out["d"] / spacing)
    lane = np.where(np.isfinite(number), np.clip(np.nan_to_num(number), 0, lanes - 1), -1).astype(np.int64)
    flags |= _overlaps(out["s"], out["d"], lane, length, width)
    on_map = np.abs(out["d"]) < 0.5 * lanes * spacing
    on_map &= (out["s"] > 1.0) & (out["s"] + 0.5 * length < road.length_m - 2.0)
    usable &= (flags == 0) & on_map & np.isfinite(out["accel"]) & np.isfinite(out["turn_rate"])
    return Scene(
        name, DT_S, road, frames, ids, length, width, out["x"], out["y"], out["heading"], out["speed"],
        out["accel"], out["turn_rate"], out["s"], out["d"], lane, flags, usable, held_out_from,
    )  # fmt: skip


def smoothed_motion(s: np.ndarray, d: np.ndarray, road: SceneRoad) -> dict[str, np.ndarray]:
    """Position, heading, speed, actions and flags of one gap-free track given as station and lateral offset (m)."""
    s, d = smooth(s, LONGITUDINAL_CUTOFF_HZ), smooth(d, LATERAL_CUTOFF_HZ)
    kappa = np.interp(s, road.station_m, road.ref_curvature)
    along, across = derivative(s) * (1.0 - kappa * d), derivative(d)
    psi = np.arctan2(across, np.maximum(along, SLOW_MPS))
    speed = np.maximum(along, 0.0) / np.cos(psi)
    ref_heading = np.interp(s, road.station_m, road.ref_heading)
    heading = ref_heading + psi
    accel, turn_rate = (np.append(np.diff(z) / DT_S, np.nan) for z in (speed, heading))
    jerk = derivative(np.nan_to_num(accel))
    flags = np.zeros(len(s), dtype=np.uint8)
    flags[along < -0.2] |= BACKWARD
    flags[(accel < -8.0) | (accel > 4.0)] |= HARD
    flags[np.abs(jerk[: len(s)]) > 12.0] |= JERKY
    flags[-2:] &= ~np.uint8(JERKY)  # the padded last action is no jerk
    flags[(np.abs(turn_rate) > 0.3) | ((np.abs(psi) > 0.3) & (along > 3.0))] |= SIDEWAYS
    x = np.interp(s, road.station_m, road.ref_x) - d * np.sin(ref_heading)
    y = np.interp(s, road.station_m, road.ref_y) + d * np.cos(ref_heading)
    return {
        "x": x, "y": y, "heading": heading, "speed": speed, "accel": accel, "turn_rate": turn_rate,
        "s": s, "d": d, "flags": flags,
    }  # fmt: skip


def _overlaps(
    s: np.ndarray, d: np.ndarray, lane: np.ndarray, length: np.ndarray, width: np.ndarray
) -> np.ndarray:
    """OVERLAP for rows whose box overlaps another's while both centres are in the same lane."""
    flags = np.zeros(s.shape, dtype=np.uint8)
    for f in range(len(s)):
        present = np.flatnonzero(np.isfinite(s[f]))
        ds = np.abs(s[f, present][:, None] - s[f, present])
        dd = np.abs(d[f, present][:, None] - d[f, present])
        touch = (ds < 0.5 * (length[present][:, None] + length[present])) & (
            dd < 0.5 * (width[present][:, None] + width[present])
        )
        touch &= lane[f, present][:, None] == lane[f, present]
        np.fill_diagonal(touch, False)
        flags[f, present[touch.any(axis=1)]] = OVERLAP
    return flags


def summary(scene: Scene) -> dict:
    """Counts and moments of a scene, for cards and for the user's eyes."""
    use, here = scene.usable, scene.present
    flagged = {FLAG_NAMES[bit]: int(((scene.flags & bit) > 0).sum()) for bit in FLAG_NAMES}
    return {
        "name": scene.name,
        "vehicles": len(scene.vehicle_id),
        "frames": len(scene.frame),
        "rows": int(here.sum()),
        "usable": int(use.sum()),
        "flagged": {name: n for name, n in flagged.items() if n},
        "speed_mps": [float(scene.speed[use].mean()), float(scene.speed[use].std())] if use.any() else None,
        "accel_sd_mps2": float(scene.accel[use].std()) if use.any() else None,
        "turn_rate_sd_radps": float(scene.turn_rate[use].std()) if use.any() else None,
    }
