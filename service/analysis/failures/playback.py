"""A rollout as what a player needs to show it: the road drawn straight, vehicles as boxes on it, values over time.

Along the road and across it (left positive), in metres; headings relative to the road. Numbers are rounded to what an
eye can tell, so that a rollout of 10 s is a few dozen kilobytes of JSON. null: not on the road, or no such value.
"""

from typing import Literal

import msgspec


class Track(msgspec.Struct, frozen=True, kw_only=True):
    """A vehicle over time.

    role: "threat" is the one that the smallest value is to
    """

    name: str
    role: Literal["ego", "threat", "other"]
    length_m: float
    width_m: float
    station_m: tuple[float | None, ...]
    offset_m: tuple[float | None, ...]
    heading_rad: tuple[float | None, ...]
    speed_mps: tuple[float | None, ...]


class RoadLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line along the road: its offset at each of the road's stations."""

    kind: Literal["edge", "lane"]
    offset_m: tuple[float | None, ...]


class Playback(msgspec.Struct, frozen=True, kw_only=True):
    """A rollout to be shown, a value a state.

    worst: the state of the smallest value of the safety measure
    contact: with whom the ego touched in the last state, how fast and with which sides; "" where it did not
    rays: angle of each ray to the ego's heading, and how far it reaches in each state
    """

    time_s: tuple[float, ...]
    tracks: tuple[Track, ...]
    measure: str
    unit: str
    measured: tuple[float | None, ...]
    ttc_s: tuple[float | None, ...]
    acceleration_mps2: tuple[float | None, ...]
    turn_rate_radps: tuple[float | None, ...]
    worst: int
    gamma: float
    outcome: str
    road_station_m: tuple[float, ...]
    road: tuple[RoadLine, ...]
    ray_rad: tuple[float, ...]
    ray_m: tuple[tuple[float | None, ...], ...]
    contact: str = ""
