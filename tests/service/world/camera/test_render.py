"""The renderer: against a ray caster, the same bits again, and what weather, lens and sensor do."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np
import pytest

from service.errors import InputError
from service.world.camera import VEHICLE_ID, Camera, Label, Weather
from service.world.camera.export import quads, vehicle_quads
from service.world.camera.poses import COLUMNS, LENGTH_M
from service.world.scenario.schema import CameraSpec

CLEAR = Weather()
GROUND = (Label.TERRAIN, Label.WATER, Label.ASPHALT, Label.SHOULDER, Label.MARKING)


def cast(scene, poses, eye, directions) -> tuple[np.ndarray, np.ndarray]:
    """Depth along the axis and label of the nearest solid or the ground, by trimesh; inf and 0 where there is sky."""
    corners, labels = [scene.faces.corners], [scene.faces.label.astype(int)]
    for row in range(1, len(poses)):
        own, _ = vehicle_quads(poses[row], row)
        corners.append(own)
        labels.append(np.full(len(own), VEHICLE_ID + row))
    mesh = quads(np.concatenate(corners))
    every = np.concatenate(labels)
    where, ray, triangle = mesh.ray.intersects_location(np.tile(eye, (len(directions), 1)), directions)
    depth = np.full(len(directions), np.inf)
    label = np.zeros(len(directions), int)
    down = directions[:, 2] < -1e-9
    depth[down] = -eye[2] / directions[down, 2]
    label[down] = Label.ASPHALT
    facing = np.einsum("ij,ij->i", mesh.face_normals[triangle], directions[ray]) < 0.0
    along = np.einsum("ij,ij->i", where - eye, directions[ray]) / np.einsum(
        "ij,ij->i", directions[ray], directions[ray]
    )
    for k in np.flatnonzero(facing & (along > 0.1)):
        if along[k] < depth[ray[k]] and along[k] < 4500.0:
            depth[ray[k]], label[ray[k]] = along[k], every[triangle[k] // 2]
    return depth, label


@pytest.mark.parametrize("pitch", [-4.5, 2.0])
def test_depth_and_labels_are_those_of_a_ray_caster(scene, poses, pitch):
    camera = Camera(CameraSpec(width_px=400, height_px=200, pitch_deg=pitch))
    seen = camera.images(scene, poses, 0, CLEAR)
    eye, directions = camera.rays(poses[0])
    pixels = np.random.default_rng(3).choice(400 * 200, 250, replace=False)
    depth, label = cast(scene, poses, eye, directions.reshape(-1, 3)[pixels])
    drawn_depth, drawn_label = seen.depth_m.ravel()[pixels], seen.label.ravel()[pixels].astype(int)
    drawn_label[np.isin(drawn_label, GROUND) & (drawn_label != 0)] = Label.ASPHALT
    label[np.isin(label, GROUND)] = Label.ASPHALT
    same = (drawn_label == label) & np.isclose(drawn_depth, depth, rtol=2e-3)
    same |= (drawn_label == label) & (label == Label.SKY)
    # faces that look thinner than half a pixel are left out, and the hills stand on the ground's far end
    assert same.mean() > 0.96, f"{(~same).sum()} of {len(pixels)} differ"
    vehicle = label >= VEHICLE_ID
    assert vehicle.sum() > 10
    assert same[vehicle].mean() > 0.9


def test_the_same_arguments_give_the_same_bits(scene, poses):
    pictures = [
        Camera(CameraSpec()).render(scene, poses, 0, Weather(-10.0, 0.0, 3.0, 4.0), 7, 3) for _ in range(2)
    ]
    assert np.array_equal(*pictures)


def test_a_picture_does_not_depend_on_what_was_drawn_before(scene, poses, camera):
    first = camera.render(scene, poses, 0, CLEAR, 1, 0)
    camera.images(scene, poses, 3, Weather(-15.0, 10.0, 20.0, 9.0), 5, 8)
    assert np.array_equal(camera.render(scene, poses, 0, CLEAR, 1, 0), first)


def test_the_picture_with_depth_is_the_picture_without(scene, poses, camera):
    assert np.array_equal(
        camera.images(scene, poses, 0, CLEAR, 1, 2).rgb, camera.render(scene, poses, 0, CLEAR, 1, 2)
    )


def test_noise_comes_from_seed_and_frame_and_has_its_size(scene, poses, camera):
    quiet = Camera(CameraSpec(sensor_noise_levels=0.0)).render(scene, poses, 0, CLEAR, 1, 0).astype(int)
    one, other, later = (
        camera.render(scene, poses, 0, CLEAR, s, f).astype(int) for s, f in ((1, 0), (2, 0), (1, 1))
    )
    assert not np.array_equal(one, other)
    assert not np.array_equal(one, later)
    middle = (quiet > 20) & (quiet < 235)
    assert (one - quiet)[middle].std() == pytest.approx(2.0, rel=0.1)
    assert abs((one - quiet)[middle].mean()) < 0.1


def test_a_vehicle_ahead_is_where_geometry_says(scene, poses, camera):
    seen = camera.images(scene, poses, 0, CLEAR)
    eye, directions = camera.rays(poses[0])
    van = seen.label == VEHICLE_ID + 1
    assert van.sum() > 100
    points = eye + seen.depth_m[van][:, None] * directions[van]
    off = points[:, :2] - poses[1, :2]
    reach = 0.5 * np.hypot(poses[1, LENGTH_M], 2.1)
    assert (np.hypot(*off.T) < reach + 0.05).all()
    assert points[:, 2].max() < 2.35
    assert not (seen.label == VEHICLE_ID).any()  # the vehicle that carries the camera


@pytest.mark.parametrize(("ahead", "left", "share"), [(4.1, 0.0, 0.3), (1.0, 2.2, 0.15)])
def test_a_vehicle_close_by_is_clipped_not_dropped(scene, poses, camera, ahead, left, share):
    close = poses.copy()
    sine, cosine = np.sin(close[0, 2]), np.cos(close[0, 2])
    close[1, :3] = close[0, :3] + [ahead * cosine - left * sine, ahead * sine + left * cosine, 0.0]
    seen = camera.images(scene, close, 0, CLEAR)
    assert (seen.label == VEHICLE_ID + 1).mean() > share
    assert seen.depth_m[seen.label == VEHICLE_ID + 1].min() > 0.1


def test_a_vehicle_that_has_left_is_not_drawn(scene, poses, camera):
    gone = poses.copy()
    gone[1:, LENGTH_M] = 0.0
    assert camera.images(scene, gone, 0, CLEAR).label.max() < VEHICLE_ID


def contrast(scene, poses, camera, weather) -> float:
    """Of the truck 60 m ahead against the picture round it, in levels."""
    near = camera.images(scene, poses, 0, CLEAR).label == VEHICLE_ID + 5
    picture = camera.render(scene, poses, 0, weather).astype(float).mean(axis=2)
    ring = cv2.dilate(near.astype(np.uint8), np.ones((5, 5))).astype(bool) & ~near
    return abs(picture[near].mean() - picture[ring].mean())


def test_fog_hides_what_is_far(scene, poses, camera):
    values = [contrast(scene, poses, camera, Weather(fog_per_km=fog)) for fog in (0.15, 20.0, 60.0)]
    assert values[0] > values[1] > values[2]
    assert values[2] < 0.25 * values[0]


def test_night_is_darker_than_day_and_exposure_brightens(scene, poses, camera):
    def brightness(**weather) -> float:
        return float(camera.render(scene, poses, 0, Weather(**weather)).mean())

    day, dusk, night = (brightness(sun_elevation_deg=e) for e in (45.0, -3.0, -16.0))
    assert day > night + 40.0
    assert dusk > night + 20.0
    dark, usual, bright = (brightness(exposure_ev=ev) for ev in (-1.0, 0.0, 1.0))
    assert dark < usual < bright


def test_markings_stand_out_from_the_road_by_day_and_by_night(scene, poses, camera):
    label = camera.images(scene, poses, 0, CLEAR).label
    rows = np.arange(66)[:, None] > 40
    for weather in (CLEAR, Weather(sun_elevation_deg=-16.0), Weather(rain_mmph=8.0)):
        picture = camera.render(scene, poses, 0, weather).astype(float).mean(axis=2)
        paint, road = (picture[(label == k) & rows].mean() for k in (Label.MARKING, Label.ASPHALT))
        assert paint > road + 15.0


def test_brake_lights_redden_the_picture(scene, poses, camera):
    braking = poses.copy()
    braking[1, 5] = -4.0
    calm, red = (camera.render(scene, p, 0, CLEAR).astype(int)[..., 0].sum() for p in (poses, braking))
    assert red > calm


def test_roll_turns_the_horizon(scene, poses):
    spec = CameraSpec(roll_deg=10.0)
    sky = Camera(spec).images(scene, poses[:1], 0, CLEAR).label == Label.SKY
    # rolled clockwise, the camera sees the horizon fall towards the left
    assert sky[:, :20].sum() > sky[:, -20:].sum()


def test_rays_of_a_distorted_picture_project_back_to_their_pixels(scene, poses):
    spec = CameraSpec(distortion=(-0.15, 0.02, 0.001, 0.0, 0.0))
    camera = Camera(spec)
    _, directions = camera.rays(poses[0])
    level = Camera(msgspec.structs.replace(spec, distortion=()))
    level.rays(poses[0])
    axes = level._state[3:12].reshape(3, 3)
    focal = 100.0 / np.tan(np.radians(33.0))
    matrix = np.array([[focal, 0.0, 100.0], [0.0, focal, 33.0], [0.0, 0.0, 1.0]])
    own = (directions.reshape(-1, 3) @ axes.T).astype(np.float64)
    pixels, _ = cv2.projectPoints(own, np.zeros(3), np.zeros(3), matrix, np.array(spec.distortion))
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(66) + 0.5)
    error = np.abs(pixels[:, 0] - np.column_stack([x.ravel(), y.ravel()])).max()
    assert error < 1.0  # the nearest sample


def test_a_lens_that_cannot_be_is_refused():
    with pytest.raises(InputError, match=r"distortion .* cannot be undone"):
        Camera(CameraSpec(hfov_deg=140.0, distortion=(-1.5, 0.0, 0.0, 0.0, 0.0)))


def test_weather_that_is_not_finite_is_refused(scene, poses, camera):
    with pytest.raises(ValueError, match="finite"):
        camera.render(scene, poses, 0, Weather(fog_per_km=float("nan")))


def test_poses_have_the_documented_columns(poses):
    assert poses.shape[1] == COLUMNS == 6
