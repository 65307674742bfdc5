"""A road and a scenario from a recording: they check out, and stand as the recorded vehicles stood."""

import numpy as np
import polars as pl
import pytest

from policies.data.motorways.starts import motorway_starts
from policies.data.ngsim_import import import_file
from policies.data.scenes import DataError
from service.errors import InputError
from service.studies.motorway import make_motorway
from service.world.scenario.check import check_road, check_values
from service.world.scenario.load import load_scenario
from sumo_nets.corridor import load_corridor
from tests.policies.motorway_files import LANE_M, RADIUS_M, dlr_text


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("a39")
    (folder / "trajectories_1.csv").write_text(dlr_text(truck_at=9, spread=0.05, apart=50.0))
    import_file(folder / "trajectories_1.csv", folder / "tables")
    return folder / "tables"


def test_a_recording_becomes_a_road_and_a_scenario(tables, tmp_path):
    made = make_motorway(tables, "a39", tmp_path, None, None)
    assert made.site in ("a39-E", "a39-W")
    road = load_corridor(made.network, ["a39"])
    assert road.lane_left.shape[0] == 2
    assert np.median(np.abs(road.ref_curvature)) == pytest.approx(1.0 / RADIUS_M, rel=0.1)
    assert (road.lane_left[0] - road.lane_right[0]).mean() == pytest.approx(LANE_M, abs=0.15)
    scenario = load_scenario(made.scenario)
    truck = scenario.vehicles[1]
    assert (truck.lane, truck.length_m, truck.width_m) == (2, 18.5, 2.6)
    assert (truck.speed_mps.low, truck.speed_mps.high) == pytest.approx((30.0, 30.0), abs=1.0)
    left = scenario.vehicles[3]
    assert left.speed_mps.high == pytest.approx(36.5, abs=1.0)  # one comes over from the right, at 30 m/s
    check_values(scenario, "a39.toml")
    check_road(scenario, "a39.toml")


def test_an_unknown_site_and_tables_without_a_road_are_told(tables, tmp_path):
    with pytest.raises(InputError, match="site a39-N: there are a39-"):
        make_motorway(tables, "a39", tmp_path, "a39-N", None)
    with pytest.raises(InputError, match="no table that knows its road; import a recording in the plane"):
        make_motorway(tmp_path, "a39", tmp_path, None, None)


def test_a_recording_without_trucks_is_told(tables):
    table = pl.read_parquet(next(tables.glob("*.parquet"))).with_columns(vehicle_class=pl.lit("car"))
    with pytest.raises(DataError, match="fewer than two vehicles were seen as 'truck ahead'"):
        motorway_starts(table.filter(pl.col("recording").str.starts_with("a39-E")))
