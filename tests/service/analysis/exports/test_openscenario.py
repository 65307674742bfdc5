"""ASAM OpenSCENARIO of a rollout: the public checker finds nothing, and every vehicle is where it was to 0.1 mm."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from service.analysis.exports.opendrive import write_opendrive
from service.analysis.exports.openscenario import openscenario_text
from service.errors import SimulationError
from service.evaluation.job import Problem, make_job
from service.world import agents as A
from service.world.scenario import load_scenario

MADE = datetime(2026, 12, 1, 9, 30, tzinfo=UTC)


@pytest.fixture(scope="module")
def trace(trace_of):
    return trace_of("i80-10s")


def test_the_checker_of_asam_finds_nothing(trace, tmp_path):
    scenario, found = tmp_path / "drive.xosc", tmp_path / "found.xqar"
    scenario.write_text(openscenario_text(trace, 'rank 1, "close" <pass>', MADE), encoding="utf-8")
    (tmp_path / "check.xml").write_text(
        f'<Config><Param name="InputFile" value="{scenario}"/><CheckerBundle application="xoscBundle">'
        f'<Param name="resultFile" value="{found}"/></CheckerBundle></Config>'
    )
    command = [sys.executable, "-m", "qc_openscenario.main", "-c", str(tmp_path / "check.xml")]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path)
    checkers = list(ET.parse(found).getroot().iter("Checker"))
    schema = [one for one in checkers if one.get("checkerId") == "check_asam_xosc_xml_valid_schema"]
    assert [one.get("status") for one in schema] == ["completed"]
    assert {one.get("status") for one in checkers} <= {"completed", "skipped"}
    assert not list(ET.parse(found).getroot().iter("Issue"))


def test_boxes_are_where_they_were_at_every_step(trace):
    root = ET.fromstring(openscenario_text(trace, "drive", MADE))
    ahead = {
        vehicle.get("name"): float(vehicle.find("BoundingBox/Center").get("x"))
        for vehicle in root.iter("Vehicle")
    }
    assert tuple(ahead) == trace.names
    for i, group in enumerate(root.iter("ManeuverGroup")):
        assert group.find("Actors/EntityRef").get("entityRef") == trace.names[i]
        vertices = list(group.iter("Vertex"))
        assert len(vertices) == len(trace.time_s)
        for k, vertex in enumerate(vertices):
            at = {key: float(value) for key, value in vertex.find("Position/WorldPosition").attrib.items()}
            assert float(vertex.get("time")) == pytest.approx(trace.time_s[k])
            middle = ahead[trace.names[i]] * np.array([np.cos(at["h"]), np.sin(at["h"])]) + (at["x"], at["y"])
            agent = trace.agents[k, i]
            assert middle == pytest.approx(agent[[A.X_M, A.Y_M]], abs=1e-4)
            assert at["h"] == pytest.approx(agent[A.HEADING_RAD], abs=1e-5)


def test_a_vehicle_that_leaves_the_road_ends_there(trace):
    agents = trace.agents.copy()
    agents[40:, 2, A.ACTIVE] = 0.0
    root = ET.fromstring(openscenario_text(replace(trace, agents=agents), "drive", MADE))
    lengths = [len(list(group.iter("Vertex"))) for group in root.iter("ManeuverGroup")]
    assert lengths[2] == 40
    assert lengths[0] == len(trace.time_s)


def test_the_road_beside_it_has_the_coordinates_of_the_drive(trace, tmp_path):
    problem = Problem(
        make_job(load_scenario("i80-10s"), "idm", gamma=0.0, method="naive", seed=1, options={})
    )
    road = tmp_path / "drive.xodr"
    write_opendrive(problem.corridor.net_path, road)
    root = ET.parse(road).getroot()
    lines = np.array([[float(one.get("x")), float(one.get("y"))] for one in root.iter("geometry")])
    for agent in trace.agents[0]:
        assert np.hypot(*(lines - agent[[A.X_M, A.Y_M]]).T).min() < 60.0
    named = openscenario_text(trace, "drive", MADE, road.name)
    assert ET.fromstring(named).find("RoadNetwork/LogicFile").get("filepath") == "drive.xodr"


def test_without_netconvert_it_is_said_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setattr("service.analysis.exports.opendrive.netconvert", lambda: None)
    with pytest.raises(SimulationError, match="pip install eclipse-sumo"):
        write_opendrive("some.net.xml", tmp_path / "road.xodr")
