"""How fast vehicles move across their lane where they start, jointly with offset and speed, fitted to recordings.

    u = y (1 + g o^2) min(1, v / v_full)^p,      y ~ share N(0, wide^2) + (1 - share) N(0, narrow^2)

with u the lateral speed (m/s), o the offset from the lane's centre (m), v the speed (m/s): most vehicles keep their
lane (narrow), a share of them is changing lanes or drifts (wide), more so off the lane's middle (g), and slow
vehicles move across slowly (p). o and v keep their own distributions; the heading is the arc sine of u / v. Fitted by
maximum likelihood to one row a second of training vehicles, by a bootstrap over vehicles for the intervals; v_full is
fixed.

Goodness of fit: the Kolmogorov-Smirnov distance of y from its distribution, and the standard deviation of u, recorded
against fitted, by offset and by speed.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import ndtr

from policies.data.scenes import I80_FILE, US101_FILE, DataError, Scene, read_i80, read_us101
from policies.data.start_fit import EVERY_FRAMES, main_lanes

FILES = {"i80": I80_FILE, "us101": US101_FILE}
FULL_MPS = 7.0
LEAST_SPEED_MPS = 1.0  # slower vehicles have no lateral speed to speak of
KEYS = ("share", "narrow", "wide", "offset_gain", "speed_power")
LOWEST = np.array([0.002, 0.02, 0.1, 0.0, 0.0])
HIGHEST = np.array([0.5, 0.4, 1.5, 8.0, 2.0])
START = np.array([0.06, 0.08, 0.4, 1.0, 0.7])
QUANTILES = (0.0005, 0.9995)
BANDS_M = (0.0, 0.25, 0.75, 2.0)
BANDS_MPS = (1.0, 4.0, 7.0, 30.0)


@dataclass(frozen=True)
class LateralSample:
    """Rows (n,): lateral speed and speed in m/s, offset in m, and the vehicle that each came from."""

    across: np.ndarray
    speed: np.ndarray
    offset: np.ndarray
    vehicle: np.ndarray


@dataclass(frozen=True)
class LateralFit:
    """The values of KEYS with their 95% intervals.

    high: largest |y| looked at
    ks: of y; rows and vehicles behind it
    bands: (what, from, to, rows, recorded, fitted standard deviation of u)
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    high: float
    ks: float
    rows: int
    vehicles: int
    bands: tuple[tuple[str, float, float, int, float, float], ...]


def sites(data: Path) -> tuple[str, ...]:
    """Of which roads the folder `data` holds scenes as the data pack has them."""
    return tuple(site for site, file in FILES.items() if (data / file).is_file())


def sample(data: Path, site: str) -> LateralSample:
    """Of the data pack's scenes of `site` ("i80", "us101"). Raises DataError where a file is missing or wrong."""
    scenes = [read_i80(data)] if site == "i80" else read_us101(data)
    parts = [_rows(scene, 1000 * k) for k, scene in enumerate(scenes)]
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    if len(columns[0]) < 100:
        raise DataError(f"{data}: only {len(columns[0])} usable rows of training vehicles; a fit needs 100")
    return LateralSample(*columns)


def _rows(scene: Scene, first: int) -> tuple[np.ndarray, ...]:
    across = np.gradient(scene.lateral, scene.dt_s, axis=0)  # the lanes' own direction, whatever the map's is
    use = scene.usable & (scene.vehicle_id < scene.held_out_from) & (scene.lane < main_lanes(scene))
    use &= np.isfinite(across) & (scene.speed >= LEAST_SPEED_MPS)
    use[np.arange(len(use)) % EVERY_FRAMES != 0] = False
    frame, vehicle = np.nonzero(use)
    centre = (0.5 * (len(scene.road.lane_left) - 1) - scene.lane[frame, vehicle]) * scene.road.lane_width_m
    offset = scene.lateral[frame, vehicle] - centre
    lane = scene.lane[frame, vehicle]
    for k in np.unique(lane):  # lanes of the map lie decimetres off the traffic's
        offset[lane == k] -= np.median(offset[lane == k])
    return across[frame, vehicle], scene.speed[frame, vehicle], offset, first + scene.vehicle_id[vehicle]


def scale(values: np.ndarray, sample: LateralSample) -> np.ndarray:
    """u / y of each row."""
    slow = np.minimum(1.0, sample.speed / FULL_MPS)
    return (1.0 + values[3] * sample.offset**2) * slow ** values[4]


def fit(rows: LateralSample, resamples: int = 100, seed: int = 0) -> LateralFit:
    """Fit as the module's text says."""
    names, which = np.unique(rows.vehicle, return_inverse=True)
    best = _most_likely(rows, np.ones(len(rows.across)), START)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(resamples):
        times = np.bincount(rng.integers(len(names), size=len(names)), minlength=len(names))
        drawn.append(_most_likely(rows, times[which].astype(float), best))
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    y = rows.across / scale(best, rows)
    order = np.sort(y)
    below = best[0] * ndtr(order / best[2]) + (1.0 - best[0]) * ndtr(order / best[1])
    steps = np.arange(len(y) + 1) / len(y)
    ks = float(max((steps[1:] - below).max(), (below - steps[:-1]).max()))
    furthest = max(abs(q) for q in np.quantile(y, QUANTILES))
    spread = np.sqrt(best[0] * best[2] ** 2 + (1.0 - best[0]) * best[1] ** 2)
    bands = []
    for what, values, edges in (("offset", np.abs(rows.offset), BANDS_M), ("speed", rows.speed, BANDS_MPS)):
        for a, b in itertools.pairwise(edges):
            here = (values >= a) & (values < b)
            if here.sum() > 10:
                told = float(np.sqrt(np.mean((spread * scale(best, rows)[here]) ** 2)))
                bands.append((what, a, b, int(here.sum()), float(rows.across[here].std()), told))
    return LateralFit(
        dict(zip(KEYS, best.tolist(), strict=True)),
        {key: (float(a), float(b)) for key, a, b in zip(KEYS, low, high, strict=True)},
        float(furthest), ks, len(y), len(names), tuple(bands),
    )  # fmt: skip


def _most_likely(rows: LateralSample, weight: np.ndarray, start: np.ndarray) -> np.ndarray:
    def loss(p: np.ndarray) -> float:
        s = scale(p, rows)
        y = rows.across / s
        density = p[0] / p[2] * np.exp(-0.5 * (y / p[2]) ** 2) + (1.0 - p[0]) / p[1] * np.exp(
            -0.5 * (y / p[1]) ** 2
        )
        return -float(weight @ np.log(np.maximum(density / s, 1e-300))) / float(weight.sum())

    found = minimize(loss, start, method="L-BFGS-B", bounds=list(zip(LOWEST, HIGHEST, strict=True)))
    return np.asarray(found.x)


def lateral_toml(found: LateralFit) -> str:
    """The fit as lines of a scenario's [start] table."""
    v = found.values
    return "\n".join(
        [
            f'lateral_mps = {{ distribution = "normal-mixture", share = {v["share"]:.3f}, narrow = {v["narrow"]:.3f}, '
            f"wide = {v['wide']:.3f}, low = {-found.high:.2f}, high = {found.high:.2f} }}",
            f"lateral_offset_gain = {v['offset_gain']:.2f}",
            f"lateral_full_mps = {FULL_MPS:.1f}",
            f"lateral_speed_power = {v['speed_power']:.2f}",
        ]
    )
