"""From faces in the world to polygons in the picture: culling, near-plane clipping, projection, shading.

World: x, y of the network, z up from the road, metres. Camera: x right, y down, z along the optical axis. Picture: X
right, Y down, in samples; the centre of sample i is at i + 0.5. The inverse depth 1/z of a plane is linear in X and Y,
so a polygon carries it as three numbers.
"""

import math

import numpy as np

from policies.jit import bare
from service.world.camera.columns import (
    ALBEDO,
    BOTTOM,
    CENTRE_X,
    CENTRE_Y,
    COLOUR,
    COUNT,
    DOWN,
    EYE,
    FACE_LABEL,
    FOCAL,
    FORWARD,
    GLOW,
    GROUND,
    GROUND_LIGHT,
    HEIGHT,
    KIND,
    LABEL,
    LAMPS,
    MIRROR,
    NORMAL,
    PLANE,
    RANGE_M,
    RETRO,
    RIGHT,
    SHADOW,
    SIZE,
    SKY_SIDE,
    SKY_UP,
    SOLID,
    SUN,
    TO_SUN,
    TOP,
    WIDTH,
    X,
    Y,
)  # fmt: skip

NEAR_M = 0.1
SMALLEST = 1.2  # faces that look thinner than this many samples are left out


@bare
def add_polygon(world: np.ndarray, n: int, nx: float, ny: float, nz: float, camera: np.ndarray, points: np.ndarray,
                out: np.ndarray, k: int) -> bool:  # fmt: skip
    """Clip and project the plane convex polygon world (n, 3) into row k of `out`; False when nothing of it is seen.

    (nx, ny, nz) is its normal, `points` (CORNERS, 3) scratch. Colour, mirror, label and kind are the caller's.
    """
    if k >= out.shape[0]:
        return False
    near = 0
    for i in range(n):
        dx = world[i, 0] - camera[EYE]
        dy = world[i, 1] - camera[EYE + 1]
        dz = world[i, 2] - camera[EYE + 2]
        points[i, 0] = dx * camera[RIGHT] + dy * camera[RIGHT + 1]
        points[i, 1] = dx * camera[DOWN] + dy * camera[DOWN + 1] + dz * camera[DOWN + 2]
        points[i, 2] = dx * camera[FORWARD] + dy * camera[FORWARD + 1] + dz * camera[FORWARD + 2]
        if points[i, 2] < NEAR_M:
            near += 1
    if near == n:
        return False
    focal, centre_x, centre_y = camera[FOCAL], camera[CENTRE_X], camera[CENTRE_Y]
    m = 0
    left, top, right, bottom = 1e30, 1e30, -1e30, -1e30
    for i in range(n):
        inside = points[i, 2] >= NEAR_M
        if inside:
            scale = focal / points[i, 2]
            x = centre_x + points[i, 0] * scale
            y = centre_y + points[i, 1] * scale
            out[k, X + m], out[k, Y + m] = x, y
            left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
            m += 1
        if near == 0:
            continue
        j = i + 1 if i + 1 < n else 0
        if inside != (points[j, 2] >= NEAR_M):
            # always from the nearer to the farther end, so that neighbours get the same point
            p, q = (i, j) if points[i, 2] < points[j, 2] else (j, i)
            share = (NEAR_M - points[p, 2]) / (points[q, 2] - points[p, 2])
            scale = focal / NEAR_M
            x = centre_x + (points[p, 0] + share * (points[q, 0] - points[p, 0])) * scale
            y = centre_y + (points[p, 1] + share * (points[q, 1] - points[p, 1])) * scale
            out[k, X + m], out[k, Y + m] = x, y
            left, right, top, bottom = min(left, x), max(right, x), min(top, y), max(bottom, y)
            m += 1
    # rows and columns whose centres it can cover
    first, last = math.ceil(max(top, 0.0) - 0.5), math.ceil(min(bottom, camera[HEIGHT] + 0.5) - 0.5)
    if first >= last or right <= 0.5 or left >= camera[WIDTH] - 0.5:
        return False
    if math.ceil(left - 0.5) >= math.ceil(right - 0.5):
        return False
    # the plane in camera axes: a x + b y + c z = offset
    a = nx * camera[RIGHT] + ny * camera[RIGHT + 1]
    b = nx * camera[DOWN] + ny * camera[DOWN + 1] + nz * camera[DOWN + 2]
    c = nx * camera[FORWARD] + ny * camera[FORWARD + 1] + nz * camera[FORWARD + 2]
    offset = a * points[0, 0] + b * points[0, 1] + c * points[0, 2]
    if abs(offset) < 1e-9:
        return False
    scale = 1.0 / (offset * focal)
    out[k, PLANE] = a * scale
    out[k, PLANE + 1] = b * scale
    out[k, PLANE + 2] = c / offset - (a * centre_x + b * centre_y) * scale
    out[k, COUNT] = m
    out[k, TOP] = first
    out[k, BOTTOM] = last
    return True


@bare
def add_face(table: np.ndarray, f: int, camera: np.ndarray, world: np.ndarray, points: np.ndarray, out: np.ndarray,
             k: int) -> int:  # fmt: skip
    """Add the solid's face in row f of `table` (faces, FACE) as row k of `out`; returns the new count.

    world (4, 3) and points (CORNERS, 3) are scratch.
    """
    nx, ny, nz = table[f, NORMAL], table[f, NORMAL + 1], table[f, NORMAL + 2]
    dx = table[f, 0] - camera[EYE]
    dy = table[f, 1] - camera[EYE + 1]
    dz = table[f, 2] - camera[EYE + 2]
    if dx * nx + dy * ny + dz * nz >= 0.0:
        return k
    far = dx * dx + dy * dy + dz * dz
    look = table[f, SIZE] * camera[FOCAL]
    if far > camera[RANGE_M] * camera[RANGE_M] or look * look < SMALLEST * SMALLEST * far:
        return k
    for i in range(4):
        for c in range(3):
            world[i, c] = table[f, 3 * i + c]
    if not add_polygon(world, 4, nx, ny, nz, camera, points, out, k):
        return k
    facing = max(nx * camera[TO_SUN] + ny * camera[TO_SUN + 1] + nz * camera[TO_SUN + 2], 0.0)
    retro = table[f, RETRO]
    for c in range(3):
        side = camera[SKY_SIDE + c]
        sky = side + nz * (camera[SKY_UP + c] - side) if nz >= 0.0 else side * (1.0 + 0.7 * nz)
        albedo = table[f, ALBEDO + c]
        out[k, COLOUR + c] = albedo * (sky + facing * camera[SUN + c]) + camera[LAMPS] * table[f, GLOW + c]
        out[k, MIRROR + c] = albedo * retro
    out[k, LABEL] = table[f, FACE_LABEL]
    out[k, KIND] = SOLID
    return k + 1


@bare
def add_ground(world: np.ndarray, n: int, red: float, green: float, blue: float, retro: float, label: float,
               camera: np.ndarray, points: np.ndarray, out: np.ndarray, k: int) -> int:  # fmt: skip
    """Add a convex polygon world (n, 3) that lies on the ground as row k of `out`; returns the new count."""
    if not add_polygon(world, n, 0.0, 0.0, 1.0, camera, points, out, k):
        return k
    out[k, COLOUR] = red * camera[GROUND_LIGHT]
    out[k, COLOUR + 1] = green * camera[GROUND_LIGHT + 1]
    out[k, COLOUR + 2] = blue * camera[GROUND_LIGHT + 2]
    out[k, MIRROR], out[k, MIRROR + 1], out[k, MIRROR + 2] = red * retro, green * retro, blue * retro
    out[k, LABEL] = label
    out[k, KIND] = GROUND
    return k + 1


@bare
def add_shadow(
    world: np.ndarray, n: int, left: int, camera: np.ndarray, points: np.ndarray, out: np.ndarray, k: int
) -> int:
    """Add a shadow world (n, 3) on the ground; `left` is the camera's column that says what is left of the signal."""
    if not add_polygon(world, n, 0.0, 0.0, 1.0, camera, points, out, k):
        return k
    for c in range(3):
        out[k, COLOUR + c] = camera[left + c]
    out[k, KIND] = SHADOW
    return k + 1
