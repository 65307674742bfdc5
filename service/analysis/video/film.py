"""The film's pictures put together, and written as a film or one by one."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from service.analysis.failures.motion import motion_of
from service.analysis.failures.play import contact_words
from service.analysis.trace import Trace
from service.analysis.video.charts import action_chart, measure_chart
from service.analysis.video.ink import BACKGROUND, DANGER, QUIET, TEXT, write
from service.analysis.video.top_down import DANGER_S, TopDown
from service.analysis.video.view import EgoView
from service.errors import InputError, SimulationError
from service.world import agents as A
from service.world.scenario.measures import STL, measure_kind, unit_at
from sumo_nets.corridor import Corridor

WIDTH, HEIGHT = 1600, 640
HEAD, MIDDLE, FOOT = 64, 372, 204  # rows of the text, the two views and the charts
CAMERA_WIDTH = 640  # of the WIDTH, where there is a camera
RAYS = 20  # where the scenario is not known


def write_video(
    trace: Trace, corridor: Corridor, path: Path, title: str, view: EgoView | None = None
) -> None:
    """Write the film (mp4) at real time; InputError for another kind of file."""
    if path.suffix.lower() != ".mp4":
        raise InputError(f"--video {path}: films are written as .mp4; give a name that ends so")
    step_s = float(trace.time_s[1] - trace.time_s[0]) if len(trace.time_s) > 1 else 0.1
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 1.0 / step_s, (WIDTH, HEIGHT))
    if not writer.isOpened():
        raise SimulationError(f"OpenCV cannot write films to {path}")
    try:
        for image in pictures(trace, corridor, title, view):
            writer.write(image)
    finally:
        writer.release()


def write_frames(
    trace: Trace, corridor: Corridor, folder: Path, title: str, view: EgoView | None = None
) -> list[Path]:
    """Write the film's pictures as FOLDER/00000.png, 00001.png, ..., a picture a state."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for k, image in enumerate(pictures(trace, corridor, title, view)):
        path = folder / f"{k:05d}.png"
        if not cv2.imwrite(str(path), image):
            raise SimulationError(f"OpenCV cannot write pictures to {path}")
        written.append(path)
    return written


def pictures(
    trace: Trace, corridor: Corridor, title: str, view: EgoView | None = None
) -> Iterator[np.ndarray]:
    """The film's pictures (HEIGHT, WIDTH, 3), one for each state; without a view the road takes the camera's place."""
    beside = 0 if view is None else CAMERA_WIDTH
    rays = RAYS if view is None else view.scenario.safety.rays
    motion = motion_of(trace, rays, corridor)
    threat = None if motion is None else motion.other
    parts: list[tuple[int, int, Callable[[int], np.ndarray]]] = [
        (HEAD, 0, TopDown(trace, corridor, WIDTH - beside, MIDDLE, rays, threat).draw),
        (HEAD + MIDDLE, 0, measure_chart(trace, WIDTH - CAMERA_WIDTH, FOOT).draw),
        (HEAD + MIDDLE, WIDTH - CAMERA_WIDTH, action_chart(trace, CAMERA_WIDTH, FOOT).draw),
    ]
    if view is not None:
        parts.append((HEAD, WIDTH - beside, view.pictures(trace, beside, MIDDLE).draw))
    for k in range(len(trace.time_s)):
        image = np.full((HEIGHT, WIDTH, 3), BACKGROUND, np.uint8)
        for row, column, draw in parts:
            part = draw(k)
            image[row : row + part.shape[0], column : column + part.shape[1]] = part
        _head(image, trace, k, title)
        yield image


def _head(image: np.ndarray, trace: Trace, k: int, title: str) -> None:
    ego = trace.agents[k, trace.ego]
    write(image, title, (16, 24), 0.55)
    acceleration, turn_rate = trace.actions[k] if k < len(trace.actions) else (math.nan, math.nan)
    facts = (
        f"t {trace.time_s[k]:5.1f} s   station {trace.station_m[k, trace.ego]:6.0f} m   "
        f"speed {ego[A.SPEED_MPS]:4.1f} m/s   "
        f"acceleration {_value(acceleration, 'm/s^2')}   turn rate {_value(math.degrees(turn_rate), 'deg/s')}   "
        f"TTC {_value(float(trace.ttc_s[k]), 's')}"
    )
    write(image, facts, (16, 50), 0.5, QUIET)
    so_far, danger = _so_far(trace, k)
    write(image, so_far, (WIDTH - 520, 26), 0.65, DANGER if danger else TEXT)
    if k + 1 == len(trace.time_s):
        told = contact_words(trace)
        write(
            image,
            told or trace.rollout.outcome,
            (WIDTH - 640 if told else WIDTH - 180, 54),
            0.6,
            DANGER if told else TEXT,
        )


def _so_far(trace: Trace, k: int) -> tuple[str, bool]:
    """f so far in words, and whether it is a dangerous one."""
    name = trace.measure.partition(":")[0]
    kind = measure_kind(trace.measure)
    if name == STL:
        return f"f {_value(trace.rollout.f, '')}", trace.rollout.f < 0.0
    f = float(trace.measured[: k + 1].min())
    unit = unit_at(kind.unit, f)
    limit = DANGER_S if unit == "s" else -3.0 if name == "drac" else 0.0
    return f"f so far ({name}) {_value(f, unit)}", f < limit


def _value(value: float, unit: str) -> str:
    return f"{value:.2f} {unit}".rstrip() if abs(value) < 1e3 else "none"
