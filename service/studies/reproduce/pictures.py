"""The pictures of a page, as SVG files beside it."""

import base64
from pathlib import Path

import numpy as np

from service.analysis.report import ink
from service.analysis.report.ink import Picture
from service.studies.reproduce.local import Outcome
from service.studies.reproduce.plans import curve_gammas
from service.studies.reproduce.tables import pooled, series_of

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6b6b6b", "#000000")
WHAT = {
    "events": "ratio of rare events",
    "variances": "ratio of variances, training left out",
    "efficiency": "efficiency, training counted",
    "repeats": "efficiency by repeated runs",
}


def pictures_of(outcome: Outcome) -> list[tuple[str, Picture]]:
    """File names and pictures: the paper's figure (both panels, and with training counted), what repeated runs are
    worth where there are any, and p against gamma."""
    repeated = any(len(results) > 1 for results in series_of(outcome).values())
    ratios = [key for key in WHAT if key != "repeats" or repeated] if outcome.results else []
    return [(f"{key}.svg", ratio_picture(outcome, key)) for key in ratios] + [("p.svg", p_picture(outcome))]


def ratio_picture(outcome: Outcome, key: str) -> Picture:
    gammas = np.array(outcome.plan.gammas)
    order = np.argsort(gammas)
    known = []
    with ink.figure(3.3, 6.4) as drawn:
        axes = drawn.add_subplot()
        for i, (name, results) in enumerate(series_of(outcome).items()):
            ratios = [pooled(outcome, results, int(k))[key] for k in order]
            value = np.array([r.value for r in ratios])
            low, high = np.array([r.low for r in ratios]), np.array([r.high for r in ratios])
            there = np.isfinite(value) & (value > 0) & np.isfinite(high) & (low > 0)
            if not there.any():
                continue
            colour, dashed = COLOURS[i % len(COLOURS)], "-" if i < len(COLOURS) // 2 else "--"
            # beside each other, so that the bars can be told apart
            at = gammas[order][there] * (1.0 + 0.004 * (i - 3))
            axes.errorbar(at, value[there], [value[there] - low[there], high[there] - value[there]], color=colour,
                          linestyle=dashed, marker="o", markersize=3.5, elinewidth=0.8, label=name)  # fmt: skip
            known += [*low[there], *high[there]]
        axes.axhline(1.0, color=ink.BASE, linewidth=1.0)
        if known:
            axes.set_ylim(max(min(known) / 1.5, 1e-4), min(max(known) * 1.5, 1e6))
        ink.log_axis(axes, "y", lambda v: f"{v:g}")
        axes.set_xlabel("threshold γ, s")
        axes.set_ylabel(WHAT[key])
        if known:
            drawn.legend(loc="outside lower center", ncols=2, fontsize=7.5)
        return ink.picture(drawn, WHAT[key].capitalize(), f"{WHAT[key]} of each series against the threshold.",
                           "Bars: 95% intervals. Above the grey line the method beats naive Monte Carlo. What is not "
                           "known is not drawn.")  # fmt: skip


def p_picture(outcome: Outcome) -> Picture:
    """The ground truth against gamma, and every run's estimates with their intervals."""
    grid = np.array(curve_gammas(outcome.plan))
    truth = outcome.truth.at(grid)
    with ink.figure(3.6, 6.4) as drawn:
        axes = drawn.add_subplot()
        floor = 0.2 / max(outcome.truth.rollouts, 1)
        axes.fill_between(
            grid, np.maximum(truth["low"], floor), truth["high"], color=ink.BASE, alpha=0.3, lw=0
        )
        axes.plot(
            grid, np.where(truth["p"] > 0, truth["p"], np.nan), color=ink.BASE, label="naive, ground truth"
        )
        count = sum(len(r) for r in series_of(outcome).values())
        k = 0
        for i, (name, results) in enumerate(series_of(outcome).items()):
            for j, result in enumerate(results):
                there = [r for r in result.readings if r.p and r.low is not None and r.high is not None]
                p = np.array([r.p for r in there])
                bars = [
                    p - [max(r.low or 0.0, floor / 10) for r in there],
                    [r.high or 0.0 for r in there] - p,
                ]
                at = np.array([r.gamma for r in there]) * (1.0 + 0.02 * ((k + 0.5) / count - 0.5))
                axes.errorbar(at, p, np.maximum(bars, 0.0), color=COLOURS[i % len(COLOURS)], marker="o",
                              linestyle="none", markersize=3, elinewidth=0.7, label=None if j else name)  # fmt: skip
                k += 1
        axes.set_ylim(floor, 1.5 * max(float(truth["high"].max()), 5 * floor))
        ink.log_axis(axes, "y")
        axes.set_xlabel("threshold γ, s")
        axes.set_ylabel("P0(f ≤ γ)")
        drawn.legend(loc="outside lower center", ncols=2, fontsize=7.5)
        return ink.picture(drawn, "p against the threshold", "p of the ground truth and of every run against gamma.",
                           "Band and bars: 95% intervals.")  # fmt: skip


def write_picture(path: Path, picture: Picture) -> None:
    path.write_bytes(base64.b64decode(picture.source.partition("base64,")[2]))
