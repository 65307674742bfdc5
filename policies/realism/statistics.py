"""Distances between samples, and intervals by a bootstrap over vehicles (a vehicle's rows are alike)."""

from collections.abc import Callable

import numpy as np
from scipy.spatial.distance import jensenshannon
from scipy.stats import wasserstein_distance

from policies.columns import Values

BINS = 40
# quantiles of the data between which bins lie; what is outside falls into the outer bins
ENDS = (
    0.002,
    0.998,
)
RESAMPLES = 200


def vehicle_bootstrap(
    vehicle: np.ndarray,
    statistic: Callable[[np.ndarray], float],
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
) -> tuple[float, float]:
    """95% interval of statistic(weights (n,)) where each resample of vehicles gives its rows their multiplicity."""
    _, index = np.unique(vehicle, return_inverse=True)
    n = int(index.max()) + 1
    drawn = [
        statistic(np.bincount(rng.integers(0, n, n), minlength=n)[index].astype(float))
        for _ in range(resamples)
    ]
    low, high = np.nanquantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def root_mean_square(error: np.ndarray, vehicle: np.ndarray, rng: np.random.Generator) -> dict:
    """Root mean square and mean absolute value of errors (n,), with intervals over vehicles."""

    def rms(w: np.ndarray) -> float:
        return float(np.sqrt(np.average(error**2, weights=w)))

    def mean(w: np.ndarray) -> float:
        return float(np.average(np.abs(error), weights=w))

    one = np.ones(len(error))
    return {
        "rms": rounded(rms(one)),
        "rms_interval_95": [rounded(x) for x in vehicle_bootstrap(vehicle, rms, rng)],
        "mean": rounded(mean(one)),
        "mean_interval_95": [rounded(x) for x in vehicle_bootstrap(vehicle, mean, rng)],
    }


def rate(count: np.ndarray, size: np.ndarray, vehicle: np.ndarray, rng: np.random.Generator) -> dict:
    """sum(count) / sum(size) with its interval over vehicles."""

    def ratio(w: np.ndarray) -> float:
        total = float(np.dot(w, size))
        return float(np.dot(w, count)) / total if total > 0.0 else np.nan

    return {
        "value": rounded(ratio(np.ones(len(count))), 6),
        "interval_95": [rounded(x, 6) for x in vehicle_bootstrap(vehicle, ratio, rng)],
        "count": int(count.sum()),
        "of": rounded(float(size.sum())),
    }


def bins(data: Values) -> np.ndarray:
    """Edges of BINS bins over the data's range."""
    low, high = np.quantile(data.x, ENDS) if len(data.x) else (0.0, 1.0)
    if high - low < 1e-9:  # all alike
        low, high = low - 0.5, high + 0.5
    return np.linspace(low, high, BINS + 1)


def histogram(values: Values, edges: np.ndarray, weights: np.ndarray | None = None) -> np.ndarray:
    """Shares (BINS,) that sum to 1; values beyond the edges count in the outer bins."""
    inside = np.clip(values.x, edges[0], edges[-1])
    found = np.histogram(inside, edges, weights=weights)[0].astype(float)
    return found / max(found.sum(), 1e-12)


def distances(data: Values, model: Values, rng: np.random.Generator, resamples: int = 60) -> dict:
    """Wasserstein (in the quantity's unit) and Jensen-Shannon distance (0 to 1, base 2) of a model's values to the
    data's, with intervals over the model's vehicles."""
    if min(len(data.x), len(model.x)) < 2:
        return {"rows": len(model.x)}
    edges = bins(data)
    shape = histogram(data, edges)

    def wasserstein(w: np.ndarray) -> float:
        return float(wasserstein_distance(data.x, model.x, v_weights=w))

    def divergence(w: np.ndarray) -> float:
        return float(jensenshannon(shape, histogram(model, edges, w), base=2))

    one = np.ones(len(model.x))
    return {
        "rows": len(model.x),
        "vehicles": len(np.unique(model.vehicle)),
        "mean": rounded(float(model.x.mean()), 4),
        "sd": rounded(float(model.x.std()), 4),
        "wasserstein": rounded(wasserstein(one), 4),
        "wasserstein_interval_95": [
            rounded(x, 4) for x in vehicle_bootstrap(model.vehicle, wasserstein, rng, resamples)
        ],
        "jensen_shannon": rounded(divergence(one), 4),
        "jensen_shannon_interval_95": [
            rounded(x, 4) for x in vehicle_bootstrap(model.vehicle, divergence, rng, resamples)
        ],
    }


def rounded(x: float, digits: int = 3) -> float | None:
    """`x` for JSON: None where it is not finite."""
    return round(float(x), digits) if np.isfinite(x) else None
