"""The fitted starts as a scenario's TOML, as JSON, and as pictures to look at."""

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from policies.data.start_fit import BetaFit

LINE_M = 100.0  # where the scenario puts the line across the road that stations are measured from
LABELS = {
    "station_m": "nearest vehicle from a line across lanes 2 to 6, m",
    "station_m_lane_1": "nearest vehicle from a line across lane 1 (HOV), m",
    "lane_offset_m": "offset from the lane's centre, m, positive to the left",
    "heading_deg": "heading relative to the lane, degrees, positive to the left",
    "speed_mps": "speed in lanes 2 to 6, m/s",
    "speed_mps_lane_1": "speed in lane 1 (HOV), m/s",
}
DATA_COLOUR, FIT_COLOUR = "#9aa5b1", "#b3261e"


def beta_toml(fit: BetaFit, shift: float = 0.0) -> str:
    """The fit as an inline table of a scenario file."""
    return (
        f'{{ distribution = "beta", alpha = {fit.alpha:.3f}, beta = {fit.beta:.3f}, '
        f"low = {fit.low + shift:.3f}, high = {fit.high + shift:.3f} }}"
    )


def toml(fits: dict[str, BetaFit]) -> str:
    """The lines of [start], and those of lane 1."""
    lines = ["[start]"]
    for name in ("station_m", "lane_offset_m", "heading_deg", "speed_mps"):
        lines.append(f"{name} = {beta_toml(fits[name], LINE_M if name == 'station_m' else 0.0)}")
    lines += ["", "# of the vehicle in lane 1"]
    lines.append(f"station_m = {beta_toml(fits['station_m_lane_1'], LINE_M)}")
    lines.append(f"speed_mps = {beta_toml(fits['speed_mps_lane_1'])}")
    return "\n".join(lines)


def as_dict(fit: BetaFit) -> dict[str, Any]:
    return {
        "distribution": "beta",
        "alpha": fit.alpha,
        "alpha_interval_95": list(fit.alpha_interval),
        "beta": fit.beta,
        "beta_interval_95": list(fit.beta_interval),
        "low": fit.low,
        "high": fit.high,
        "rows": len(fit.x),
        "vehicles": fit.vehicles,
        "share_outside": fit.outside,
        "ks_distance": fit.ks,
        "sample_mean": float(fit.x.mean()),
        "sample_sd": float(fit.x.std()),
        "fit_mean": float(fit.low + (fit.high - fit.low) * fit.alpha / (fit.alpha + fit.beta)),
    }


def draw(name: str, fit: BetaFit, path: Path) -> None:
    """Histogram with the fitted density, and a quantile-quantile plot."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.6), layout="constrained")
    left.hist(fit.x, bins=50, range=(fit.low, fit.high), density=True, color=DATA_COLOUR, label="recorded")
    grid = np.linspace(fit.low, fit.high, 402)[1:-1]
    left.plot(grid, fit.density(grid), color=FIT_COLOUR, label=f"Beta({fit.alpha:.2f}, {fit.beta:.2f})")
    left.set_xlabel(LABELS[name])
    left.set_ylabel("density")
    left.legend(frameon=False)
    q = (np.arange(199) + 1.0) / 200.0
    right.plot([fit.low, fit.high], [fit.low, fit.high], color=FIT_COLOUR, linewidth=1.0)
    right.plot(fit.quantile(q), np.quantile(fit.x, q), ".", color="#3b4754", markersize=3.0)
    right.set_xlabel("fitted quantile")
    right.set_ylabel("recorded quantile")
    right.set_aspect("equal")
    figure.suptitle(
        f"NGSIM I-80: {len(fit.x):,} rows of {fit.vehicles:,} vehicles; "
        f"Kolmogorov-Smirnov distance {fit.ks:.3f}; {100.0 * fit.outside:.1f}% outside",
        fontsize=10,
    )
    figure.savefig(path, dpi=90)
    plt.close(figure)
