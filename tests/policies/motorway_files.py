"""Files of recordings of motorways, made by their published columns."""

import numpy as np

RADIUS_M = 2000.0
LANE_M = 3.7


def drives(
    vehicles: int = 24, seconds: float = 12.0, rate: float = 20.0, spread: float = 0.0, apart: float = 18.0
):
    """(vehicle, time, distance driven, lane 1 or 2, lane position left) of cars on two lanes; one changes lanes."""
    for v in range(vehicles):
        lane = 1 + v % 2
        speed = 36.0 - 6.0 * (lane - 1) + spread * (v // 2)
        for k in range(round(seconds * rate)):
            t = k / rate
            share = min(max((t - 4.0) / 4.0, 0.0), 1.0) if v == 3 else 0.0
            yield v, t, 20.0 + apart * (v // 2) + speed * t, lane, LANE_M * (1.5 - lane + share), speed


def on_arc(along: float, left: float, way: float) -> tuple[float, float]:
    """A point of two carriageways along a circle, 10 m apart, the second driven the other way."""
    turn = along / RADIUS_M if way > 0 else 0.35 - along / RADIUS_M
    radius = RADIUS_M - way * (left - 8.0)
    return 600_000.0 + radius * np.sin(turn), 5_790_000.0 + RADIUS_M - radius * np.cos(turn)


def dlr_text(truck_at: int = 1, spread: float = 0.0, apart: float = 18.0) -> str:
    """Both carriageways; every vehicle `truck_at` and 6 further is a truck."""
    names = (
        "timestamp,id,center_easting,center_northing,velocity_easting,velocity_northing,velocity_magnitude,yaw,"
        "dimension_length,dimension_width,dimension_height,classifications_pedestrian,classifications_bicycle,"
        "classifications_motorbike,classifications_car,classifications_van,classifications_truck,interpolated"
    )
    rows = [names]
    for way, first in ((1.0, 1728280701706084), (-1.0, 1728280801706084)):
        for v, t, along, _, left, speed in drives(spread=spread, apart=apart):
            x, y = on_arc(along, left, way)
            size, kinds = (
                ("18.5,2.6,3.9", "0,0,0,0,0.1,0.9")
                if v in (truck_at, truck_at + 6)
                else ("4.5,1.8,1.5", "0,0,0,0.7,0.2,0.1")
            )
            told = "True" if v == 5 and t < 1.0 else "False"
            rows.append(
                f"2024-10-07 06:00:{t + 0.004659:09.6f}+00:00,{first + v},{x:.3f},{y:.3f},1,1,{speed},64.4,{size},"
                f"{kinds},{told}"
            )
    return "\n".join(rows) + "\n"
