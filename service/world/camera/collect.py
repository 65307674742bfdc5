"""From the scene and the vehicles to the list of polygons that a picture shows."""

import math
from typing import NamedTuple

import numpy as np

from policies.exactmath import sincos
from policies.jit import bare
from service.world.camera.bodies import Bodies, add_vehicle, add_vehicle_shadow
from service.world.camera.columns import (
    BOTTOM,
    CENTRE_X,
    COLOUR,
    CORNERS,
    COUNT,
    EYE,
    FACE,
    FOCAL,
    FORWARD,
    GROUND,
    GROUND_LIGHT,
    HEIGHT,
    HORIZON,
    KIND,
    LABEL,
    LINE_ALBEDO,
    LINE_HALF_M,
    LINE_RETRO,
    LINE_SHARE,
    MIRROR,
    RANGE_M,
    RIGHT,
    SIZE,
    STRIP_ALBEDO,
    STRIP_LABEL,
    STRIP_RETRO,
    TOP,
    WIDTH,
    X,
    Y,
)  # fmt: skip
from service.world.camera.faces import SMALLEST, add_face, add_ground
from service.world.camera.ground import ASPHALT, LAYERS, WEAR
from service.world.camera.labels import Label
from service.world.camera.poses import HEADING_RAD, LENGTH_M, X_M, Y_M
from service.world.camera.scene import Stage

COARSE_M = 0.30  # cells are drawn in coarse pieces where this looks like less than a sample
WEAR_M = 0.20  # wear is drawn where this looks like more than a sample
FAINTEST = 0.022  # painted lines whose contrast in the picture is less are left out
THINNEST = 0.75  # half the least width of a painted line, in samples
LINE_RANGE_M = 350.0
ROAD_ALBEDO = ASPHALT.albedo[0]
TERRAIN = int(Label.TERRAIN)
MARKING = int(Label.MARKING)


class Scratch(NamedTuple):
    """Room for the kernels below, which allocate nothing."""

    cells: np.ndarray
    world: np.ndarray  # (4, 3)
    hull: np.ndarray  # (9, 3), heights 0
    feet: np.ndarray  # (8, 2)
    face: np.ndarray  # (1, FACE)
    points: np.ndarray  # (CORNERS, 3)


def scratch_for(stage: Stage) -> Scratch:
    """Room for collecting from a scene."""
    return Scratch(
        np.zeros(len(stage.cells), np.int64),
        np.zeros((4, 3)),
        np.zeros((9, 3)),
        np.zeros((8, 2)),
        np.zeros((1, FACE)),
        np.zeros((CORNERS, 3)),
    )


@bare
def _visible(cells: np.ndarray, camera: np.ndarray, out: np.ndarray) -> int:
    """Fill `out` with the cells that can be seen, in their order; returns how many."""
    count = 0
    spread = max(camera[CENTRE_X], camera[WIDTH] - camera[CENTRE_X]) / camera[FOCAL]
    secant = math.sqrt(1.0 + spread * spread)
    for c in range(cells.shape[0]):
        dx, dy, dz = cells[c, 0] - camera[EYE], cells[c, 1] - camera[EYE + 1], cells[c, 2] - camera[EYE + 2]
        radius = cells[c, 3]
        ahead = dx * camera[FORWARD] + dy * camera[FORWARD + 1] + dz * camera[FORWARD + 2]
        if ahead < -radius or ahead > camera[RANGE_M] + radius:
            continue
        aside = abs(dx * camera[RIGHT] + dy * camera[RIGHT + 1])
        if aside > spread * ahead + radius * secant:
            continue
        out[count] = c
        count += 1
    return count


@bare
def _distance(cells: np.ndarray, c: int, camera: np.ndarray) -> float:
    """From the camera to the nearest point of a cell, at least 0."""
    dx, dy = cells[c, 0] - camera[EYE], cells[c, 1] - camera[EYE + 1]
    return max(math.sqrt(dx * dx + dy * dy) - cells[c, 3], 0.0)


@bare
def _add_line(
    lines: np.ndarray,
    m: int,
    camera: np.ndarray,
    world: np.ndarray,
    points: np.ndarray,
    out: np.ndarray,
    k: int,
) -> int:
    """Add a painted line as row k; returns the new count.

    Where it looks thinner than a sample it is drawn a sample wide and paler, and where its dashes run together it is
    drawn whole and paler: what a sensor sees, without flicker.
    """
    along_x, along_y = lines[m, 2] - lines[m, 0], lines[m, 3] - lines[m, 1]
    dx = 0.5 * (lines[m, 0] + lines[m, 2]) - camera[EYE]
    dy = 0.5 * (lines[m, 1] + lines[m, 3]) - camera[EYE + 1]
    length = math.sqrt(along_x * along_x + along_y * along_y)
    if dx * camera[FORWARD] + dy * camera[FORWARD + 1] < -length or length < 1e-6:
        return k
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > min(LINE_RANGE_M, camera[RANGE_M]):
        return k
    # how wide a sample is across the line: lines beside the camera look thinner than those ahead
    height = camera[EYE + 2]
    aside = (dx * along_y - dy * along_x) / (length * height)
    sample_m = distance / camera[FOCAL] * math.sqrt(1.0 + aside * aside)
    share, half, strength = lines[m, LINE_SHARE], lines[m, LINE_HALF_M], 1.0
    if length < 1.6 * distance * distance / (camera[FOCAL] * height):  # the length of road that a row shows
        strength = share
        share = 1.0
    if half < THINNEST * sample_m:
        strength *= half / (THINNEST * sample_m)
        half = THINNEST * sample_m
    if strength * abs(lines[m, LINE_ALBEDO] - ROAD_ALBEDO) < FAINTEST:
        return k
    nx, ny = -along_y / length * half, along_x / length * half
    ex, ey = lines[m, 0] + share * along_x, lines[m, 1] + share * along_y
    world[0, 0], world[0, 1] = lines[m, 0] + nx, lines[m, 1] + ny
    world[1, 0], world[1, 1] = lines[m, 0] - nx, lines[m, 1] - ny
    world[2, 0], world[2, 1] = ex - nx, ey - ny
    world[3, 0], world[3, 1] = ex + nx, ey + ny
    red = ROAD_ALBEDO + strength * (lines[m, LINE_ALBEDO] - ROAD_ALBEDO)
    green = ROAD_ALBEDO + strength * (lines[m, LINE_ALBEDO + 1] - ROAD_ALBEDO)
    blue = ROAD_ALBEDO + strength * (lines[m, LINE_ALBEDO + 2] - ROAD_ALBEDO)
    retro = 1.0 + strength * (lines[m, LINE_RETRO] - 1.0)
    return add_ground(world, 4, red, green, blue, retro, MARKING, camera, points, out, k)


@bare
def collect(stage: Stage, bodies: Bodies, poses: np.ndarray, own: int, camera: np.ndarray, scratch: Scratch,
            out: np.ndarray) -> int:  # fmt: skip
    """Fill `out` (n, POLYGON) and return the count.

    Row 0 is the open country's colour; then come the ground in order, shadows, and the solids.

    poses: (n, 6); `own` is the row that carries the camera and is not drawn, or -1
    """
    for c in range(3):
        out[0, COLOUR + c] = stage.country[c] * camera[GROUND_LIGHT + c]
        out[0, MIRROR + c] = stage.country[c]
    out[0, KIND] = GROUND
    out[0, LABEL] = TERRAIN
    # everything below the horizon, as a rectangle
    top = max(camera[HORIZON], 0.0)
    out[0, COUNT], out[0, TOP], out[0, BOTTOM] = 4, math.ceil(top - 0.5), camera[HEIGHT]
    for i in range(4):
        out[0, X + i] = 0.0 if i < 2 else camera[WIDTH]
        out[0, Y + i] = top if i == 0 or i == 3 else camera[HEIGHT]
    k = 1
    cells, world, points, face = scratch.cells, scratch.world, scratch.points, scratch.face
    for j in range(4):
        world[j, 2] = 0.0
    strips, lines, faces = stage.strips, stage.lines, stage.faces
    found = _visible(stage.cells, camera, cells)
    for layer in range(LAYERS):
        for i in range(found):
            c = cells[i]
            samples = camera[FOCAL] / max(_distance(stage.cells, c, camera), 1.0)
            if layer == WEAR and WEAR_M * samples < 1.0:
                continue
            level = layer if COARSE_M * samples > 1.0 else layer + LAYERS
            for s in range(stage.strip_start[level, c], stage.strip_start[level, c + 1]):
                for j in range(4):
                    world[j, 0] = strips[s, 2 * j]
                    world[j, 1] = strips[s, 2 * j + 1]
                k = add_ground(
                    world, 4, strips[s, STRIP_ALBEDO], strips[s, STRIP_ALBEDO + 1], strips[s, STRIP_ALBEDO + 2],
                    strips[s, STRIP_RETRO], strips[s, STRIP_LABEL], camera, points, out, k,
                )  # fmt: skip
    for i in range(found):
        c = cells[i]
        distance = _distance(stage.cells, c, camera)
        if distance > LINE_RANGE_M:
            continue
        faintest = FAINTEST * THINNEST * distance / camera[FOCAL]
        for m in range(stage.line_start[c], stage.line_start[c + 1]):
            if lines[m, LINE_HALF_M] * abs(lines[m, LINE_ALBEDO] - ROAD_ALBEDO) < faintest:
                break
            k = _add_line(lines, m, camera, world, points, out, k)
    for row in range(poses.shape[0]):
        if poses[row, LENGTH_M] > 0.0 and not _hidden(poses[row], camera):
            sine, cosine = sincos(poses[row, HEADING_RAD])
            k = add_vehicle_shadow(poses[row], row, cosine, sine, bodies, camera, scratch.hull, scratch.feet,
                                   points, out, k)  # fmt: skip
    for row in range(poses.shape[0]):
        if row != own and poses[row, LENGTH_M] > 0.0 and not _hidden(poses[row], camera):
            sine, cosine = sincos(poses[row, HEADING_RAD])
            k = add_vehicle(poses[row], row, cosine, sine, bodies, camera, world, face, points, out, k)
    for i in range(found):
        c = cells[i]
        thinnest = SMALLEST * _distance(stage.cells, c, camera) / camera[FOCAL]
        for f in range(stage.face_start[c], stage.face_start[c + 1]):
            if faces[f, SIZE] < thinnest:
                break
            k = add_face(faces, f, camera, world, points, out, k)
    return k


@bare
def _hidden(pose: np.ndarray, camera: np.ndarray) -> bool:
    """Whether a vehicle is behind the camera or lost in the air."""
    dx, dy = pose[X_M] - camera[EYE], pose[Y_M] - camera[EYE + 1]
    ahead = dx * camera[FORWARD] + dy * camera[FORWARD + 1]
    return ahead < -pose[LENGTH_M] or ahead > camera[RANGE_M]
