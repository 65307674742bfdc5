"""Where vehicles start in the scenario `i80-data`: Beta distributions fitted to the NGSIM I-80 recordings.

Each marginal is Beta(alpha, beta) stretched to [low, high]. The ends come first: the 0.5% and 99.5% quantiles of the
sample, each moved outward by MARGIN of the distance between them, but not beyond the marginal's own bounds (no speed
below 0; offsets and headings such that boxes in neighbouring lanes cannot touch). Samples outside are left out and
counted: the fit is of the distribution given that it lies inside. Then alpha and beta by maximum likelihood,

    maximise  mean[(alpha - 1) log u + (beta - 1) log(1 - u)] - log B(alpha, beta),   u = (x - low) / (high - low),

which needs the sample's mean log u and mean log(1 - u) only. Rows of one vehicle are alike, so intervals are from a
bootstrap over vehicles, and the Kolmogorov-Smirnov distance is given without a p-value.

Only training vehicles are used (NGSIM numbers below TRAIN_BELOW, as for the drivers).

station_m      distance from a line across the road to the nearest vehicle in the lane at a random moment: so far from
               each other do the nearest vehicles of the lanes start; lanes 2 to 6, and lane 1 (HOV) apart (scene)
lane_offset_m  from the centre of the vehicle's own lane, lanes 1 to 6 (scene)
heading_deg    relative to the lane (scene)
speed_mps      lanes 2 to 6, and lane 1 (HOV) apart (Coifman and Li: all vehicles, 880 s)

From imported tables everything comes from their first road's scenes: lane 1 and all other main lanes apart.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize
from scipy.special import betaln, psi
from scipy.stats import beta as beta_distribution
from scipy.stats import kstest, spearmanr

from policies.columns import Values
from policies.data.ngsim_pack import read_pack
from policies.data.scenes import I80_HELD_OUT_FROM, DataError, Scene, read_i80
from policies.data.tables import RAMP_SHARE, is_table, read_tables

COIFMAN_FILE = "trajectories/coifman_li_2017_i80_cam6_0400-0415.parquet"
TRAIN_BELOW = I80_HELD_OUT_FROM
MAIN_LANES = 6
EVERY_FRAMES = 10  # one row a second
LINES_M = np.arange(100.0, 401.0, 25.0)  # lines across the recorded 500 m
QUANTILES = (0.005, 0.995)
MARGIN = 0.05
OFFSET_BOUND_M = 0.75  # with headings up to 3 degrees, cars of 4.5 x 1.8 m keep to their 3.66 m lanes
HEADING_BOUND_DEG = 3.0
BOUNDS = {
    "station_m": (-90.0, 90.0),
    "station_m_lane_1": (-90.0, 90.0),
    "lane_offset_m": (-OFFSET_BOUND_M, OFFSET_BOUND_M),
    "heading_deg": (-HEADING_BOUND_DEG, HEADING_BOUND_DEG),
    "speed_mps": (0.0, 40.0),
    "speed_mps_lane_1": (0.0, 40.0),
}
LARGEST = 900.0  # of alpha and beta


@dataclass(frozen=True)
class BetaFit:
    """Beta(alpha, beta) on [low, high] with the fit's evidence.

    x (n,): the sample inside [low, high]
    outside: share of the sample left out
    intervals: 95% of alpha and of beta, bootstrap over vehicles
    ks: the largest distance between the sample's distribution function and the fit's
    """

    alpha: float
    beta: float
    low: float
    high: float
    x: np.ndarray
    vehicles: int
    outside: float
    ks: float
    alpha_interval: tuple[float, float]
    beta_interval: tuple[float, float]

    def quantile(self, q: np.ndarray) -> np.ndarray:
        return self.low + (self.high - self.low) * beta_distribution.ppf(q, self.alpha, self.beta)

    def density(self, x: np.ndarray) -> np.ndarray:
        width = self.high - self.low
        return beta_distribution.pdf((x - self.low) / width, self.alpha, self.beta) / width


def samples(data: Path) -> dict[str, Values]:
    """The samples (BOUNDS) of the data pack in folder `data`, or of imported tables (their first road; speeds from the
    scenes, too). Raises DataError where a file is missing or wrong."""
    scenes, from_pack = _scenes(data)
    parts = [_of_scene(scene) for scene in scenes]
    found = {name: Values.joined([part[name] for part in parts]) for name in parts[0]}
    return found | _coifman_speeds(data / COIFMAN_FILE) if from_pack else found


def _scenes(data: Path) -> tuple[list[Scene], bool]:
    """The scenes of the I-80 site, or of the first road in imported tables; whether they are the data pack's."""
    if not is_table(data):
        return [read_i80(data)], True
    scenes, _ = read_tables(data)
    return [scene for scene in scenes if scene.road.name == scenes[0].road.name], False


def _of_scene(scene: Scene) -> dict[str, Values]:
    train = scene.vehicle_id < scene.held_out_from
    frame, vehicle = _rows(scene, train)
    lane = scene.lane[frame, vehicle]
    centre = (0.5 * (len(scene.road.lane_left) - 1) - lane) * scene.road.lane_width_m
    who, speed = scene.vehicle_id[vehicle], scene.speed[frame, vehicle]
    return {
        "station_m": _nearest(scene, train, range(1, main_lanes(scene))),
        "station_m_lane_1": _nearest(scene, train, range(1)),
        "lane_offset_m": Values(scene.lateral[frame, vehicle] - centre, who),
        "heading_deg": Values(np.degrees(scene.heading[frame, vehicle]), who),
        "speed_mps": Values(speed[lane > 0], who[lane > 0]),
        "speed_mps_lane_1": Values(speed[lane == 0], who[lane == 0]),
    }


def main_lanes(scene: Scene) -> int:
    """How many lanes from the left carry traffic all along: the rest are ramps."""
    rows = np.bincount(scene.lane[scene.lane >= 0], minlength=len(scene.road.lane_left))
    busy = np.flatnonzero(rows > RAMP_SHARE * np.median(rows[rows > 0]))
    return min(int(busy[-1]) + 1, MAIN_LANES)


def dependence(data: Path) -> dict[str, float]:
    """Rank correlations that the scenario's independent marginals ignore."""
    scenes, _ = _scenes(data)
    offset, heading, speed = [], [], []
    for scene in scenes:
        frame, vehicle = _rows(scene, scene.vehicle_id < scene.held_out_from)
        d, spacing = scene.lateral[frame, vehicle], scene.road.lane_width_m
        offset.append(d - np.round(d / spacing) * spacing)
        heading.append(scene.heading[frame, vehicle])
        speed.append(scene.speed[frame, vehicle])
    columns = {
        "offset": np.concatenate(offset),
        "heading": np.concatenate(heading),
        "speed": np.concatenate(speed),
    }
    pairs = (("offset", "heading"), ("offset", "speed"), ("heading", "speed"))
    found = {f"{a}, {b}": float(spearmanr(columns[a], columns[b])[0]) for a, b in pairs}
    found["speeds of neighbours in adjacent lanes 2 to 6"] = _neighbours_speeds(scenes)
    return found


def _rows(scene: Scene, train: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    use = scene.usable & train & (scene.lane < main_lanes(scene))
    use[np.arange(len(use)) % EVERY_FRAMES != 0] = False
    frame, vehicle = np.nonzero(use)
    return frame, vehicle


def _nearest(scene: Scene, train: np.ndarray, lanes: range) -> Values:
    """Signed distance from a line to the nearest vehicle's centre, where the line lies between training vehicles."""
    values, who = [], []
    for f in range(0, len(scene.frame), EVERY_FRAMES):
        for lane in lanes:
            here = np.flatnonzero(scene.lane[f] == lane)
            here = here[np.argsort(scene.station[f, here])]
            station = scene.station[f, here]
            for line in LINES_M:
                k = int(np.searchsorted(station, line))
                if not 0 < k < len(here) or not (train[here[k - 1]] and train[here[k]]):
                    continue
                nearest = k if station[k] - line < line - station[k - 1] else k - 1
                values.append(station[nearest] - line)
                who.append(scene.vehicle_id[here[nearest]])
    return Values(np.array(values), np.array(who, dtype=np.int64))


def _coifman_speeds(path: Path) -> dict[str, Values]:
    if not path.is_file():
        raise DataError(
            f"{path}: no such file; --data must name the data pack's folder, which holds {COIFMAN_FILE}"
        )
    layout, tables = read_pack(path)
    if layout != "coifman":
        raise DataError(f"{path}: found the layout {layout}, expected coifman")
    table = next(tables)
    speed, lane, who, frame, flags = (
        table[name].to_numpy() for name in ("speed_mps", "lane", "vehicle_id", "frame", "flags")
    )
    use = (who < TRAIN_BELOW) & (flags == 0) & (frame % EVERY_FRAMES == 0)
    hov, general = use & (lane == 1), use & (lane >= 2) & (lane <= MAIN_LANES)
    return {
        "speed_mps": Values(speed[general], who[general]),
        "speed_mps_lane_1": Values(speed[hov], who[hov]),
    }


def _neighbours_speeds(scenes: list[Scene]) -> float:
    """Rank correlation of the speeds of the vehicles nearest to a line in adjacent lanes (2 to 6)."""
    left, right = [], []
    for scene in scenes:
        for f in range(0, len(scene.frame), EVERY_FRAMES):
            for line in LINES_M[::4]:
                speeds = []
                for lane in range(1, main_lanes(scene)):
                    here = np.flatnonzero((scene.lane[f] == lane) & (np.abs(scene.station[f] - line) < 20.0))
                    near = here[np.argmin(np.abs(scene.station[f, here] - line))] if len(here) else -1
                    speeds.append(scene.speed[f, near] if near >= 0 else np.nan)
                left += speeds[:-1]
                right += speeds[1:]
    both = np.isfinite(left) & np.isfinite(right)
    return (
        float(spearmanr(np.array(left)[both], np.array(right)[both])[0]) if both.sum() > 2 else float("nan")
    )


def fit_beta(sample: Values, bounds: tuple[float, float], resamples: int = 400, seed: int = 0) -> BetaFit:
    """Fit as the module's text says. Raises DataError for a sample too small or without spread."""
    if len(np.unique(sample.vehicle)) < 2 or not np.ptp(sample.x) > 0.0:
        raise DataError(f"a fit needs different values of at least 2 vehicles; found {len(sample.x)} values")
    low, high = ends(sample.x, bounds)
    inside = (sample.x > low) & (sample.x < high)
    x = sample.x[inside]
    u = (x - low) / (high - low)
    names, vehicle = np.unique(sample.vehicle[inside], return_inverse=True)
    sums = np.column_stack(
        [np.bincount(vehicle, weights=w) for w in (np.log(u), np.log1p(-u), np.ones_like(u))]
    )
    alpha, beta = most_likely(*(sums[:, :2].sum(axis=0) / sums[:, 2].sum()))
    rng = np.random.default_rng(seed)
    drawn = np.empty((resamples, 2))
    for i in range(resamples):
        total = sums[rng.integers(len(names), size=len(names))].sum(axis=0)
        drawn[i] = most_likely(total[0] / total[2], total[1] / total[2], (alpha, beta))
    (a_low, b_low), (a_high, b_high) = np.quantile(drawn, (0.025, 0.975), axis=0)
    ks = float(kstest(u, beta_distribution(alpha, beta).cdf).statistic)
    return BetaFit(
        alpha,
        beta,
        low,
        high,
        x,
        len(names),
        float(1.0 - inside.mean()),
        ks,
        (a_low, a_high),
        (b_low, b_high),
    )


def ends(x: np.ndarray, bounds: tuple[float, float]) -> tuple[float, float]:
    """The interval: QUANTILES of x, widened by MARGIN of their distance, within bounds."""
    first, last = np.quantile(x, QUANTILES)
    room = MARGIN * (last - first)
    return max(float(first - room), bounds[0]), min(float(last + room), bounds[1])


def most_likely(
    mean_log_u: float, mean_log_1_u: float, start: tuple[float, float] = (2.0, 2.0)
) -> tuple[float, float]:
    """alpha and beta of the most likely Beta distribution on (0, 1) for these mean logarithms."""

    def loss(p: np.ndarray) -> tuple[float, np.ndarray]:
        a, b = np.exp(p)
        value = betaln(a, b) - (a - 1.0) * mean_log_u - (b - 1.0) * mean_log_1_u
        slope = np.array([psi(a) - psi(a + b) - mean_log_u, psi(b) - psi(a + b) - mean_log_1_u])
        return float(value), slope * np.exp(p)

    box = [(np.log(1e-2), np.log(LARGEST))] * 2
    found = minimize(loss, np.log(start), jac=True, method="L-BFGS-B", bounds=box, options={"ftol": 1e-14})
    alpha, beta = np.exp(found.x)
    return float(alpha), float(beta)
