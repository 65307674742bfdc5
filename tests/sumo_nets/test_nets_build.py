"""The committed network is what its sources give; the sources are what the raw geometry gives."""

from __future__ import annotations

import os
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from sumo_nets import build, i80_geometry, us101_geometry
from sumo_nets.corridor import BUILT_IN, NetworkError, built_in_folder

FOLDER = built_in_folder("i80")
GEOMETRY = os.environ.get("TAILROAD_GEOMETRY", "")

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
# The curves solve ill-conditioned systems, whose answers differ between processors by a small part of the last written
# digit: coordinates near a rounding boundary may have another one. The committed sources were made on one processor.
LAST_DIGIT = 1e-4


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_sources_give_the_committed_network(name, tmp_path):
    built = build.build_net(name, out=tmp_path / f"{name}.net.xml")
    committed = built_in_folder(name) / f"{name}.net.xml"
    assert built.read_text(encoding="utf-8") == committed.read_text(encoding="utf-8")


@pytest.mark.skipif(
    not (Path(GEOMETRY) / i80_geometry.GEOMETRY_FILES[0]).is_file(),
    reason="needs the raw geometry files, not in this repository: set TAILROAD_GEOMETRY to their folder",
)
@pytest.mark.parametrize("name", BUILT_IN)
def test_the_raw_geometry_gives_the_committed_sources(name, tmp_path):
    raw = {"i80": Path(GEOMETRY), "us101": Path(GEOMETRY).parent / "scenes"}[name]
    for path in build.write_sources(name, raw, folder=tmp_path):
        committed = built_in_folder(name) / path.name
        made, kept = path.read_text(encoding="utf-8"), committed.read_text(encoding="utf-8")
        assert NUMBER.sub("#", made) == NUMBER.sub("#", kept), path.name
        apart = np.abs(np.array(NUMBER.findall(made), float) - np.array(NUMBER.findall(kept), float))
        assert apart.max() < 1.01 * LAST_DIGIT, path.name


def test_no_date_and_no_machine_path_is_in_the_committed_network():
    head = (FOLDER / "i80.net.xml").read_text(encoding="utf-8")[:1500]
    assert "generated on" not in head
    assert "<configuration" not in head
    assert "/tmp" not in head


def test_the_hov_lane_is_the_leftmost_and_closed_to_cars():
    root = ElementTree.parse(FOLDER / "i80.net.xml").getroot()
    for edge in (e for e in root.iter("edge") if e.get("id").startswith("i80_")):
        lanes = list(edge.iter("lane"))
        assert "hov" in lanes[-1].get("allow").split()
        assert "passenger" not in lanes[-1].get("allow").split()
        for lane in lanes[:-1]:
            assert "passenger" not in lane.get("disallow").split()
            assert "hov" not in lane.get("disallow").split()


def test_a_missing_netconvert_is_reported():
    with pytest.raises(NetworkError, match="netconvert comes with SUMO"):
        build.find_netconvert("no-such-program")


@pytest.mark.parametrize("geometry", [i80_geometry, us101_geometry])
def test_missing_geometry_is_reported(geometry, tmp_path):
    with pytest.raises(NetworkError, match="the geometry folder must hold"):
        geometry.read_geometry(tmp_path)


@pytest.mark.parametrize(
    "text", ["", "BOUNDARIES\n1", "CENTERLINES\n1\nCENTERLINE\na\n2\n 1.0 2.0\n", "CENTERLINES\nx"]
)
def test_a_broken_drawing_is_reported(text, tmp_path):
    (tmp_path / "sisl_centerlines101.txt").write_text(text, encoding="utf-8")
    with pytest.raises(NetworkError, match="not a list of centre lines"):
        us101_geometry.read_geometry(tmp_path)


def test_the_command_reports_errors_without_a_traceback(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        build.main(["sources", "--geometry", str(tmp_path)])
    assert stop.value.code == 2
    assert "is missing" in capsys.readouterr().err
