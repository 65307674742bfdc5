"""The scene as triangle meshes of trimesh: for standard tools, and for checking the renderer against a ray caster."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from policies.exactmath import sincos
from service.errors import InputError
from service.world.camera.bodies import PAINT, PALETTE, PARTS, bodies, body_of
from service.world.camera.ground import LAYERS
from service.world.camera.labels import VEHICLE_ID, Label
from service.world.camera.poses import HEADING_RAD, LENGTH_M, WIDTH_M, X_M, Y_M
from service.world.camera.scene import Scene

LIFT_M = 0.01  # of each layer of the ground above the one below: in a viewer they would flicker
COUNTRY_M = 800.0  # open country round everything else
COLOURS = "exact colours"  # of materials by name, in a scene's metadata
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
# glTF's y is up; its -z is the network's y
Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def quads(corners: np.ndarray) -> trimesh.Trimesh:
    """A mesh of quadrilaterals (k, 4, 3), two triangles each, every corner its own."""
    k = len(corners)
    faces = (TRIANGLES[None] + 4 * np.arange(k)[:, None, None]).reshape(-1, 3)
    return trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)


def ground_quads(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What lies on the ground: corners (k, 4, 3), layer above layer, reflectances (k, 3), labels."""
    ground = scene.ground
    fine = ground.layer < LAYERS
    corners = np.concatenate([ground.corners[fine], np.zeros((int(fine.sum()), 4, 1))], axis=2)
    corners[:, :, 2] = LIFT_M * (1 + ground.layer[fine])[:, None]
    along = ground.ends[:, 1] - ground.ends[:, 0]
    length = np.maximum(np.hypot(*along.T), 1e-9)
    side = ground.half_m[:, None] * np.column_stack([-along[:, 1], along[:, 0]]) / length[:, None]
    begin, end = ground.ends[:, 0], ground.ends[:, 0] + ground.share[:, None] * along
    painted = np.stack([begin + side, begin - side, end - side, end + side], axis=1)
    height = np.full((len(painted), 4, 1), LIFT_M * (1 + LAYERS))
    return (
        np.concatenate([corners, np.concatenate([painted, height], axis=2)]),
        np.concatenate([ground.albedo[fine], ground.line_albedo]),
        np.concatenate([ground.label[fine], np.full(len(painted), int(Label.MARKING), np.uint16)]),
    )


def vehicle_quads(pose: np.ndarray, row: int) -> tuple[np.ndarray, np.ndarray]:
    """The body of the vehicle in `row` at `pose` (6,): corners (k, 4, 3) and reflectances (k, 3)."""
    table = bodies()
    body = int(body_of(float(pose[LENGTH_M]), row))
    faces = slice(int(table.start[body]), int(table.start[body + 1]))
    own = table.corners[faces] * (pose[LENGTH_M], pose[WIDTH_M], table.height_m[body])
    sine, cosine = sincos(float(pose[HEADING_RAD]))
    turned = own @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    paint = PALETTE[(row * 5 + row // 7) % len(PALETTE)]
    part = table.part[faces]
    place = np.array([pose[X_M], pose[Y_M], 0.0])
    return turned + place, np.where((part == PAINT)[:, None], paint, PARTS[part])


def meshes(scene: Scene, poses: np.ndarray | None = None) -> trimesh.Scene:
    """The scene as meshes, one for each kind of surface, with the vehicles of `poses` (n, 6); z is up, metres."""
    corners, albedo, label = ground_quads(scene)
    parts = [(corners, albedo, label), (scene.faces.corners, scene.faces.albedo, scene.faces.label)]
    low, high = scene.ground.ends.min(axis=(0, 1)) - COUNTRY_M, scene.ground.ends.max(axis=(0, 1)) + COUNTRY_M
    country = np.array(
        [[[low[0], low[1], 0.0], [high[0], low[1], 0.0], [*high, 0.0], [low[0], high[1], 0.0]]]
    )
    parts.append((country, scene.stage.country[None], np.array([int(Label.TERRAIN)])))
    for row, pose in enumerate(np.empty((0, 6)) if poses is None else poses):
        if pose[LENGTH_M] > 0.0:
            own, colours = vehicle_quads(pose, row)
            parts.append((own, colours, np.full(len(own), VEHICLE_ID + row)))
    every, colour, kind = (np.concatenate([p[i] for p in parts]) for i in range(3))
    surfaces, which = np.unique(np.column_stack([kind, colour]).round(6), axis=0, return_inverse=True)
    made = trimesh.Scene()
    made.metadata[COLOURS] = {}
    for i, surface in enumerate(surfaces):
        code = int(surface[0])
        name = f"vehicle {code - VEHICLE_ID}" if code >= VEHICLE_ID else Label(code).name.lower()
        mesh = quads(every[which.ravel() == i])
        mesh.visual = trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.PBRMaterial(
                name=f"{name} {i}",
                baseColorFactor=[*surface[1:], 1.0],
                metallicFactor=0.0,
                roughnessFactor=0.9,
            )
        )
        made.metadata[COLOURS][f"{name} {i}"] = [*surface[1:].tolist(), 1.0]
        made.add_geometry(mesh, geom_name=f"{name} {i}", node_name=f"{name} {i}")
    return made


def export(scene: Scene, path: Path, poses: np.ndarray | None = None) -> None:
    """Write the scene to a file of a kind that trimesh knows by its ending: .glb, .gltf, .obj, .ply, .stl.

    glTF files are turned so that y is up, as that format says; InputError for another ending or a file that cannot be
    written.
    """
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("glb", "obj", "ply", "stl"):
        raise InputError(f"{path}: meshes are written as .glb, .obj, .ply or .stl; give such a file")
    made = meshes(scene, poses)
    if kind == "glb":
        for mesh in made.geometry.values():  # the vertices themselves: not every reader minds nodes
            mesh.apply_transform(Y_UP)
    options = {"tree_postprocessor": _exact_colours(made)} if kind == "glb" else {}
    try:
        made.export(str(path), **options)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from error


def _exact_colours(made: trimesh.Scene) -> Callable[[dict[str, Any]], None]:
    """Puts reflectances into a glTF tree as they are: trimesh keeps base colours in bytes, 18% off for dark ones."""
    exact = made.metadata[COLOURS]

    def put(tree: dict[str, Any]) -> None:
        for material in tree["materials"]:
            material["pbrMetallicRoughness"]["baseColorFactor"] = exact[material["name"]]

    return put
