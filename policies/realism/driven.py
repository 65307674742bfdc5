"""A scene in which a model drove some of the vehicles, in the same form as a recorded one."""

from dataclasses import dataclass, replace

import numpy as np

from policies.data.scenes import Scene


@dataclass(frozen=True)
class Driven:
    """A window of a scene as a model drove it.

    scene: the window, with the model's motion in the columns `who` (n,)
    recorded: the same window as recorded
    accel, turn_rate (T, n): the actions as they were applied, not smoothed
    """

    scene: Scene
    recorded: Scene
    who: np.ndarray
    accel: np.ndarray
    turn_rate: np.ndarray


def driven_scene(
    scene: Scene, first: int, who: np.ndarray, station: np.ndarray, offset: np.ndarray, speed: np.ndarray,
    accel: np.ndarray, turn_rate: np.ndarray,
) -> Driven:  # fmt: skip
    """Put a model's motion, arrays (T, n), over the recorded one from row `first` on."""
    window = window_of(scene, first, len(station))
    lanes, spacing = len(scene.road.lane_left), scene.road.lane_width_m
    lane = np.clip(np.floor(lanes / 2.0 - offset / spacing), 0, lanes - 1).astype(np.int64)

    def over(values: np.ndarray, new: np.ndarray | int) -> np.ndarray:
        values = values.copy()
        values[:, who] = new
        return values

    simulated = replace(
        window,
        station=over(window.station, station),
        lateral=over(window.lateral, offset),
        speed=over(window.speed, speed),
        accel=over(window.accel, accel),
        turn_rate=over(window.turn_rate, turn_rate),
        lane=over(window.lane, lane),
        flags=over(window.flags, 0),
    )
    return Driven(simulated, window, who, accel, turn_rate)


def window_of(scene: Scene, first: int, frames: int) -> Scene:
    """Rows first .. first + frames - 1 of a scene."""
    rows = slice(first, first + frames)
    names = (
        "frame", "x", "y", "heading", "speed", "accel", "turn_rate", "station", "lateral", "lane", "flags", "usable",
    )  # fmt: skip
    return replace(scene, **{name: getattr(scene, name)[rows] for name in names})
