"""From a trace to what a player needs to show it."""

import math

import numpy as np

from service.analysis.failures.playback import Playback, RoadLine, Track
from service.analysis.trace import Trace
from service.evaluation.endings import in_words
from service.world import agents as A
from service.world.scenario.measures import measure_kind
from service.world.sensors.lidar import beam_directions, scan
from sumo_nets.corridor import Corridor

MARGIN_M = 60.0  # road before and after the vehicles
ROAD_STEP_M = 5.0


def playback_of(
    trace: Trace,
    corridor: Corridor,
    gamma: float,
    threat: int | None,
    rays: int,
    states: np.ndarray | None = None,
) -> Playback:
    """The states of a trace (default: all) to be shown.

    rays: of the safety measure, 0 for none
    """
    shown = np.arange(len(trace.time_s)) if states is None else states
    agents = trace.agents[shown]
    active = agents[:, :, A.ACTIVE] != 0.0
    station = np.where(active, trace.station_m[shown], np.nan)
    road_station, lines = _road(corridor, float(np.nanmin(station)), float(np.nanmax(station)))
    actions = np.full((len(trace.time_s), 2), np.nan)
    actions[: len(trace.actions)] = trace.actions
    angles, reach = _rays(trace, shown, rays)
    return Playback(
        time_s=tuple(round(float(t), 3) for t in trace.time_s[shown]),
        tracks=tuple(
            Track(
                name=name,
                role="ego" if i == trace.ego else "threat" if i == threat else "other",
                length_m=round(float(agents[0, i, A.LENGTH_M]), 2),
                width_m=round(float(agents[0, i, A.WIDTH_M]), 2),
                station_m=_rounded(station[:, i], 2),
                offset_m=_rounded(np.where(active[:, i], agents[:, i, A.OFFSET_M], np.nan), 2),
                heading_rad=_rounded(np.where(active[:, i], _heading(agents[:, i], corridor), np.nan), 3),
                speed_mps=_rounded(np.where(active[:, i], agents[:, i, A.SPEED_MPS], np.nan), 2),
            )
            for i, name in enumerate(trace.names)
        ),
        measure=trace.measure,
        unit=measure_kind(trace.measure).unit,
        measured=_rounded(trace.measured[shown], 3),
        ttc_s=_rounded(trace.ttc_s[shown], 3),
        acceleration_mps2=_rounded(actions[shown, 0], 2),
        turn_rate_radps=_rounded(actions[shown, 1], 3),
        worst=int(np.argmin(np.where(np.isnan(trace.measured[shown]), np.inf, trace.measured[shown]))),
        gamma=gamma,
        outcome=trace.rollout.outcome,
        road_station_m=road_station,
        road=lines,
        ray_rad=angles,
        ray_m=reach,
        contact=contact_words(trace),
    )


def contact_words(trace: Trace) -> str:
    """The ego's contact in a phrase, with its impact; "" where there was none."""
    contact = trace.rollout.contact
    if contact is None:
        return ""
    known = contact.other < len(trace.names)
    other = trace.names[contact.other] if known else "background traffic"
    sides = " and ".join(
        f"{whose} {in_words(side)}"
        for whose, side in (("the ego's", contact.ego_side), ("its", contact.other_side))
    )
    return f"contact with {other}, impact {contact.speed_mps:.1f} m/s, {sides}"


def _rounded(values: np.ndarray, digits: int) -> tuple[float | None, ...]:
    return tuple(round(v, digits) if math.isfinite(v) else None for v in values.tolist())


def _heading(agents: np.ndarray, corridor: Corridor) -> np.ndarray:
    """Headings (T,) of one vehicle relative to the road."""
    station = agents[:, A.STATION].astype(np.int64)
    bend = agents[:, A.ALONG_M] * corridor.ref_curvature[station]
    return agents[:, A.HEADING_RAD] - corridor.ref_heading[station] - bend


def _road(corridor: Corridor, low_m: float, high_m: float) -> tuple[tuple[float, ...], tuple[RoadLine, ...]]:
    """The road's edges and lane lines between two stations and MARGIN_M beyond."""
    every = max(round(ROAD_STEP_M / corridor.ds_m), 1)
    at = np.arange(len(corridor.station_m))[::every]
    at = at[(corridor.station_m[at] >= low_m - MARGIN_M) & (corridor.station_m[at] <= high_m + MARGIN_M)]
    lines = [
        RoadLine(kind="edge", offset_m=_rounded(edge[at], 2))
        for edge in (corridor.road_left, corridor.road_right)
    ]
    lines += [RoadLine(kind="lane", offset_m=_rounded(left[at], 2)) for left in corridor.lane_left[1:]]
    return tuple(round(float(s), 2) for s in corridor.station_m[at]), tuple(lines)


def _rays(
    trace: Trace, shown: np.ndarray, rays: int
) -> tuple[tuple[float, ...], tuple[tuple[float | None, ...], ...]]:
    if not rays:
        return (), ()
    directions = beam_directions(rays)
    reach, rates = np.empty(rays), np.empty(rays)
    found = []
    for k in shown.tolist():
        scan(
            np.ascontiguousarray(trace.agents[k]),
            trace.agents.shape[1],
            trace.ego,
            directions,
            math.inf,
            reach,
            rates,
        )
        found.append(_rounded(reach, 2))
    angles = [round(math.atan2(y, x), 4) for x, y in directions.tolist()]
    return tuple(angles), tuple(found)
