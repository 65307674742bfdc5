"""The road and the scenario of a motorway that somebody recorded, from the user's own copy of the recording.

The road is the line that the import told from the tracks, with parallel lanes, its coordinates from the line's first
point. In the scenario the ego drives in the right lane behind a truck, with a car behind it and two in the lane to its
left; distances and speeds are fitted to the recording (policies.data.motorways.starts). Drivers err as those of
i80-10s do, whose rates were set there.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl

from policies.data.motorways.starts import ROLES, MotorwayStarts, motorway_starts
from policies.data.scenes import DataError
from policies.data.start_fit import BetaFit
from service.errors import InputError
from service.world.scenario.fixed import toml_of
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import Beta, Drivers, Network, Scenario, Start, Time, Vehicle
from sumo_nets.drawn import draw_road

MODEL = "i80-10s"  # whose drivers, measure and sizes of cars are taken
LINE_M = 260.0  # the middle of the ego's range of stations
EGO_M = 10.0  # half of that range
HORIZON_S = 20.0
FASTEST_SHARE = 0.995  # of recorded speeds: the road's limit


@dataclass(frozen=True)
class Made:
    """What was written, and of which site."""

    network: Path
    scenario: Path
    site: str


def make_motorway(tables: Path, name: str, out: Path, site: str | None, weights: str | None) -> Made:
    """Write NAME.net.xml and NAME.toml to `out` from an imported table in `tables` that knows its road.

    site: which carriageway; the one with the most rows otherwise
    weights: of the drivers, relative to the scenario; those of i80-10s otherwise

    Raises InputError where no table knows its road or the site is none of them, or rows are too few.
    """
    roads: dict[str, tuple[Path, dict[str, Any], int]] = {}
    for path in sorted(tables.glob("*.json")):
        try:
            report = json.loads(path.read_text(encoding="utf-8"))
            rows = {r["recording"].rpartition(" ")[0]: r["rows"] for r in report["recordings"]}
            found = {
                key: (path.with_suffix(".parquet"), road, rows[key]) for key, road in report["roads"].items()
            }
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            continue
        roads |= found
    if not roads:
        raise InputError(
            f"{tables}: no table that knows its road; import a recording in the plane (DLR, exiD) with "
            "'tailroad data import'"
        )
    if site is not None and site not in roads:
        raise InputError(f"site {site}: there are {', '.join(roads)}")
    site = site or max(roads, key=lambda key: roads[key][2])
    path, road, _ = roads[site]
    try:
        table = pl.read_parquet(path).filter(pl.col("recording").str.starts_with(f"{site} "))
        starts = motorway_starts(table)
    except DataError as error:
        raise InputError(f"{path}, {site}: {error}") from error
    except (pl.exceptions.PolarsError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({error}); import the recording again") from error
    net, file = out / f"{name}.net.xml", out / f"{name}.toml"
    limit = float(table["speed_mps"].quantile(FASTEST_SHARE) or 0.0)
    draw_road(*carriageway(road), math.ceil(limit), name, net)
    file.write_text(
        toml_of(scenario(name, site, starts, weights), _comment(name, site, path)), encoding="utf-8"
    )
    return Made(net, file, site)


def carriageway(road: dict[str, Any]) -> tuple[np.ndarray, int, float]:
    """Middle (n, 2) from its first point, number of lanes and their width, of a road as the import tells it."""
    x, y, heading = (np.array(road[key], dtype=np.float64) for key in ("x_m", "y_m", "heading_rad"))
    lanes = np.array(road["lanes_left_m"], dtype=np.float64)
    middle = 0.5 * (lanes[0] + lanes[-1])
    points = np.column_stack([x - middle * np.sin(heading), y + middle * np.cos(heading)])
    return points - points[0], len(lanes), float(lanes[0] - lanes[-1]) / max(len(lanes) - 1, 1)


def scenario(name: str, site: str, starts: MotorwayStarts, weights: str | None) -> Scenario:
    """The scenario of these starts."""
    model = load_scenario(MODEL)
    lanes = starts.lanes
    ego_station = Beta(alpha=2.0, beta=2.0, low=LINE_M - EGO_M, high=LINE_M + EGO_M)
    truck_length, truck_width = starts.truck_m
    others = []
    for number, (role, lane) in enumerate(
        zip(ROLES, (lanes, lanes, lanes - 1, lanes - 1), strict=True), start=1
    ):
        ahead = "ahead" in role
        truck = role == ROLES[0]
        others.append(
            Vehicle(
                name=f"env{number}",
                lane=lane,
                station_m=_beta(starts.distance_m[role], LINE_M, 1.0 if ahead else -1.0),
                speed_mps=_beta(starts.speed_mps[role]),
                length_m=round(truck_length, 1) if truck else None,
                width_m=round(truck_width, 2) if truck else None,
            )
        )
    start = Start(
        station_m=ego_station,
        lane_offset_m=_beta(starts.lane_offset_m),
        heading_deg=_beta(starts.heading_deg),
        speed_mps=_beta(starts.speed_mps["ego"]),
        length_m=model.start.length_m,
        width_m=model.start.width_m,
    )
    return msgspec.structs.replace(
        model,
        name=name,
        description=f"The motorway {site} in free flow, as recorded: behind a truck in the right lane, cars around",
        network=Network(road=f"{name}.net.xml", edges=(name,)),
        time=Time(horizon_s=HORIZON_S),
        drivers=Drivers(weights=weights) if weights else model.drivers,
        start=start,
        vehicles=(Vehicle(name="ego", lane=lanes, role="ego"), *others),
    )


def _beta(fit: BetaFit, line: float = 0.0, way: float = 1.0) -> Beta:
    """The fit as a distribution of line + way * value."""
    low, high = sorted((line + way * fit.low, line + way * fit.high))
    alpha, beta = (fit.alpha, fit.beta) if way > 0.0 else (fit.beta, fit.alpha)
    return Beta(alpha=round(alpha, 3), beta=round(beta, 3), low=round(low, 3), high=round(high, 3))


def _comment(name: str, site: str, table: Path) -> str:
    return (
        f"Made by `tailroad data motorway` from {table.name}, site {site}.\n"
        "Starts are fitted to that recording, whose licence holds for this file too.\n"
        f"The road {name}.net.xml lies beside it, in metres from its first point."
    )
