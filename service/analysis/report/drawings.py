"""A dangerous rollout as a picture: the road from above, a close-up, the safety measure and the speeds."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from service.analysis.report import ink
from service.analysis.report.dangerous import ShownRollout
from service.analysis.report.ink import Picture
from service.analysis.trace import Trace
from service.analysis.wording import quantity, significant
from service.world import agents as A
from service.world.scenario.measures import measure_kind, unit_at
from sumo_nets.corridor import Corridor

WHOLE_S = 20.0  # a longer rollout is drawn around its smallest time to collision only
BEFORE_S, AFTER_S = 12.0, 4.0
CLOSE_UP_M = (22.0, 5.6)  # half the close-up's length and width
GREATEST_S = 30.0


def drawing(rollout: ShownRollout, facts: dict[str, Any], corridor: Corridor) -> Picture | None:
    """The picture of a rollout; None where it could not be run again."""
    trace = rollout.trace
    if trace is None or not trace.measured.size:
        return None
    k = int(np.argmin(np.where(np.isnan(trace.measured), np.inf, trace.measured)))
    kind = measure_kind(trace.measure)
    shown = _window(trace.time_s, k)
    gamma, f = rollout.record.estimate.gamma, rollout.failure.f
    with ink.figure(6.3) as drawn:
        over, close, measured, speed = drawn.subplots(
            4, 1, gridspec_kw={"height_ratios": [1.7, 1.25, 1.0, 1.0]}, squeeze=True
        )
        _overview(over, trace, rollout.threat, corridor, k, shown)
        _close_up(close, trace, rollout.threat, corridor, k)
        _measured(measured, trace, gamma, k, shown)
        _speeds(speed, trace, rollout.threat, k, shown)
        measured.sharex(speed)
        title = f"Rank {facts['rank']}: {facts['mode_name']}; f = {significant(f)} {unit_at(kind.unit, f)}".rstrip()
        with_whom = f" to {facts['other']}" if facts["other"] else ""
        return ink.picture(
            drawn,
            title,
            f"Rollout {facts['row']}: the {kind.words.rstrip(',')}, {significant(trace.rollout.f)} "
            f"{unit_at(kind.unit, trace.rollout.f)}{with_whom}, "
            f"comes {facts['worst_at_s']:.1f} s after the start; the rollout ends with {facts['outcome']} after "
            f"{trace.time_s[-1]:.1f} s.",
            "",
        )


def _window(time_s: np.ndarray, k: int) -> np.ndarray:
    if time_s[-1] <= WHOLE_S:
        return np.arange(time_s.size)
    return np.flatnonzero((time_s >= time_s[k] - BEFORE_S) & (time_s <= time_s[k] + AFTER_S))


def _ink_of(trace: Trace, i: int, threat: int | None) -> str:
    return ink.EGO if i == trace.ego else ink.THREAT if i == threat else ink.OTHER


def _lines(axes: Axes, corridor: Corridor, low_m: float, high_m: float) -> None:
    """The road's edges and lane markings between two stations."""
    at = slice(max(int(low_m / corridor.ds_m), 0), int(high_m / corridor.ds_m) + 2)
    station = corridor.station_m[at]
    for left, right in zip(corridor.lane_left[:, at], corridor.lane_right[:, at], strict=True):
        for edge in (left, right):
            axes.plot(station, edge, color="#9a9a9a", linewidth=0.7, linestyle=(0, (6, 5)), zorder=1)
    for edge in (corridor.road_left[at], corridor.road_right[at]):
        axes.plot(station, edge, color="#4d4d4d", linewidth=1.2, zorder=1.5)


def _box(agent: np.ndarray, station_m: float, corridor: Corridor) -> np.ndarray:
    """Corners (4, 2) of a vehicle's box as station and offset."""
    at = int(corridor.nearest_station(station_m))
    angle = agent[A.HEADING_RAD] - float(corridor.ref_heading[at])
    c, s = math.cos(angle), math.sin(angle)
    along = 0.5 * agent[A.LENGTH_M] * np.array([1, 1, -1, -1])
    across = 0.5 * agent[A.WIDTH_M] * np.array([1, -1, -1, 1])
    return np.column_stack([station_m + c * along - s * across, agent[A.OFFSET_M] + s * along + c * across])


def _boxes(axes: Axes, trace: Trace, threat: int | None, corridor: Corridor, k: int) -> None:
    for i in range(len(trace.names)):
        agent = trace.agents[k, i]
        if agent[A.ACTIVE] != 0.0:
            corners = _box(agent, float(trace.station_m[k, i]), corridor)
            axes.add_patch(
                Polygon(
                    corners, facecolor=_ink_of(trace, i, threat), edgecolor="#1f1f1f", linewidth=0.6, zorder=4
                )
            )


def _overview(
    axes: Axes, trace: Trace, threat: int | None, corridor: Corridor, k: int, shown: np.ndarray
) -> None:
    active = trace.agents[shown][:, :, A.ACTIVE] != 0.0
    station = np.where(active, trace.station_m[shown], np.nan)
    offset = np.where(active, trace.agents[shown][:, :, A.OFFSET_M], np.nan)
    low, high = float(np.nanmin(station)) - 8.0, float(np.nanmax(station)) + 8.0
    _lines(axes, corridor, low, high)
    for i in range(len(trace.names)):
        above = 3 if i in (trace.ego, threat) else 2
        colour = _ink_of(trace, i, threat)
        axes.plot(station[:, i], offset[:, i], linewidth=1.3, color=colour, zorder=above)
    _boxes(axes, trace, threat, corridor, k)
    axes.set_xlim(low, high)
    at = slice(max(int(low / corridor.ds_m), 0), int(high / corridor.ds_m) + 2)
    bottom = min(float(np.nanmin(corridor.road_right[at])), float(np.nanmin(offset))) - 2.0
    top = max(float(np.nanmax(corridor.road_left[at])), float(np.nanmax(offset))) + 2.0
    axes.set_ylim(bottom, top)
    axes.set_ylabel("offset, m")
    axes.set_title("Paths, stretched; vehicles at the worst moment")
    axes.grid(False)


def _close_up(axes: Axes, trace: Trace, threat: int | None, corridor: Corridor, k: int) -> None:
    centre_m, centre_offset_m = (
        float(trace.station_m[k, trace.ego]),
        float(trace.agents[k, trace.ego, A.OFFSET_M]),
    )
    along, across = CLOSE_UP_M
    _lines(axes, corridor, centre_m - along, centre_m + along)
    _boxes(axes, trace, threat, corridor, k)
    for i, name in enumerate(trace.names):
        agent = trace.agents[k, i]
        station, offset = float(trace.station_m[k, i]), float(agent[A.OFFSET_M])
        inside = -along + 8.0 < station - centre_m < along and abs(offset - centre_offset_m) < across - 1.0
        if agent[A.ACTIVE] != 0.0 and inside:
            axes.text(
                station - 0.5 * agent[A.LENGTH_M] - 0.6,
                offset,
                ink.name_of(name, i == trace.ego),
                fontsize=7,
                bbox={"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.6},
                ha="right",
                va="center",
                zorder=5,
                clip_on=True,
            )
    axes.set_xlim(centre_m - along, centre_m + along)
    axes.set_ylim(centre_offset_m - across, centre_offset_m + across)
    axes.set_aspect("equal")
    axes.set_xlabel("station along the road, m (driving to the right)")
    axes.set_ylabel("offset, m")
    axes.set_title(f"Close-up to scale, {trace.time_s[k]:.1f} s after the start")
    axes.grid(False)


def _measured(axes: Axes, trace: Trace, gamma: float, k: int, shown: np.ndarray) -> None:
    """The safety measure over time; seconds to come on a logarithmic axis."""
    name, unit = trace.measure.partition(":")[0], measure_kind(trace.measure).unit
    seconds = unit_at(unit, GREATEST_S) == "s"
    values = np.where(np.isfinite(trace.measured[shown]), trace.measured[shown], np.nan)
    if seconds:
        values = np.where(values <= GREATEST_S, values, np.nan)
    axes.plot(trace.time_s[shown], values, color=ink.EGO, linewidth=1.3)
    axes.plot(trace.time_s[k], trace.measured[k], "o", color=ink.EGO, markersize=4)
    axes.axhline(gamma, color=ink.BASE, linewidth=1.0, linestyle="--")
    if seconds and gamma > 0 and (values[~np.isnan(values)] > 0).all():
        positive = values[~np.isnan(values)]
        axes.set_ylim(0.6 * min(float(positive.min(initial=gamma)), gamma), GREATEST_S)
        ink.log_axis(axes, "y", lambda v: f"{v:g}")
    axes.text(
        0.995,
        gamma,
        f"γ = {quantity(gamma, unit)}",
        color=ink.BASE,
        fontsize=8,
        ha="right",
        va="bottom",
        transform=axes.get_yaxis_transform(),
    )
    axes.set_ylabel("time to\ncollision, s" if name == "ttc" else f"{name}, {unit}" if unit else name)
    axes.tick_params(labelbottom=False)


def _speeds(axes: Axes, trace: Trace, threat: int | None, k: int, shown: np.ndarray) -> None:
    order = sorted(range(len(trace.names)), key=lambda i: (i == trace.ego, i == threat))
    for i in order:
        active = trace.agents[shown, i, A.ACTIVE] != 0.0
        speed = np.where(active, trace.agents[shown, i, A.SPEED_MPS], np.nan)
        label = ink.name_of(trace.names[i], i == trace.ego) if i in (trace.ego, threat) else None
        width = 1.0 if label is None else 1.6
        axes.plot(trace.time_s[shown], speed, color=_ink_of(trace, i, threat), linewidth=width, label=label)
    axes.axvline(trace.time_s[k], color=ink.BASE, linewidth=0.8, linestyle=":")
    axes.set_ylabel("speed, m/s")
    axes.set_xlabel("time since the start, s")
    axes.legend(loc="best", ncols=2, fontsize=8)
