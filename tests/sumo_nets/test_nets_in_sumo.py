"""SUMO itself, in a process of its own: the lanes and places of vehicles are those the arrays say."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

SCRIPT = """
import json
import libsumo
import numpy as np
from sumo_nets.corridor import load_corridor

road = load_corridor("i80")
options = ["--step-length", "0.1", "--no-step-log", "--no-warnings", "--collision.action", "none"]
libsumo.start(["sumo", "-n", road.net_path, *options])
libsumo.vehicletype.copy("DEFAULT_VEHTYPE", "controlled")
libsumo.vehicletype.setVehicleClass("controlled", "hov")
libsumo.route.add("through", road.edges)
for lane in range(6):
    libsumo.vehicle.add(str(lane), "through", typeID="controlled", departLane=str(5 - lane), departSpeed="0")
libsumo.simulationStep()
rows = []
joints = np.flatnonzero(np.diff(road.edge_index[0])) + 1
for station in np.arange(8.0, 2049.0, 17.3):
    if np.abs(joints - station).min() < 2.0:
        continue
    wanted = []
    for lane in range(6):
        offset = float(road.lane_center(lane, station)) + (1.2 if lane % 2 else -1.2)
        x, y, heading = (float(v) for v in road.to_xy(station, offset))
        edge, index = road.sumo_position(lane, station)
        angle = 90.0 - np.degrees(heading)
        libsumo.vehicle.moveToXY(str(lane), edge, index, x, y, angle=angle, keepRoute=2)
        libsumo.vehicle.setSpeed(str(lane), 0.0)
        wanted.append((edge, index, x, y))
    libsumo.simulationStep()
    for lane, (edge, index, x, y) in enumerate(wanted):
        at = libsumo.vehicle.getPosition(str(lane))
        right = (libsumo.vehicle.getRoadID(str(lane)), libsumo.vehicle.getLaneIndex(str(lane))) == (edge, index)
        rows.append((station, lane + 1, right, float(np.hypot(at[0] - x, at[1] - y))))
print(json.dumps(rows))
"""


@pytest.fixture(scope="module")
def placed() -> list:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_six_controlled_vehicles_drive_the_length_of_their_lanes(placed):
    assert {lane for _, lane, _, _ in placed} == {1, 2, 3, 4, 5, 6}
    assert max(station for station, *_ in placed) > 2030.0


def test_sumo_finds_each_vehicle_on_the_lane_of_the_arrays(placed):
    assert [row for row in placed if not row[2]] == []


def test_sumo_places_each_vehicle_exactly(placed):
    assert max(apart for *_, apart in placed) < 1e-6
