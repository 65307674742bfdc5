"""How a failure mode usually goes, in one sentence."""

from collections.abc import Sequence

import numpy as np

from service.analysis.failures.motion import Motion


def typical(motions: Sequence[Motion], weights: np.ndarray) -> str:
    """Weighted medians, with the middle 80%, of what a reader wants to know of a mode; "" where nothing is known."""
    if not motions or len(motions) != len(weights):
        return ""

    def of(name: str) -> tuple[float, float, float]:
        values = np.array([float(getattr(m, name)) for m in motions])
        low, middle, high = _quantiles(values, weights, (0.1, 0.5, 0.9))
        return low, middle, high

    ego, other, at = of("ego_speed_mps"), of("other_speed_mps"), of("time_s")
    along = abs(of("gap_along_m")[1]), of("gap_along_m")[1] > 0
    across = of("gap_across_m")
    where = f"{along[0]:.1f} m apart along the road" if along[1] else "side by side"
    if across[1] > 0:
        where += f", {_spread(across)} m between the sides"
    return (
        f"ego at {_spread(ego)} m/s, the other at {_spread(other)} m/s, {where}, "
        f"{_spread(at)} s after the start"
    )


def _spread(value: tuple[float, float, float]) -> str:
    low, middle, high = (f"{one:.1f}" for one in value)
    return middle if low == high else f"{middle} ({low} to {high})"


def _quantiles(values: np.ndarray, weights: np.ndarray, levels: Sequence[float]) -> list[float]:
    """Of a weighted sample: the smallest value that so much of the weight does not exceed."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    at = np.searchsorted(total, np.array(levels) * total[-1] * (1 - 1e-12))
    return [float(values[order[min(int(i), len(order) - 1)]]) for i in at]
