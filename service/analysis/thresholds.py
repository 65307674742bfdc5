"""Thresholds at which p is worth showing."""

from collections.abc import Sequence

import numpy as np

from service.evaluation.record import JobRecord
from service.world.scenario.measures import measure_kind, span

CURVE_POINTS = 60
CURVE_SPAN = 4.0  # the curve runs from gamma / CURVE_SPAN to gamma * CURVE_SPAN


def curve_gammas(records: Sequence[JobRecord]) -> np.ndarray:
    """Thresholds worth showing: around gamma, not below the lowest f that any job has met."""
    gamma = records[0].estimate.gamma
    usual = span(measure_kind(records[0].job.scenario.safety.measure).unit, gamma)
    met = np.concatenate([r.estimate.f[np.isfinite(r.estimate.f)] for r in records])
    lowest = float(met.min()) if met.size else gamma
    if gamma > 0 and usual[0] == 0.0:
        low = min(max(gamma / CURVE_SPAN, lowest), gamma)
        grid = np.geomspace(low, gamma * CURVE_SPAN, CURVE_POINTS) if low > 0 else None
    else:
        grid = None
    if grid is None:
        grid = np.linspace(min(max(usual[0], lowest), gamma), usual[1], CURVE_POINTS)
    return np.unique(np.append(grid, gamma))
