"""Pictures of a road: the plan with north up, and lanes, lines and curvature against the station."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sumo_nets.chain import open_net
from sumo_nets.check import distance_to_lane, expected, reference_lines
from sumo_nets.corridor import BUILT_IN, Corridor, load_corridor
from sumo_nets.curves import resample
from sumo_nets.strips import admits

HOV, LANE, AUXILIARY, RAMP = "#f2c14e", "#c9d3dc", "#9fc2a8", "#c8b6d8"
CAD, OSM = "#b3263a", "#1f5fa8"
SHOWN_M = 32.0  # lateral distance from the reference line that the stretched view reaches


def plot(name_or_path: str | Path, out: str | Path, edges: Sequence[str] | None = None) -> Path:
    """Draw a built-in network, or the corridor `edges` of a user's, to the PNG `out`; returns its path."""
    road = load_corridor(name_or_path, edges)
    net = open_net(Path(road.net_path))
    lines = reference_lines(road.name) if str(name_or_path) in BUILT_IN else {}
    figure = Figure(figsize=(15.0, 8.4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 3.4), height_ratios=(2.6, 1.0, 1.0))
    stretched = figure.add_subplot(grid[0, 1])
    _plan(figure.add_subplot(grid[:, 0]), road, net, lines)
    _stretched(stretched, road, net, lines)
    _distances(figure.add_subplot(grid[1, 1], sharex=stretched), road, lines)
    _curvature(figure.add_subplot(grid[2, 1], sharex=stretched), road)
    widest, narrowest = road.lanes_at(road.station_m).max(), road.lanes_at(road.station_m).min()
    lanes = f"{widest}" if widest == narrowest else f"{narrowest} to {widest}"
    figure.suptitle(f"{road.name}: {road.length_m:.0f} m, {lanes} lanes")
    figure.savefig(Path(out), dpi=110)
    return Path(out)


def _surface(net: Any, road: Corridor) -> Iterator[tuple[np.ndarray, float, str]]:
    """(points (n, 2), width, colour) of every lane of the network outside junctions."""
    for edge in net.getEdges(withInternal=False):
        lanes = edge.getLanes()
        for lane in lanes:
            colour = LANE if edge.getID() in road.edges else RAMP
            if edge.getID() in road.edges and not admits(lane, "passenger"):
                colour = HOV
            yield np.array(lane.getShape(), float)[:, :2], lane.getWidth(), colour


def _ribbon(points: np.ndarray, width: float) -> np.ndarray:
    tangent = np.gradient(points, axis=0)
    tangent /= np.hypot(*tangent.T)[:, None]
    aside = np.column_stack([-tangent[:, 1], tangent[:, 0]]) * width / 2.0
    return np.concatenate([points + aside, (points - aside)[::-1]])


def _plan(axes: Axes, road: Corridor, net: Any, lines: dict[str, np.ndarray]) -> None:
    for points, width, colour in _surface(net, road):
        axes.fill(*_ribbon(points, width).T, color=colour, lw=0)
    for name, line in lines.items():
        axes.plot(*line.T, color=CAD if name.startswith("cad") else OSM, lw=0.4)
    for k in np.arange(0, len(road.station_m), 250):
        x, y, _ = road.to_xy(road.station_m[k], road.road_left[k] + 8.0)
        axes.annotate(f"{road.station_m[k]:.0f}", (float(x), float(y)), fontsize=7, ha="right", va="center")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(title="plan, north up (stations in m)", xlabel="x, east (m)", ylabel="y, north (m)")
    axes.annotate(
        "N",
        (0.93, 0.97),
        (0.93, 0.90),
        xycoords="axes fraction",
        ha="center",
        arrowprops={"arrowstyle": "->"},
    )


def _stretched(axes: Axes, road: Corridor, net: Any, lines: dict[str, np.ndarray]) -> None:
    for points, width, colour in _surface(net, road):
        if colour != RAMP:
            continue
        s, offset = road.project(*resample(points, 2.0).T)
        shown = (s > 0) & (s < road.length_m) & (np.abs(offset) < SHOWN_M)
        if shown.any():
            axes.fill_between(
                s[shown], (offset - width / 2)[shown], (offset + width / 2)[shown], color=RAMP, lw=0
            )
    hov = set(np.flatnonzero(road.reserved.any(axis=1)))
    for lane in range(road.lane_count):
        through = np.isfinite(road.lane_left[lane]).all()
        colour = HOV if lane in hov else LANE if through else AUXILIARY
        axes.fill_between(road.station_m, road.lane_right[lane], road.lane_left[lane], color=colour, lw=0)
        for side in (road.lane_left[lane], road.lane_right[lane]):
            axes.plot(road.station_m, side, color="white", lw=0.7)
        present = np.isfinite(road.lane_left[lane])
        starts = np.flatnonzero(present & ~np.r_[False, present[:-1]])
        for k in [*starts, int(0.9 * len(present))] if through else starts:
            at = min(road.station_m[k] + 0.005 * road.length_m, road.length_m)
            label = f"lane {lane + 1}" + (" HOV" if lane in hov else "")
            axes.annotate(
                label, (at, float(road.lane_center(lane, road.station_m[k]))), fontsize=7, va="center"
            )
    for name, line in lines.items():
        s, offset = road.project(*resample(line, 2.0).T)
        shown = (s > 0) & (s < road.length_m) & (np.abs(offset) < SHOWN_M)
        style = "--" if "BOUNDARY" in name else "-"
        if shown.any():
            colour = CAD if name.startswith("cad") else OSM
            axes.plot(s[shown], offset[shown], style, color=colour, lw=0.7)
    _legend(axes, bool(lines), bool(hov))
    reach = (float(road.road_right.min()) - 15.0, float(road.road_left.max()) + 6.0)
    axes.set(title="stretched: lateral offset against station", ylabel="offset (m, + left)", ylim=reach)
    axes.set_xlim(0.0, road.length_m)


def _legend(axes: Axes, with_lines: bool, with_hov: bool) -> None:
    entries = [(LANE, "through lane"), (AUXILIARY, "auxiliary lane"), (RAMP, "other edge")]
    if with_hov:
        entries.insert(1, (HOV, "HOV lane"))
    handles: list[Artist] = [
        axes.fill_between([], [], color=colour, label=label) for colour, label in entries
    ]
    if with_lines:
        for colour, style, label in (
            (CAD, "-", "CAD centre line"),
            (CAD, "--", "CAD boundary"),
            (OSM, "-", "OSM lane"),
        ):
            handles += axes.plot([], [], style, color=colour, lw=0.9, label=label)
    axes.legend(handles=handles, fontsize=7, ncols=7, loc="lower center")


def _distances(axes: Axes, road: Corridor, lines: dict[str, np.ndarray]) -> None:
    """Distance of the surveyed lines from the centres of the lanes that the check compares them with."""
    for c in expected(road.name).comparisons if lines else ():
        s, apart = distance_to_lane(road, lines[c.line], c.lane, c.from_m, c.to_m)
        axes.plot(s, apart, "-", color=CAD if c.line.startswith("cad") else OSM, lw=0.8)
    axes.axhline(0.0, color="0.4", lw=0.5)
    axes.set(ylabel="surveyed line -\nlane centre (m)", ylim=(-2.0, 2.0))
    if not lines:
        axes.annotate("no surveyed lines", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.5")


def _curvature(axes: Axes, road: Corridor) -> None:
    axes.plot(road.station_m, road.ref_curvature * 1e3, color="0.2", lw=1.0)
    axes.axhline(0.0, color="0.6", lw=0.5)
    axes.set(ylabel="curvature (1/km)", xlabel="station (m)")
