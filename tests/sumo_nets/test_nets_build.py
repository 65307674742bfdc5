"""The committed network is what its sources give; the sources are what the raw geometry gives."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest

from sumo_nets import build, sources
from sumo_nets.corridor import NetworkError, built_in_folder

FOLDER = built_in_folder("i80")
GEOMETRY = os.environ.get("TAILROAD_GEOMETRY", "")


def test_the_sources_give_the_committed_network(tmp_path):
    built = build.build_net("i80", out=tmp_path / "i80.net.xml")
    assert built.read_text(encoding="utf-8") == (FOLDER / "i80.net.xml").read_text(encoding="utf-8")


@pytest.mark.skipif(
    not Path(GEOMETRY, sources.GEOMETRY_FILES[0]).is_file(),
    reason="needs the raw geometry files, not in this repository: set TAILROAD_GEOMETRY to their folder",
)
def test_the_raw_geometry_gives_the_committed_sources(tmp_path):
    for path in build.write_sources("i80", Path(GEOMETRY), folder=tmp_path):
        assert path.read_text(encoding="utf-8") == (FOLDER / path.name).read_text(encoding="utf-8"), path.name


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


def test_missing_geometry_is_reported(tmp_path):
    with pytest.raises(NetworkError, match="the geometry folder must hold"):
        sources.read_geometry(tmp_path)


def test_the_command_reports_errors_without_a_traceback(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        build.main(["sources", "--geometry", str(tmp_path)])
    assert stop.value.code == 2
    assert "is missing" in capsys.readouterr().err
