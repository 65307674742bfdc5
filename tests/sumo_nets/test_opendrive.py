"""OpenDRIVE roads as SUMO networks: lanes for cars, hard shoulders closed, what is lost said, what is none refused."""

from xml.etree import ElementTree as ET

import pytest

from sumo_nets.check import check
from sumo_nets.corridor import load_corridor
from sumo_nets.errors import NetworkError
from sumo_nets.opendrive import KEPT, import_opendrive

LANE = '<lane id="-{n}" type="{kind}"><width sOffset="0" a="{a}" b="{b}" c="0" d="0"/>{more}</lane>'


def opendrive(first: str = "driving", second: str = "driving", taper: float = 0.0, more: str = "") -> str:
    lanes = LANE.format(n=1, kind=first, a=3.5, b=0, more=more) + LANE.format(
        n=2, kind=second, a=3.5 - 400.0 * taper, b=taper, more=""
    )
    shoulder = LANE.format(n=3, kind="stop", a=2.5, b=0, more="")
    return ROAD.format(lanes=lanes + shoulder)


ROAD = """<OpenDRIVE><header revMajor="1" revMinor="6" name="r" version="1"/>
<road name="r" length="400" id="7" junction="-1"><type s="0" type="motorway"/>
<planView><geometry s="0" x="0" y="0" hdg="0" length="400"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>{lanes}</right></laneSection></lanes>
</road></OpenDRIVE>
"""


def imported(folder, text: str):
    (folder / "road.xodr").write_text(text)
    return import_opendrive(folder / "road.xodr", folder / "road.net.xml")


def test_a_road_comes_in_with_its_lanes_and_without_its_hard_shoulder(tmp_path):
    made = imported(tmp_path, opendrive())
    assert made.lost == ()
    assert [(name, round(length)) for name, _, length in made.edges] == [("-7", 400)]
    road = load_corridor(tmp_path / "road.net.xml", ["-7"])
    assert road.lane_left.shape[0] == 2
    assert (road.lane_left - road.lane_right) == pytest.approx(3.5, abs=0.01)
    assert check(tmp_path / "road.net.xml", ["-7"]).passed


def test_tapering_lanes_and_rules_that_are_not_known_are_said_to_be_lost(tmp_path):
    text = opendrive(taper=0.005, more='<access sOffset="0" rule="allow" restriction="HOV"/>')
    assert imported(tmp_path, text).lost == (
        "road 7, lane -1: access for HOV, which netconvert does not know: edit allow and disallow in the network",
        "road 7, lane -2: 1.50 to 3.50 m wide from 0 to 400 m; it comes in over all of it, in pieces of one width each",
    )


@pytest.mark.parametrize("who", sorted({*KEPT} - {"pedestrian"}))  # who may use no lane of a motorway anyway
def test_rules_that_are_known_are_in_the_network(tmp_path, who):
    made = imported(tmp_path, opendrive(more=f'<access sOffset="0" rule="deny" restriction="{who}"/>'))
    assert made.lost == ()
    lanes = [
        lane for lane in ET.parse(tmp_path / "road.net.xml").iterfind("edge/lane") if lane.get("id")[0] != ":"
    ]
    left, right = max(lanes, key=lambda lane: int(lane.get("index"))), lanes[-2]
    assert (left.get("allow"), left.get("disallow")) != (
        right.get("allow"),
        right.get("disallow"),
    )


WALKS = opendrive("sidewalk", "sidewalk").replace('"stop"', '"border"')
REFUSED = {
    "a scenario": ("<OpenSCENARIO/>", "<OpenSCENARIO>; expected an ASAM OpenDRIVE file"),
    "no XML": ("road", "not XML"),
    "entities": ("<!DOCTYPE a><OpenDRIVE/>", "declares entities of its own"),
    "no lanes": (WALKS, "netconvert could not read it|no lane in it"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_road_is_refused_in_one_line(tmp_path, name):
    text, message = REFUSED[name]
    with pytest.raises(NetworkError, match=message) as refused:
        imported(tmp_path, text)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "road.net.xml").exists()
