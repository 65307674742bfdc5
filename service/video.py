"""A rollout as a film from above: the road around the ego, and its time to collision."""

import math
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from service import agents as A
from service.errors import InputError, SimulationError
from service.trace import Trace
from sumo_nets.corridor import Corridor

WIDTH, HEIGHT = 1280, 560
VIEW_M = 110.0  # length of road in view
SCALE = WIDTH / VIEW_M  # pixels a metre
ROAD_ROW = 190  # image row of the road's reference line
EGO_COLUMN = 0.42 * WIDTH
PLOT = (60, 420, WIDTH - 40, HEIGHT - 40)  # left, top, right, bottom of the time-to-collision plot
PLOT_TTC_S = 10.0
DANGER_S = 1.5  # below this the ego is drawn in red: drivers perceive a conflict (Vogel 2003 uses 1 to 4 s)
DASH_M, DASH_PERIOD_M = 4, 15  # about as California paints lane lines: 12 ft every 48 ft
SHIFT = 4  # fractional bits of OpenCV's coordinates

# blue, green, red
ASPHALT, VERGE, LINE, TEXT = (72, 70, 68), (82, 110, 86), (225, 225, 225), (240, 240, 240)
EGO, OTHER, TAKEN_OVER, DANGER = (214, 130, 30), (190, 190, 190), (150, 120, 170), (60, 60, 230)


def write_video(trace: Trace, corridor: Corridor, path: Path, title: str) -> None:
    """Write the film (mp4) at real time; the road is drawn straight, stations to the right."""
    if path.suffix.lower() != ".mp4":
        raise InputError(f"--video {path}: films are written as .mp4; give a name that ends so")
    step_s = float(trace.time_s[1] - trace.time_s[0]) if len(trace.time_s) > 1 else 0.1
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 1.0 / step_s, (WIDTH, HEIGHT))
    if not writer.isOpened():
        raise SimulationError(f"OpenCV cannot write films to {path}")
    try:
        for k in range(len(trace.time_s)):
            writer.write(frame(trace, corridor, k, title))
    finally:
        writer.release()


def frame(trace: Trace, corridor: Corridor, k: int, title: str) -> np.ndarray:
    """The film's picture (HEIGHT, WIDTH, 3) of state k."""
    image = np.full((HEIGHT, WIDTH, 3), 34, np.uint8)
    station = trace.station_m[k]
    start = station[trace.ego] - EGO_COLUMN / SCALE
    _draw_road(image, corridor, start)
    for i in range(len(trace.names)):
        _draw_vehicle(image, trace, corridor, k, i, start)
    _draw_text(image, trace, k, title)
    _draw_plot(image, trace, k)
    return image


def _pixel(station_m: float | np.ndarray, offset_m: float | np.ndarray, start_m: float) -> np.ndarray:
    """Image coordinates with SHIFT fractional bits."""
    x = (np.asarray(station_m) - start_m) * SCALE
    y = ROAD_ROW - np.asarray(offset_m) * SCALE
    return np.round(np.stack(np.broadcast_arrays(x, y), axis=-1) * 2**SHIFT).astype(np.int32)


def _draw_road(image: np.ndarray, corridor: Corridor, start_m: float) -> None:
    image[:400] = VERGE
    k = np.arange(
        max(int(start_m / corridor.ds_m) - 1, 0),
        min(int((start_m + VIEW_M) / corridor.ds_m) + 2, len(corridor.station_m) - 1) + 1,
    )
    if k.size < 2:
        return
    s = corridor.station_m[k]
    edges = np.concatenate(
        [_pixel(s, corridor.road_left[k], start_m), _pixel(s, corridor.road_right[k], start_m)[::-1]]
    )
    cv2.fillPoly(image, [edges], ASPHALT, cv2.LINE_AA, SHIFT)
    for edge in (corridor.road_left, corridor.road_right):
        cv2.polylines(image, [_pixel(s, edge[k], start_m)], False, LINE, 1, cv2.LINE_AA, SHIFT)
    for lane, left in enumerate(corridor.lane_left[1:], start=1):
        for a, b in pairwise(k.tolist()):
            painted = lane == 1 or a % DASH_PERIOD_M < DASH_M  # the line beside the HOV lane is solid
            if painted and not (math.isnan(left[a]) or math.isnan(left[b])):
                p, q = _pixel(corridor.station_m[[a, b]], left[[a, b]], start_m)
                cv2.line(image, p.tolist(), q.tolist(), LINE, 1, cv2.LINE_AA, SHIFT)


def _draw_vehicle(
    image: np.ndarray, trace: Trace, corridor: Corridor, k: int, i: int, start_m: float
) -> None:
    agent = trace.agents[k, i]
    if agent[A.ACTIVE] == 0.0:
        return
    station = trace.station_m[k, i]
    nearest = int(agent[A.STATION])
    heading = (
        agent[A.HEADING_RAD]
        - corridor.ref_heading[nearest]
        - agent[A.ALONG_M] * corridor.ref_curvature[nearest]
    )
    c, s = math.cos(heading), math.sin(heading)
    half_l, half_w = 0.5 * agent[A.LENGTH_M], 0.5 * agent[A.WIDTH_M]

    def outline(corners: np.ndarray) -> np.ndarray:
        return _pixel(
            station + corners[:, 0] * c - corners[:, 1] * s,
            agent[A.OFFSET_M] + corners[:, 0] * s + corners[:, 1] * c,
            start_m,
        )

    if i == trace.ego:
        colour = DANGER if trace.ttc_s[k] < DANGER_S or agent[A.COLLISION] else EGO
    else:
        colour = TAKEN_OVER if agent[A.TAKEN_OVER] else OTHER
    body = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * (half_l, half_w)
    glass = np.array([[0.45, 0.8], [0.45, -0.8], [0.2, -0.8], [0.2, 0.8]]) * (half_l, half_w)
    cv2.fillPoly(image, [outline(body)], colour, cv2.LINE_AA, SHIFT)
    cv2.fillPoly(image, [outline(glass)], (40, 40, 40), cv2.LINE_AA, SHIFT)
    x, y = (outline(body)[2] / 2**SHIFT).tolist()
    label = f"{trace.names[i]}  {agent[A.SPEED_MPS]:.0f} m/s"
    cv2.putText(image, label, (int(x), int(y) + 14), cv2.FONT_HERSHEY_SIMPLEX, 0.4, TEXT, 1, cv2.LINE_AA)


def _draw_text(image: np.ndarray, trace: Trace, k: int, title: str) -> None:
    ego = trace.agents[k, trace.ego]
    lowest = float(trace.ttc_s[: k + 1].min())
    cv2.putText(image, title, (16, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.55, TEXT, 1, cv2.LINE_AA)
    facts = (
        f"t {trace.time_s[k]:6.1f} s   station {trace.station_m[k, trace.ego]:6.0f} m   "
        f"speed {ego[A.SPEED_MPS]:4.1f} m/s   TTC {_seconds(float(trace.ttc_s[k]))}   lowest so far {_seconds(lowest)}"
    )
    cv2.putText(image, facts, (16, 46), cv2.FONT_HERSHEY_SIMPLEX, 0.5, TEXT, 1, cv2.LINE_AA)
    if k + 1 == len(trace.time_s):
        cv2.putText(
            image,
            trace.rollout.outcome,
            (WIDTH - 180, 30),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.8,
            TEXT,
            2,
            cv2.LINE_AA,
        )


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if value < 99.0 else "none"


def _draw_plot(image: np.ndarray, trace: Trace, k: int) -> None:
    left, top, right, bottom = PLOT
    end = max(float(trace.time_s[-1]), 1e-9)
    cv2.rectangle(image, (left, top), (right, bottom), (70, 70, 70), 1)
    for value in (0, 5, 10):
        y = int(bottom - (bottom - top) * value / PLOT_TTC_S)
        cv2.line(image, (left, y), (right, y), (70, 70, 70), 1)
        cv2.putText(image, f"{value} s", (18, y + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.4, TEXT, 1, cv2.LINE_AA)
    cv2.putText(
        image, "time to collision", (left, top - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.4, TEXT, 1, cv2.LINE_AA
    )
    x = left + (right - left) * trace.time_s[: k + 1] / end
    y = bottom - (bottom - top) * np.minimum(trace.ttc_s[: k + 1], PLOT_TTC_S) / PLOT_TTC_S
    points = np.column_stack([x, y]).round().astype(np.int32)
    cv2.polylines(image, [points], False, EGO, 2, cv2.LINE_AA)
    cv2.circle(
        image, tuple(points[-1].tolist()), 4, DANGER if trace.ttc_s[k] < DANGER_S else EGO, -1, cv2.LINE_AA
    )
