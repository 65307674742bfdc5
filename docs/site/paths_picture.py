"""The picture of the method for paths, drawn from a small run of it: paths, checkpoints, weights."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

import ce

_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 960, 430, 20, 34, 46
_FONT = "font-family='system-ui, sans-serif' font-size='14'"
_PLAIN, _HIT, _TEXT = "#7f8ea3", "#d1495b", "#6b7480"
LEVEL, NAIVE, STARTS, POPULATION, SEED = 3.0, 2000, 1000, 70.0, 1


class Remaining:
    """What is missing to the level, in units of what the walk still spreads: a committor made by hand."""

    def log_hazard(self, features: NDArray[np.float32], levels: NDArray[np.float64]) -> NDArray[np.float64]:
        """-z^2 / 2 (n, L)."""
        place, passed = (features[:, 0, j].astype(np.float64) for j in (0, 1))
        z = (
            np.maximum(LEVEL - place[:, None] - levels, 0.0)
            / np.sqrt(np.maximum(1.0 - passed, 0.05))[:, None]
        )
        return np.asarray(-0.5 * z * z)


def walk() -> ce.Simulator:
    """A random walk that ends where it comes to the level."""
    return ce.Simulator(
        base=ce.Product([ce.Normal([0.0], [[0.09]])]),
        start=lambda x: x,
        step=lambda s, z, k: s + 0.1 * z,
        measure=lambda s: LEVEL - s[:, 0],
        horizon=100,
        stop=0.0,
    )


def picture() -> str:
    """The SVG."""
    process, committor = walk(), Remaining()
    levels = np.array([1.0, 0.0])
    naive = ce.paths.all_starts(process, SEED, "train", 0, NAIVE)
    record = ce.paths.drive(process, naive, levels, process.checkpoints, record=True).record
    hazard, *seen = (committor.log_hazard(r.features, levels) for r in record)
    weights = [r.weight / NAIVE for r in record[1:]]
    plan = ce.paths.schedule(
        0.0,
        levels,
        hazard,
        process.checkpoints,
        STARTS,
        POPULATION,
        seen=list(zip(seen, weights, strict=True)),
    )
    roots = ce.paths.kept_starts(process, committor, plan, SEED, "estimate", 0, STARTS)
    driven = ce.paths.drive(process, roots, levels, process.checkpoints, plan, committor, record=True)
    return _drawn(process.checkpoints, driven, roots.size)


def _drawn(checkpoints: tuple[int, ...], driven: ce.paths.Driven, roots: int) -> str:
    record = driven.record
    places = [r.features[:, 0, 0].astype(float) for r in record]
    low = min(float(p.min()) for p in places) - 0.1

    def across(k: int) -> float:
        return _LEFT + (_WIDTH - 2 * _LEFT) * checkpoints[k] / checkpoints[-1]

    def down(place: float) -> float:
        return _TOP + (_HEIGHT - _TOP - _BOTTOM) * (LEVEL - place) / (LEVEL - low)

    leading: list[NDArray[np.bool_]] = [r.after <= 0.0 for r in record]
    for k in range(len(record) - 1, 0, -1):
        leading[k - 1][record[k].parent[leading[k]]] = True
    lines = [
        f"<line x1='{_LEFT}' x2='{_WIDTH - _LEFT}' y1='{_TOP}' y2='{_TOP}' stroke='{_HIT}' stroke-dasharray='6 4'/>"
    ]
    for k in range(len(checkpoints)):
        at = across(k)
        lines.append(
            f"<line x1='{at:.1f}' x2='{at:.1f}' y1='{_TOP}' y2='{_HEIGHT - _BOTTOM}' stroke='{_TEXT}' "
            "stroke-opacity='0.25'/>"
        )
    for k in range(1, len(record)):
        for i, parent in enumerate(record[k].parent.tolist()):
            width = 0.8 + 1.1 * math.log1p(record[k - 1].weight[parent])
            lines.append(
                f"<line x1='{across(k - 1):.1f}' y1='{down(places[k - 1][parent]):.1f}' x2='{across(k):.1f}' "
                f"y2='{down(places[k][i]):.1f}' stroke='{_HIT if leading[k][i] else _PLAIN}' "
                f"stroke-width='{width:.2f}' stroke-linecap='round' stroke-opacity='0.8'/>"
            )
    for k, r in enumerate(record):
        for i in np.flatnonzero(r.after <= 0.0).tolist():
            end = across(k + 1)
            lines.append(
                f"<line x1='{across(k):.1f}' y1='{down(places[k][i]):.1f}' x2='{end:.1f}' y2='{_TOP}' stroke='{_HIT}' "
                f"stroke-width='{0.8 + 1.1 * math.log1p(r.weight[i]):.2f}'/>"
                f"<circle cx='{end:.1f}' cy='{_TOP}' r='4' fill='{_HIT}'/>"
            )
    arrived, mass = int(driven.hits[:, -1].sum()), float(driven.events[:, -1].sum())
    words = [
        (_LEFT, _TOP - 12, f"gamma: {arrived} paths come here, of weights that add up to {mass:.2f}"),
        (_LEFT, _HEIGHT - 26, f"{STARTS} starts drawn, {roots} kept"),
        (_WIDTH // 2 - 60, _HEIGHT - 26, "checkpoints: split or end"),
        (
            _LEFT,
            _HEIGHT - 6,
            "width: weight (how many ordinary paths one stands for); red: what leads to an event",
        ),
    ]
    texts = [f"<text x='{x}' y='{y}' fill='{_TEXT}' {_FONT}>{words_}</text>" for x, y, words_ in words]
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {_WIDTH} {_HEIGHT}' role='img'>"
        "<title>Paths from checkpoint to checkpoint, split on the way to the event and ended elsewhere</title>"
        + "".join(lines)
        + "".join(texts)
        + "</svg>\n"
    )
