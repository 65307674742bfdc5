"""The scene: where things stand, any network's, and its export."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from service.front.cli.main import main
from service.world.camera import Camera, Label, Weather, build_scene
from service.world.camera.carriageway import DASH_CYCLE_M, DASH_SHARE
from service.world.camera.export import ground_quads, meshes
from service.world.camera.poses import COLUMNS
from service.world.scenario.schema import CameraSpec
from sumo_nets.corridor import read_corridor
from tests.sumo_nets.conftest import net_text


def test_the_dashes_lie_on_the_borders_between_lanes(scene, i80):
    dashes = scene.ground.ends[scene.ground.share == DASH_SHARE].mean(axis=1)
    station, offset = i80.project(*dashes.T)
    inside = (station > 300.0) & (station < 700.0) & (np.abs(offset) < 11.5)
    borders = np.array([3.66 * k for k in range(-2, 2)])  # not beside the HOV lane, whose line is double
    assert inside.sum() == pytest.approx(4 * 400.0 / DASH_CYCLE_M, abs=6)
    assert (np.abs(offset[inside][:, None] - borders).min(axis=1) < 0.05).all()


def test_nothing_solid_stands_on_the_road(scene, i80):
    low = scene.faces.corners[scene.faces.corners[:, :, 2].min(axis=1) < 4.5]
    station, offset = i80.project(*low.reshape(-1, 3)[:, :2].T)
    inside = (station > 0.0) & (station < i80.length_m)
    k = i80.nearest_station(station[inside])
    assert ((offset[inside] > i80.road_left[k]) | (offset[inside] < i80.road_right[k])).all()


def test_the_barrier_leaves_the_ramps_open(scene, i80):
    rails = scene.faces.corners[(scene.faces.label == Label.BARRIER)].mean(axis=1)
    station, offset = i80.project(*rails[:, :2].T)
    right = offset < 0.0
    assert ((station[right] > 100.0) & (station[right] < 600.0)).sum() > 50
    merge = (station > 850.0) & (station < 870.0) & right & (offset > -15.5)
    assert not merge.any()


def test_the_scene_is_built_once_for_a_road(i80, scene):
    assert build_scene(i80) is scene


def test_a_user_s_network_gets_a_scene_and_pictures(tmp_path):
    edges = {"a": (np.array([[0.0, 0.0], [400.0, 0.0]]), [3.5] * 3)}
    path = tmp_path / "own.net.xml"
    path.write_text(net_text(edges, []), encoding="utf-8")
    corridor = read_corridor(path, ("a",))
    own = build_scene(corridor)
    poses = np.zeros((1, COLUMNS))
    x, y, heading = corridor.to_xy(50.0, corridor.lane_center(1, 50.0))
    poses[0] = float(x), float(y), float(heading), 4.5, 1.8, 0.0
    seen = Camera(CameraSpec()).images(own, poses, 0, Weather())
    share = (seen.label == Label.ASPHALT).mean()
    assert 0.15 < share < 0.7
    assert (seen.label == Label.MARKING).any()


def test_the_export_has_the_proportions_of_the_road(scene, poses, tmp_path):
    made = meshes(scene, poses)
    paint = np.vstack([g.vertices for n, g in made.geometry.items() if n.startswith("marking")])
    corners, _, label = ground_quads(scene)
    assert len(paint) == 4 * (label == Label.MARKING).sum()
    car = np.vstack([g.vertices for n, g in made.geometry.items() if n.startswith("vehicle 2 ")])
    assert car[:, 2].min() >= 0.0
    assert 1.2 < car[:, 2].max() < 1.9
    centre = car[:, :2] - poses[2, :2]
    along = centre @ [np.cos(poses[2, 2]), np.sin(poses[2, 2])]
    assert np.ptp(along) == pytest.approx(4.5, abs=0.1)
    assert corners.shape[1:] == (4, 3)


def test_the_command_writes_a_file_that_trimesh_reads(tmp_path):
    path = tmp_path / "road.glb"
    result = CliRunner().invoke(main, ["scene", "export", str(path), "i80-paper-10s"])
    assert result.exit_code == 0, result.output
    loaded = trimesh.load(path)
    names = " ".join(loaded.geometry)
    assert all(word in names for word in ("asphalt", "marking", "barrier", "wall", "building", "vehicle 5"))
    highest = 0.0
    for node in loaded.graph.nodes_geometry:
        place, name = loaded.graph[node]
        if name.startswith("wall"):
            highest = max(
                highest, trimesh.transform_points(loaded.geometry[name].vertices, place)[:, 1].max()
            )
    assert highest == pytest.approx(4.15, abs=0.01)  # y is up


def test_an_export_of_another_kind_is_refused(tmp_path):
    result = CliRunner().invoke(main, ["scene", "export", str(tmp_path / "road.fbx")])
    assert result.exit_code == 2
    assert ".glb" in result.output


def test_the_contact_sheet_is_written(tmp_path):
    path = tmp_path / "sheet.png"
    result = CliRunner().invoke(main, ["scene", "sheet", str(path), "--ego-camera"])
    assert result.exit_code == 0, result.output
    assert path.stat().st_size > 50_000
