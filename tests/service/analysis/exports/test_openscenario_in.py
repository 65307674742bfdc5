"""OpenSCENARIO files read again: tailroad's own to 1 mm and with the same f, those of others or refused in one line."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import numpy as np
import pytest

from service.analysis.exports.openscenario import openscenario_text
from service.analysis.exports.openscenario_in import f_of, read_openscenario
from service.errors import InputError
from service.world import agents as A

SEEN = [A.X_M, A.Y_M, A.HEADING_RAD, A.SPEED_MPS, A.LENGTH_M, A.WIDTH_M, A.ACTIVE]


@pytest.fixture(scope="module")
def trace(trace_of):
    return trace_of("i80-paper-10s")


@pytest.fixture(scope="module")
def text(trace):
    return openscenario_text(trace, "drive", datetime(2026, 12, 1, tzinfo=UTC))


def drive_of(folder, text: str, ego: str | None = None):
    (folder / "drive.xosc").write_text(text, encoding="utf-8")
    return read_openscenario(folder / "drive.xosc", ego)


def test_our_own_files_come_back_to_1_mm_with_the_same_f(trace, text, tmp_path):
    drive = drive_of(tmp_path, text)
    assert drive.names == trace.names
    assert drive.ego == trace.ego
    assert drive.agents.shape == trace.agents.shape
    active = trace.agents[:, :, A.ACTIVE] != 0.0
    apart = np.abs(drive.agents[:, :, SEEN] - trace.agents[:, :, SEEN])[active]
    assert apart.max() < 1e-6
    f, values = f_of(drive, "ttc")
    assert trace.measure == "ttc"
    assert f == pytest.approx(trace.rollout.f, rel=1e-6)
    assert np.allclose(values, trace.measured, rtol=1e-5)


def test_speeds_are_told_from_positions_where_a_file_has_none(trace, text, tmp_path):
    other = re.sub(r"<Property name=.tailroad speed_mps.[^>]*>", "", text)
    drive = drive_of(tmp_path, other)
    apart = np.abs(drive.agents[:, :, A.SPEED_MPS] - trace.agents[:, :, A.SPEED_MPS])
    assert np.quantile(apart, 0.9) < 0.2
    assert f_of(drive, "ttc")[0] == pytest.approx(trace.rollout.f, rel=0.1)


def test_a_contact_ends_the_drive_and_its_f_is_the_impact(text, tmp_path):
    vertices = "".join(
        f'<Vertex time="{t:.1f}"><Position><WorldPosition x="{x:.6f}" y="0" h="0"/></Position></Vertex>'
        for t, x in ((0.1 * k, 20.0 * 0.1 * k) for k in range(40))
    )
    text = two_cars(vertices, ahead_m=30.0)
    f, values = f_of(drive_of(tmp_path, text, "Tester"), "ttc-impact")
    assert f == pytest.approx(-20.0, abs=1e-6)  # a wall at 30 m, boxes of 4 m: 26 m at 20 m/s
    assert len(values) == 14


def two_cars(vertices: str, ahead_m: float) -> str:
    """The ego along `vertices`, and a car that stands ahead of it."""
    standing = "".join(
        f'<Vertex time="{t}"><Position><WorldPosition x="{ahead_m}" y="0" h="0"/></Position></Vertex>'
        for t in (0, 9)
    )
    entities, groups = "", ""
    for name, line in (("Tester", vertices), ("Wall", standing)):
        entities += ENTITY.format(name=name)
        groups += GROUP.format(name=name, line=line)
    story = f"<Story name='s'><Act name='a'>{groups}</Act></Story>"
    return f"<OpenSCENARIO><Entities>{entities}</Entities><Storyboard>{story}</Storyboard></OpenSCENARIO>"


ENTITY = """<ScenarioObject name="{name}"><Vehicle name="{name}" vehicleCategory="car"><BoundingBox>
<Center x="0" y="0" z="0.7"/><Dimensions length="4" width="2" height="1.5"/></BoundingBox></Vehicle></ScenarioObject>"""
GROUP = """<ManeuverGroup name="{name}"><Actors><EntityRef entityRef="{name}"/></Actors><Maneuver><Event name="e">
<Action name="a"><PrivateAction><RoutingAction><FollowTrajectoryAction>
<TrajectoryRef><Trajectory><Shape><Polyline>{line}</Polyline></Shape></Trajectory></TrajectoryRef>
<TimeReference><Timing domainAbsoluteRelative="absolute" scale="1" offset="0"/></TimeReference>
</FollowTrajectoryAction></RoutingAction></PrivateAction></Action></Event></Maneuver></ManeuverGroup>"""
LINE = '<Vertex time="0"><Position><WorldPosition x="0" y="0"/></Position></Vertex>' \
    '<Vertex time="1"><Position><WorldPosition x="9" y="0"/></Position></Vertex>'  # fmt: skip
GOOD = two_cars(LINE, 30.0)
CHANGE = "<LateralAction><LaneChangeAction/></LateralAction>"
CHANGED = re.sub("(?s)<RoutingAction>.*?</RoutingAction>", CHANGE, GOOD, count=1)
CATALOG = re.sub("(?s)<Vehicle.*?</Vehicle>", "<CatalogReference/>", GOOD, count=1)
ALONE = re.sub("(?s)<ManeuverGroup name=.Wall.*?</ManeuverGroup>", "", GOOD)
REFUSED = {
    "a lane change": (CHANGED, "LaneChangeAction of Tester in 'e'; only"),
    "a catalog": (CATALOG, "Tester is given as CatalogReference"),
    "a lane position": (GOOD.replace("WorldPosition", "LanePosition", 1), "a vertex of Tester lies at LanePosition"),
    "a parameter": (GOOD.replace('x="9"', 'x="$far"'), r"x = '\$far' in WorldPosition of Tester; expected a number"),
    "relative times": (GOOD.replace('"absolute"', '"relative"'), "of Tester has no absolute times"),
    "times that go back": (GOOD.replace('time="1"', 'time="-1"'), "expected two or more in order of time"),
    "no trajectory": (ALONE, "Wall follows no trajectory"),
    "nobody called so": (GOOD.replace("Tester", "Car"), "no vehicle is called Tester; name one of Car, Wall"),
    "a road": ("<OpenDRIVE/>", "<OpenDRIVE>; expected an ASAM OpenSCENARIO XML file"),
    "a catalog file": ("<OpenSCENARIO><Catalog/></OpenSCENARIO>", "no Storyboard"),
    "entities": ("<!DOCTYPE x [<!ENTITY a 'b'>]><OpenSCENARIO/>", "declares entities of its own"),
    "no XML": ("speed = 3", "not XML"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_read_is_refused_in_one_line(tmp_path, name):
    text, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as refused:
        drive_of(tmp_path, text, "Tester")
    assert "\n" not in str(refused.value)


def test_measures_that_need_lanes_are_refused(tmp_path):
    with pytest.raises(InputError, match="of trajectories without lanes there are ttc"):
        f_of(drive_of(tmp_path, GOOD, "Tester"), "rss")
