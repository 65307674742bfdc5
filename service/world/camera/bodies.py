"""Bodies of cars, vans and trucks: x ahead and y left in shares of length and width, z in shares of height."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from policies.jit import bare
from service.world.camera.columns import (
    ALBEDO,
    CONTACT,
    EYE,
    FACE_LABEL,
    FOCAL,
    GLOW,
    LAMPS,
    LIGHTS_ON,
    NORMAL,
    RETRO,
    SHADE,
    SIGNAL,
    SIZE,
    SUN,
    TO_SUN,
)  # fmt: skip
from service.world.camera.faces import SMALLEST, add_face, add_shadow
from service.world.camera.labels import VEHICLE_ID, Label
from service.world.camera.poses import ACCELERATION_MPS2, LENGTH_M, WIDTH_M, X_M, Y_M
from service.world.camera.quads import Builder, Material

PAINT, GLASS, BLACK, HEADLAMP, TAIL_LAMP, PLATE, CARGO, HUB = range(8)
SEDAN, SUV, VAN, TRUCK = range(4)
HEIGHT_M = (1.45, 1.75, 2.3, 3.9)
USUAL_M = np.array([(4.5, 1.8, 1.45), (4.6, 1.9, 1.75), (6.0, 2.1, 2.3), (14.0, 2.5, 3.9)])
VAN_LENGTH_M = 5.6  # from here on vehicles are vans
TRUCK_LENGTH_M = 7.5
BRAKE_LIGHT_MPS2 = -0.7
LONGEST_SHADOW_M = 25.0

PALETTE = np.array([
    [0.62, 0.62, 0.60], [0.030, 0.032, 0.036], [0.30, 0.31, 0.33], [0.36, 0.022, 0.020], [0.035, 0.075, 0.24],
    [0.13, 0.14, 0.15], [0.72, 0.70, 0.64], [0.06, 0.13, 0.08], [0.42, 0.34, 0.22], [0.10, 0.20, 0.30],
])  # fmt: skip
PARTS = np.array([
    [0.0, 0.0, 0.0], [0.030, 0.036, 0.044], [0.018, 0.018, 0.019], [0.75, 0.77, 0.80], [0.30, 0.012, 0.012],
    [0.75, 0.75, 0.70], [0.70, 0.70, 0.68], [0.28, 0.28, 0.30],
])  # fmt: skip
LAMP = np.array([0.30, 0.27, 0.22])  # radiance of a headlight seen from ahead
TAIL = np.array([0.10, 0.004, 0.003])
BRAKE = np.array([0.75, 0.035, 0.020])


class Bodies(NamedTuple):
    """All bodies' faces in one array; body b has faces [start[b], start[b + 1])."""

    corners: np.ndarray  # (k, 4, 3)
    normal: np.ndarray  # (k, 3) of the unscaled body
    part: np.ndarray  # (k,) int64
    size_m: np.ndarray  # (k,) thickness of the face of a usual vehicle
    start: np.ndarray  # (bodies + 1,)
    height_m: np.ndarray  # (bodies,)


def _part(code: int) -> Material:
    return Material((float(code), 0.0, 0.0), Label.SKY)


def _hull(b: Builder, profile: list[tuple[float, float, float, int]], low: float) -> None:
    """A body from its side profile, front to rear: (x, z, half width, part of the face that ends here)."""
    middle = (0.0, 0.0, 0.5 * low + 0.25)
    for (x0, z0, w0, _), (x1, z1, w1, part) in itertools.pairwise(profile):
        b.quad([(x0, w0, z0), (x0, -w0, z0), (x1, -w1, z1), (x1, w1, z1)], _part(part), middle)
        if x0 != x1:
            for side in (1.0, -1.0):
                quad = [(x0, side * w0, low), (x1, side * w1, low), (x1, side * w1, z1), (x0, side * w0, z0)]
                b.quad(quad, _part(PAINT), (0.5 * (x0 + x1), 0.0, 0.5 * (z0 + z1)))


def _cabin(b: Builder, base: tuple[float, float, float, float], roof: tuple[float, float], sides: tuple[float, float],
           top: float = 0.995) -> None:  # fmt: skip
    """A greenhouse: base (front x, rear x, front z, rear z), roof (front x, rear x), half widths below and above."""
    fx, rx, fz, rz = base
    low, high = sides
    middle = (0.5 * (fx + rx), 0.0, 0.75)
    a = {s: (fx, s * low, fz) for s in (1, -1)}
    c = {s: (rx, s * low, rz) for s in (1, -1)}
    e = {s: (roof[0], s * high, top) for s in (1, -1)}
    g = {s: (roof[1], s * high, top) for s in (1, -1)}
    b.quad([a[1], a[-1], e[-1], e[1]], _part(GLASS), middle)
    b.quad([c[1], c[-1], g[-1], g[1]], _part(GLASS), middle)
    b.quad([e[1], e[-1], g[-1], g[1]], _part(PAINT), middle)
    for s in (1, -1):
        b.quad([a[s], c[s], g[s], e[s]], _part(GLASS), middle)
        # the pillar between the doors and a strip of paint under the roof
        px = 0.5 * (roof[0] + roof[1]) + 0.01
        y0, y1 = s * (low + 0.004), s * (high + 0.004)
        z0 = 0.5 * (fz + rz)
        b.quad([(px - 0.012, y0, z0), (px + 0.012, y0, z0), (px + 0.012, y1, top), (px - 0.012, y1, top)],
               _part(PAINT), middle)  # fmt: skip


def _wheels(b: Builder, at: list[float], radius_x: float, radius_z: float, half: float) -> None:
    angle = np.arange(8) * (np.pi / 4) + np.pi / 8
    for x in at:
        for s in (1.0, -1.0):
            for scale, part, out in ((1.0, BLACK, 0.004), (0.58, HUB, 0.006)):
                ring = [
                    (x + scale * radius_x * np.cos(t), s * (half + out), radius_z * (1.0 + scale * np.sin(t)))
                    for t in angle
                ]
                for i, j, k, m in ((0, 1, 2, 3), (0, 3, 4, 7), (4, 5, 6, 7)):
                    b.quad([ring[i], ring[j], ring[k], ring[m]], _part(part), (x, 0.0, radius_z))


def _lamps(b: Builder, head: tuple[float, float], tail: tuple[float, float], front: float, rear: float,
           inner: float = 0.26, outer: float = 0.46, plate: bool = True) -> None:  # fmt: skip
    """Lamps as faces just outside the ends; head and tail: their lower and upper z."""
    for x, (low, high), part in ((front + 0.002, head, HEADLAMP), (rear - 0.002, tail, TAIL_LAMP)):
        for s in (1.0, -1.0):
            b.quad([(x, s * inner, low), (x, s * outer, low), (x, s * outer, high), (x, s * inner, high)],
                   _part(part), (0.0, 0.0, low))  # fmt: skip
    if plate:
        for x in (front + 0.002, rear - 0.002):
            z = tail[0] - 0.14
            b.quad(
                [(x, -0.1, z), (x, 0.1, z), (x, 0.1, z + 0.08), (x, -0.1, z + 0.08)],
                _part(PLATE),
                (0.0, 0.0, z),
            )
        z = head[0] - 0.09
        b.quad([(front + 0.003, -0.3, z), (front + 0.003, 0.3, z), (front + 0.003, 0.3, z + 0.1),
                (front + 0.003, -0.3, z + 0.1)], _part(BLACK), (0.0, 0.0, z))  # fmt: skip


def _skirt(b: Builder, front: float, rear: float, half: float, low: float, high: float) -> None:
    for x in (front, rear):
        b.quad(
            [(x, half, low), (x, -half, low), (x, -half, high), (x, half, high)],
            _part(BLACK),
            (0.0, 0.0, low),
        )


def _sedan() -> Builder:
    b = Builder()
    _hull(b, [(0.488, 0.17, 0.46, PAINT), (0.495, 0.34, 0.47, PAINT), (0.47, 0.50, 0.475, PAINT),
              (0.22, 0.60, 0.492, PAINT), (-0.34, 0.64, 0.492, PAINT), (-0.475, 0.62, 0.475, PAINT),
              (-0.495, 0.44, 0.47, PAINT), (-0.488, 0.17, 0.46, PAINT)], 0.17)  # fmt: skip
    _cabin(b, (0.24, -0.39, 0.595, 0.635), (0.07, -0.22), (0.475, 0.385))
    _skirt(b, 0.46, -0.46, 0.44, 0.06, 0.18)
    _wheels(b, [0.305, -0.29], 0.075, 0.225, 0.49)
    _lamps(b, (0.36, 0.46), (0.46, 0.58), 0.493, -0.493)
    return b


def _suv() -> Builder:
    b = Builder()
    _hull(b, [(0.49, 0.18, 0.47, PAINT), (0.495, 0.40, 0.475, PAINT), (0.47, 0.54, 0.48, PAINT),
              (0.24, 0.60, 0.492, PAINT), (-0.47, 0.62, 0.492, PAINT), (-0.495, 0.55, 0.48, PAINT),
              (-0.49, 0.18, 0.47, PAINT)], 0.18)  # fmt: skip
    _cabin(b, (0.25, -0.47, 0.59, 0.61), (0.10, -0.41), (0.478, 0.41))
    _skirt(b, 0.46, -0.46, 0.44, 0.06, 0.19)
    _wheels(b, [0.305, -0.30], 0.08, 0.205, 0.49)
    _lamps(b, (0.38, 0.48), (0.42, 0.60), 0.493, -0.493, inner=0.33)
    return b


def _van() -> Builder:
    b = Builder()
    _hull(b, [(0.49, 0.14, 0.46, PAINT), (0.495, 0.36, 0.47, PAINT), (0.38, 0.50, 0.485, PAINT),
              (0.27, 0.93, 0.47, GLASS), (0.20, 0.99, 0.46, PAINT), (-0.47, 0.99, 0.46, PAINT),
              (-0.495, 0.90, 0.48, PAINT), (-0.495, 0.14, 0.48, PAINT)], 0.14)  # fmt: skip
    for s in (1.0, -1.0):
        y = s * 0.489
        b.quad(
            [(0.36, y, 0.54), (0.17, y, 0.54), (0.17, y, 0.86), (0.285, y, 0.86)],
            _part(GLASS),
            (0.2, 0.0, 0.6),
        )
    b.quad([(-0.497, 0.40, 0.58), (-0.497, -0.40, 0.58), (-0.497, -0.40, 0.86), (-0.497, 0.40, 0.86)], _part(GLASS),
           (0.0, 0.0, 0.6))  # fmt: skip
    _skirt(b, 0.47, -0.47, 0.44, 0.05, 0.15)
    _wheels(b, [0.33, -0.30], 0.062, 0.15, 0.488)
    _lamps(b, (0.28, 0.36), (0.34, 0.52), 0.493, -0.497, inner=0.38, outer=0.47)
    return b


def _truck() -> Builder:
    b = Builder()
    cab = 0.5 - 0.19  # the cab takes the front fifth
    _hull(b, [(0.495, 0.10, 0.48, BLACK), (0.498, 0.28, 0.48, PAINT), (0.490, 0.52, 0.48, GLASS),
              (0.470, 0.74, 0.47, PAINT), (0.45, 0.78, 0.46, PAINT), (cab, 0.90, 0.46, PAINT)], 0.10)  # fmt: skip
    b.quad(
        [(cab, 0.46, 0.1), (cab, -0.46, 0.1), (cab, -0.46, 0.9), (cab, 0.46, 0.9)],
        _part(PAINT),
        (0.4, 0, 0.5),
    )
    for s in (1.0, -1.0):
        y = s * 0.483
        b.quad(
            [(0.475, y, 0.54), (0.385, y, 0.54), (0.385, y, 0.72), (0.465, y, 0.72)],
            _part(GLASS),
            (0.4, 0, 0.6),
        )
    box = np.array([(cab - 0.015, 0.5), (cab - 0.015, -0.5), (-0.497, -0.5), (-0.497, 0.5)])
    b.box(box, 0.30, 0.997, _part(CARGO), bottom=True)
    b.box(box * (1.0, 0.8), 0.16, 0.30, _part(BLACK))
    for x in (-0.499,):
        b.quad(
            [(x, 0.42, 0.33), (x, -0.42, 0.33), (x, -0.42, 0.345), (x, 0.42, 0.345)],
            _part(TAIL_LAMP),
            (0, 0, 0.3),
        )
        b.quad(
            [(x, 0.006, 0.34), (x, -0.006, 0.34), (x, -0.006, 0.97), (x, 0.006, 0.97)],
            _part(BLACK),
            (0, 0, 0.5),
        )
    _wheels(b, [0.42, 0.26, -0.30, -0.38], 0.031, 0.125, 0.49)
    _lamps(b, (0.17, 0.22), (0.22, 0.28), 0.499, -0.498, inner=0.34, outer=0.47, plate=False)
    return b


def bodies() -> Bodies:
    """The bodies SEDAN, SUV, VAN, TRUCK."""
    built = [maker() for maker in (_sedan, _suv, _van, _truck)]
    made = [b.faces() for b in built]
    sizes = []
    for faces, scale in zip(made, USUAL_M, strict=True):
        scaled = Builder([c * scale for c in faces.corners], [_part(0)] * len(faces))
        sizes.append(scaled.faces().size)
    return Bodies(
        np.concatenate([f.corners for f in made]),
        np.concatenate([f.normal for f in made]),
        np.concatenate([f.albedo[:, 0] for f in made]).astype(np.int64),
        np.concatenate(sizes),
        np.cumsum([0] + [len(f) for f in made]),
        np.array(HEIGHT_M),
    )


@bare
def body_of(length_m: float, row: int) -> int:
    """Which body a vehicle has: by its length, and by its row where several fit."""
    if length_m >= TRUCK_LENGTH_M:
        return TRUCK
    if length_m >= VAN_LENGTH_M:
        return VAN
    return SUV if (row * 7 + 2) % 5 < 2 else SEDAN


@bare
def add_vehicle(pose: np.ndarray, row: int, cosine: float, sine: float, table: Bodies, camera: np.ndarray,
                world: np.ndarray, face: np.ndarray, points: np.ndarray, out: np.ndarray, k: int) -> int:  # fmt: skip
    """Add the vehicle in `row` at `pose` to `out` from row k on; returns the new count.

    cosine and sine are those of its heading; world (4, 3), face (1, FACE) and points (CORNERS, 3) are scratch.
    """
    body = body_of(pose[LENGTH_M], row)
    length, width, height = pose[LENGTH_M], pose[WIDTH_M], table.height_m[body]
    lights_on = camera[LIGHTS_ON] > 0.0
    braking = pose[ACCELERATION_MPS2] < BRAKE_LIGHT_MPS2
    paint = (row * 5 + row // 7) % PALETTE.shape[0]
    # lamps shine by day too, as bright as at night: add_face multiplies by LAMPS
    lamps = camera[SIGNAL] / max(camera[LAMPS], 1e-6)
    face[0, FACE_LABEL] = VEHICLE_ID + row
    # the camera in the body's own coordinates, where a face looks away just as it does in the world
    dx, dy = camera[EYE] - pose[X_M], camera[EYE + 1] - pose[Y_M]
    eye_x, eye_y = (dx * cosine + dy * sine) / length, (dy * cosine - dx * sine) / width
    eye_z = camera[EYE + 2] / height
    far = dx * dx + dy * dy
    for f in range(table.start[body], table.start[body + 1]):
        away = (
            (table.corners[f, 0, 0] - eye_x) * table.normal[f, 0]
            + (table.corners[f, 0, 1] - eye_y) * table.normal[f, 1]
            + (table.corners[f, 0, 2] - eye_z) * table.normal[f, 2]
        )
        look = table.size_m[f] * camera[FOCAL]
        if away >= 0.0 or look * look < 0.5 * SMALLEST * SMALLEST * far:
            continue
        # normals scale with the inverse of the lengths
        nx, ny, nz = (
            table.normal[f, 0] / length,
            table.normal[f, 1] / width,
            table.normal[f, 2] / height,
        )
        norm = 1.0 / math.sqrt(nx * nx + ny * ny + nz * nz)
        face[0, NORMAL] = (nx * cosine - ny * sine) * norm
        face[0, NORMAL + 1] = (nx * sine + ny * cosine) * norm
        face[0, NORMAL + 2] = nz * norm
        for i in range(4):
            x, y = table.corners[f, i, 0] * length, table.corners[f, i, 1] * width
            face[0, 3 * i] = pose[X_M] + x * cosine - y * sine
            face[0, 3 * i + 1] = pose[Y_M] + x * sine + y * cosine
            face[0, 3 * i + 2] = table.corners[f, i, 2] * height
        part = table.part[f]
        face[0, SIZE] = table.size_m[f]
        face[0, RETRO] = 8.0 if part in (PLATE, TAIL_LAMP) else 1.0
        for c in range(3):
            face[0, ALBEDO + c] = PALETTE[paint, c] if part == PAINT else PARTS[part, c]
            glow = 0.0
            if part == HEADLAMP and lights_on:
                glow = LAMP[c]
            elif part == TAIL_LAMP and braking:
                glow = BRAKE[c]
            elif part == TAIL_LAMP and lights_on:
                glow = TAIL[c]
            face[0, GLOW + c] = glow * lamps
        k = add_face(face, 0, camera, world, points, out, k)
    return k


@bare
def add_vehicle_shadow(pose: np.ndarray, row: int, cosine: float, sine: float, table: Bodies, camera: np.ndarray,
                       world: np.ndarray, feet: np.ndarray, points: np.ndarray, out: np.ndarray, k: int
                       ) -> int:  # fmt: skip
    """Darken the road under a vehicle, and where it keeps the sun off; returns the new count of `out`.

    world (9, 3), whose heights are 0, feet (8, 2) and points (CORNERS, 3) are scratch.
    """
    length, width, height = pose[LENGTH_M], pose[WIDTH_M], table.height_m[body_of(pose[LENGTH_M], row)]
    for grown in (0.0, 0.12):
        for i in range(4):
            x = (0.5 * length + grown) * (1.0 if i == 0 or i == 3 else -1.0)
            y = (0.5 * width + grown) * (1.0 if i < 2 else -1.0)
            world[i, 0] = pose[X_M] + x * cosine - y * sine
            world[i, 1] = pose[Y_M] + x * sine + y * cosine
        k = add_shadow(world, 4, CONTACT, camera, points, out, k)
    up = camera[TO_SUN + 2]
    if up < 0.05 or camera[SUN + 1] <= 0.0:
        return k
    # the hull of the box's footprint and of its top, thrown along the sun's rays
    throw = min(0.85 * height / up, LONGEST_SHADOW_M)
    for i in range(4):
        x = 0.48 * length * (1.0 if i == 0 or i == 3 else -1.0)
        y = 0.48 * width * (1.0 if i < 2 else -1.0)
        feet[i, 0] = pose[X_M] + x * cosine - y * sine
        feet[i, 1] = pose[Y_M] + x * sine + y * cosine
        feet[i + 4, 0] = feet[i, 0] - throw * camera[TO_SUN]
        feet[i + 4, 1] = feet[i, 1] - throw * camera[TO_SUN + 1]
    first = 0
    for i in range(1, 8):
        if feet[i, 0] < feet[first, 0]:
            first = i
    n, here = 0, first
    while n < 8:
        world[n, 0], world[n, 1] = feet[here, 0], feet[here, 1]
        n += 1
        onward = (here + 1) & 7
        for j in range(8):
            turn = (feet[onward, 0] - feet[here, 0]) * (feet[j, 1] - feet[here, 1]) - (
                feet[onward, 1] - feet[here, 1]
            ) * (feet[j, 0] - feet[here, 0])
            if turn < 0.0:
                onward = j
        here = onward
        if here == first:
            break
    return add_shadow(world, n, SHADE, camera, points, out, k)
