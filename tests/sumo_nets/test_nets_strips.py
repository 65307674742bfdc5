"""Whose side is left, and whom lanes are for: networks that others make."""

from __future__ import annotations

import gzip
from collections.abc import Sequence

import numpy as np
import pytest

from service.world import agents as A
from service.world.sim.projection import locate, place
from service.world.sim.road import road_of
from sumo_nets.check import check
from sumo_nets.corridor import load_corridor
from sumo_nets.errors import NetworkError

HEAD = '<net version="1.20"><location netOffset="0,0" convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"/>'


def edge_text(
    edge: str,
    ends: Sequence[str],
    x: float,
    lanes: list[str],
    y: list[float],
    more: str = 'speed="29" length="300"',
) -> list[str]:
    """A straight edge of 300 m from x on; `lanes`: further attributes by SUMO's index; `y`: where each is drawn."""
    return [
        f'<edge id="{edge}" from="{ends[0]}" to="{ends[1]}" priority="-1">',
        *(
            f'<lane id="{edge}_{i}" index="{i}" {own} {more} shape="{x},{at} {x + 300},{at}"/>'
            for i, (own, at) in enumerate(zip(lanes, y, strict=True))
        ),
        "</edge>",
    ]


def connections(lanes: int) -> list[str]:
    """From each lane of e1 to that of e2."""
    return [
        f'<connection from="e1" to="e2" fromLane="{i}" toLane="{i}" dir="s" state="M"/>' for i in range(lanes)
    ]


def road_text(lanes: list[str], y: list[float]) -> str:
    """Edges e1 and e2 of 300 m each; `lanes`: further attributes by SUMO's index; `y`: where each is drawn."""
    e1, e2 = (edge_text(e, (f"{e}a", f"{e}b"), x, lanes, y) for e, x in (("e1", 0), ("e2", 300)))
    return "".join([HEAD, *e1, *e2, *connections(len(y)), "</net>"])


@pytest.fixture
def road(tmp_path):
    def make(lanes: list[str], y: list[float]):
        path = tmp_path / "made.net.xml"
        path.write_text(road_text(lanes, y), encoding="utf-8")
        return load_corridor(path, ["e1", "e2"])

    return make


BASE = [-8.0, -4.8, -1.6]
PLAIN = [""] * 3


def located(road, lane: int, offset_m: float = 0.0) -> np.ndarray:
    tables = road_of(road)
    agent = np.zeros(A.COLUMNS)
    place(agent, 100.0, lane, offset_m, 0.0, *tables)
    locate(agent, *tables)
    return agent


def test_the_leftmost_lane_is_the_one_that_is_drawn_there(road):
    right = road(PLAIN, BASE)
    left = road(PLAIN, [8.0, 4.8, 1.6])  # left-hand traffic: the mirror image
    swapped = road(PLAIN, BASE[::-1])  # right-hand, counted from the left
    assert right.sumo_lane[:, 10].tolist() == [2, 1, 0]
    assert left.sumo_lane[:, 10].tolist() == swapped.sumo_lane[:, 10].tolist() == [0, 1, 2]
    for made in (right, left, swapped):
        assert (np.diff(made.lane_left[:, 10]) < 0.0).all()
        assert made.lane_center(0, 10.0) == pytest.approx(3.2, abs=1e-6)
        assert made.sumo_position(0, 450.0)[0] == "e2"
    assert np.array_equal(right.lane_left, swapped.lane_left)
    assert np.array_equal(right.ref_y, swapped.ref_y)
    assert left.ref_y == pytest.approx(-right.ref_y)


def test_flags_and_reserved_lanes_are_the_mirror_image_in_left_hand_traffic(road):
    hov = ["", "", 'allow="hov bus"']  # the fast lane is the last of SUMO's in both
    right, left = road(hov, BASE), road(hov, [8.0, 4.8, 1.6])
    assert right.reserved.any(axis=1).tolist() == [True, False, False]
    assert left.reserved.any(axis=1).tolist() == [False, False, True]
    for lane in range(3):
        here, there = located(right, lane), located(left, 2 - lane)
        assert (
            here[[A.LANE_TO_THE_LEFT, A.LANE_TO_THE_RIGHT]].tolist()
            == there[[A.LANE_TO_THE_RIGHT, A.LANE_TO_THE_LEFT]].tolist()
        )
    assert located(left, 0)[[A.LANE_TO_THE_LEFT, A.LANE_TO_THE_RIGHT]].tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    "closed", ['allow="pedestrian"', 'disallow="all"', 'allow="bicycle"', 'allow="tram rail"']
)
def test_a_lane_beside_the_road_that_no_motor_vehicle_may_use_is_no_part_of_it(road, closed):
    plain = road(PLAIN, BASE)
    made = road([closed, *PLAIN, closed], [-10.85, *BASE, 1.6])
    assert made.lane_count == 3
    assert np.array_equal(made.lane_left, plain.lane_left)
    assert np.array_equal(made.road_right, plain.road_right)
    assert located(made, 2, -3.0)[A.OFF_ROAD] == 1.0


def test_a_bus_lane_is_a_reserved_lane(road):
    made = road(['allow="bus"', *PLAIN], [-11.2, *BASE])
    assert made.reserved.any(axis=1).tolist() == [False, False, False, True]
    assert located(made, 3)[A.OFF_ROAD] == 0.0
    assert located(made, 2)[A.LANE_TO_THE_RIGHT] == 0.0


def test_the_word_all_is_everybody(road):
    made = road(['allow="all"'] * 3, BASE)
    assert not made.reserved.any()
    assert made.rules is None


def test_a_closed_strip_between_two_lanes_is_off_the_road(road):
    made = road(["", 'disallow="all"', ""], BASE)
    assert made.lane_count == 3
    assert [located(made, lane)[A.OFF_ROAD] for lane in range(3)] == [0.0, 1.0, 0.0]
    assert located(made, 0)[A.LANE_TO_THE_RIGHT] == 0.0


def test_lanes_that_are_not_to_be_left_say_so_in_the_flags(road):
    plain, kept = road(PLAIN, BASE), road(["", 'changeLeft="bus" changeRight="authority"', ""], BASE)
    assert located(plain, 1)[[A.LANE_TO_THE_LEFT, A.LANE_TO_THE_RIGHT]].tolist() == [1.0, 1.0]
    assert located(kept, 1)[[A.LANE_TO_THE_LEFT, A.LANE_TO_THE_RIGHT]].tolist() == [0.0, 0.0]
    assert located(kept, 0)[A.LANE_TO_THE_RIGHT] == 1.0
    free = road(["", 'changeLeft="all" changeRight="passenger bus"', ""], BASE)
    assert located(free, 1)[[A.LANE_TO_THE_LEFT, A.LANE_TO_THE_RIGHT]].tolist() == [1.0, 1.0]


@pytest.mark.parametrize("width", [2.5, 6.0])
def test_lanes_of_just_the_width_that_is_allowed_pass(road, tmp_path, width):
    road([f'width="{width}"'] * 3, [-2.5 * width, -1.5 * width, -0.5 * width])
    report = check(tmp_path / "made.net.xml", ["e1", "e2"])
    assert report.passed, str(report)


REFUSED = {
    "routes": ("<routes/>", "is SUMO's routes: give the .net.xml that they are for"),
    "configuration": ("<configuration/>", "give the file that its <net-file> names"),
    "map": ('<osm version="0.6"/>', r"a map of OpenStreetMap, not a SUMO network: netconvert .*--osm-files"),
    "OpenDRIVE": ("<OpenDRIVE/>", "netconvert --opendrive FILE"),
    "unknown": ("<html/>", "a file of <html>, not a SUMO network: run netconvert"),
    "no XML": ("a,b\n1,2\n", "is no XML"),
    "of an encoding that is none": ('<?xml version="1.0" encoding="TF-8"?><net version="1.20"/>', "is no XML"),
    "empty": ("", "is no XML"),
    "old": (HEAD.replace("1.20", "0.13") + "</net>", r"of version 0\.13, and 1\.0 or newer is needed: netconvert -s"),
    "no lanes": (HEAD + '<edge id="e1" from="a" to="b"/><edge id="e2" from="b" to="c"/></net>', "'e1' has no lanes"),
    "no shape": (road_text(PLAIN, BASE).replace(' shape="0,-8.0 300,-8.0"', ""), "lane 'e1_0' has a shape of 0 points"),
    "a point": (road_text(PLAIN, BASE).replace("0,-8.0 300,-8.0", "0,-8.0"), "lane 'e1_0' has a shape of 1 points"),
    "no number": (road_text(PLAIN, BASE).replace("0,-8.0 300", "nan,-8.0 300"), "'e1_0' has a shape with a point that"),
    "no length": (road_text(PLAIN, BASE).replace("0,-8.0 300,", "300,-8.0 300,"), "'e1_0' has a shape of no length"),
    "width": (road_text(['width="-3"', "", ""], BASE), r"lane 'e1_0' has width -3\.0; a number above 0"),
    "all closed": (road_text(['disallow="all"'] * 3, BASE), "no lane of edge 'e1' is for motor vehicles"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_usable_network_is_refused_in_one_line(tmp_path, name):
    text, message = REFUSED[name]
    for file, data in (
        (tmp_path / "x.net.xml", text.encode()),
        (tmp_path / "x.net.xml.gz", gzip.compress(text.encode())),
    ):
        file.write_bytes(data)
        with pytest.raises(NetworkError, match=message) as refused:
            check(file, ["e1", "e2"])
        assert "\n" not in str(refused.value)
        assert "x.net.xml" in str(refused.value)


def test_a_file_that_only_says_that_it_is_packed_is_refused(tmp_path):
    (tmp_path / "x.net.xml.gz").write_text(road_text(PLAIN, BASE))
    with pytest.raises(NetworkError, match="cannot be read: Not a gzipped file"):
        check(tmp_path / "x.net.xml.gz", ["e1", "e2"])
