"""Polygons to samples: a depth buffer, and colour computed once for a run of samples.

Rows are drawn in bands, so that the buffers of a band stay in the processor's cache. The ground is level and the camera
is not rolled (roll and distortion are put on afterwards), so a row of the ground has one depth: it is drawn first, in
order, without a depth test, and what the air does to it is worked out once a row.

The loops index flat arrays with unsigned numbers: then the compiler needs no test for negative indices and uses vector
instructions.
"""

import math

import numpy as np

from policies.jit import bare
from service.world.camera.columns import (
    BOTTOM,
    CENTRE_X,
    CENTRE_Y,
    COLOUR,
    COUNT,
    DOWN,
    EYE,
    FOCAL,
    FOG,
    FORWARD,
    GROUND,
    HEADLIGHT,
    HEIGHT,
    HORIZON,
    KIND,
    LABEL,
    MIRROR,
    PLANE,
    RANGE_STEP_M,
    SHADOW,
    SHEEN,
    SOLID,
    TOP,
    WET,
    WIDTH,
    X,
    Y,
)  # fmt: skip

RUN = 32  # samples that share a colour
TONES = 8192  # steps of the table from radiance to signal
LIT_RUN = 8  # where headlights fall on the ground
WIDE = 800  # samples across a picture that is large
BEAM_STRENGTH = 15.0
FAINT = 2.0  # steps of the table that headlights have to add to count
BEAM_NEAR_PER_M = 0.075  # nearer than 1 / this a beam gets no brighter: it is aimed ahead
LEFT, ADDED, INVERSE_DEPTH, BEAM, ROW = 0, 1, 4, 5, 6  # columns of the table of rows
BYTE, EIGHT, SIXTEEN = np.uint32(0xFF), np.uint32(8), np.uint32(16)


def tone_table() -> np.ndarray:
    """Signal (TONES,) uint8 over radiance times gain in [0, 1): a soft shoulder, then gamma 2."""
    v = (np.arange(TONES) + 0.5) / TONES
    return np.minimum(255.0 * np.sqrt(1.6 * v / (v + 0.6)) + 0.5, 255.0).astype(np.uint8)


@bare
def beam_table(camera: np.ndarray, out: np.ndarray) -> None:
    """Fill `out` (w,) with how a low beam falls off to the sides, for every column of samples."""
    for x in range(out.shape[0]):
        across = (x + 0.5 - camera[CENTRE_X]) / camera[FOCAL]
        fall = 1.0 + 5.0 * across * across
        out[x] = 1.0 / (fall * fall)


@bare
def _beam_height(below: float) -> float:
    """How bright a low beam is at the tangent `below` the horizon: it is cut off a little below it."""
    if below > 0.012:
        return 1.0 - min((below - 0.012) * 1.8, 0.75)
    return 0.06 + 0.94 * max(1.0 + (below - 0.012) * 40.0, 0.0)


@bare
def _through(distance: float, step_m: float, through_air: np.ndarray) -> float:
    """What the air lets through over a distance."""
    at = min(distance / step_m, through_air.shape[0] - 1.001)
    low = np.uint64(at)
    share = at - np.float64(low)
    a, b = np.float64(through_air[low]), np.float64(through_air[low + np.uint64(1)])
    return a + share * (b - a)


@bare
def _tone(value: float, tones: np.ndarray) -> int:
    """Signal of a radiance in steps of the table."""
    return int(tones[np.uint64(min(max(value, 0.0), TONES - 1.0))])


@bare
def row_table(camera: np.ndarray, through_air: np.ndarray, out: np.ndarray) -> None:
    """Fill `out` (h, ROW): for every row the low beam's height; for rows that show ground also what the air leaves of
    its light, what is added, and 1/z."""
    for y in range(int(camera[HEIGHT])):
        below = (y + 0.5 - camera[HORIZON]) / camera[FOCAL]
        out[y, BEAM] = BEAM_STRENGTH * camera[HEADLIGHT] * _beam_height(below)
        if below <= 0.0:
            continue
        down = (y + 0.5 - camera[CENTRE_Y]) / camera[FOCAL]
        inverse_depth = max(-(camera[DOWN + 2] * down + camera[FORWARD + 2]) / camera[EYE + 2], 1e-6)
        distance = math.sqrt(1.0 + down * down) / inverse_depth
        through = _through(distance, camera[RANGE_STEP_M], through_air)
        grazing = 1.0 - min(below * 4.0, 1.0)
        grazing = grazing * grazing
        wet = camera[WET]
        mirror = wet * (0.10 + 0.45 * grazing) + (1.0 - wet) * 0.10 * grazing * grazing
        out[y, LEFT] = through * (1.0 - 0.45 * wet)
        for c in range(3):
            out[y, ADDED + c] = through * mirror * camera[SHEEN + c] + (1.0 - through) * camera[FOG + c]
        out[y, INVERSE_DEPTH] = inverse_depth


@bare
def _even(polygons: np.ndarray, k: int, camera: np.ndarray, through_air: np.ndarray) -> bool:
    """Whether the air leaves about the same of all parts of a polygon."""
    low, high = 1e30, 1e-4
    for i in range(int(polygons[k, COUNT])):
        at = polygons[k, PLANE] * polygons[k, X + i] + polygons[k, PLANE + 1] * polygons[k, Y + i]
        low, high = min(low, at + polygons[k, PLANE + 2]), max(high, at + polygons[k, PLANE + 2])
    step_m = camera[RANGE_STEP_M]
    nearest, farthest = 1.0 / high, 1.0 / max(low, 1e-4)
    return _through(nearest, step_m, through_air) - _through(farthest, step_m, through_air) < 0.02


@bare
def _shone_on(polygons: np.ndarray, k: int, rows: np.ndarray) -> bool:
    """Whether headlights make a difference to a solid polygon that can be seen."""
    high, brightest = 0.0, 0.0
    for i in range(int(polygons[k, COUNT])):
        at = polygons[k, PLANE] * polygons[k, X + i] + polygons[k, PLANE + 1] * polygons[k, Y + i]
        high = max(high, at + polygons[k, PLANE + 2])
    for y in range(int(polygons[k, TOP]), int(polygons[k, BOTTOM])):
        brightest = max(brightest, rows[y, BEAM])
    near = min(high, BEAM_NEAR_PER_M)
    mirror = max(polygons[k, MIRROR], polygons[k, MIRROR + 1], polygons[k, MIRROR + 2])
    return brightest * near * near * mirror > FAINT


@bare
def draw(polygons: np.ndarray, count: int, camera: np.ndarray, through_air: np.ndarray, tones: np.ndarray,
         rows: np.ndarray, beams: np.ndarray, first: int, last: int, colours: np.ndarray, depths: np.ndarray,
         labels: np.ndarray, left: np.ndarray, right: np.ndarray) -> None:  # fmt: skip
    """Draw polygons[:count] into rows [first, last) of the picture: the ground in order, then solids by depth.

    Row 0 of polygons is the open country, everything below the horizon.

    rows, beams: see `row_table`, `beam_table`. The buffers hold these rows alone: colours (n w,) uint32, as bytes R,
        G, B, 0, depths (n w,) float32, as 1/z, and labels (n w,) uint16, or (0,) where none are wanted
    left, right: (h,) scratch

    The sky is there already.
    """
    width, height = int(camera[WIDTH]), camera[HEIGHT]
    lit, step_m = camera[HEADLIGHT] > 0.0, camera[RANGE_STEP_M]
    centre_x, centre_y = camera[CENTRE_X], camera[CENTRE_Y]
    per_focal = 1.0 / camera[FOCAL]
    fog_r, fog_g, fog_b = camera[FOG], camera[FOG + 1], camera[FOG + 2]
    want_labels = labels.shape[0] > 0
    for k in range(count):
        top, bottom = max(int(polygons[k, TOP]), first), min(int(polygons[k, BOTTOM]), last)
        if bottom <= top:
            continue
        n = int(polygons[k, COUNT])
        for y in range(top, bottom):
            left[y] = 1e30
            right[y] = -1e30
        for i in range(n):
            j = i + 1 if i + 1 < n else 0
            # downwards, so that neighbours get the same edge
            if polygons[k, Y + i] < polygons[k, Y + j]:
                p, q = i, j
            else:
                p, q = j, i
            yp, yq = polygons[k, Y + p], polygons[k, Y + q]
            begin = max(math.ceil(max(yp, -1.0) - 0.5), top)
            end = min(math.ceil(min(yq, height + 1.0) - 0.5), bottom)
            if end <= begin:
                continue
            xp = polygons[k, X + p]
            slope = (polygons[k, X + q] - xp) / (yq - yp)
            for y in range(begin, end):
                x = xp + (y + 0.5 - yp) * slope
                left[y] = min(left[y], x)
                right[y] = max(right[y], x)
        kind = int(polygons[k, KIND])
        red, green, blue = polygons[k, COLOUR], polygons[k, COLOUR + 1], polygons[k, COLOUR + 2]
        mirror_r, mirror_g, mirror_b = polygons[k, MIRROR], polygons[k, MIRROR + 1], polygons[k, MIRROR + 2]
        label = np.uint16(polygons[k, LABEL])
        dx, dy, at_0 = polygons[k, PLANE], polygons[k, PLANE + 1], polygons[k, PLANE + 2]
        shone_on = lit and (kind == GROUND or (kind == SOLID and _shone_on(polygons, k, rows)))
        even = not shone_on and kind != SHADOW and (kind == GROUND or _even(polygons, k, camera, through_air))
        run = width if even else RUN
        if shone_on and kind == GROUND:
            run = LIT_RUN if width < WIDE else 3 * LIT_RUN
            if k == 0:  # most of the open country is hidden
                run = RUN
        colour = np.uint32(0)
        fresh = True  # no colour yet
        for y in range(top, bottom):
            begin = math.ceil(min(max(left[y], 0.0), width + 0.5) - 0.5)
            end = math.ceil(min(max(right[y], 0.0), width + 0.5) - 0.5)
            if end <= begin:
                continue
            line = (y - first) * width
            if kind == SHADOW:
                through = rows[y, LEFT]
                r = np.uint32(256.0 * (1.0 - through * (1.0 - red)))
                g = np.uint32(256.0 * (1.0 - through * (1.0 - green)))
                b = np.uint32(256.0 * (1.0 - through * (1.0 - blue)))
                for i in range(np.uint64(line + begin), np.uint64(line + end)):
                    old = colours[i]
                    low = ((old & BYTE) * r) >> EIGHT
                    middle = (((old >> EIGHT) & BYTE) * g) >> EIGHT
                    high = (((old >> SIXTEEN) & BYTE) * b) >> EIGHT
                    colours[i] = low | (middle << EIGHT) | (high << SIXTEEN)
                continue
            a = begin
            while a < end:  # a range with a step would divide
                stop = min(a + run, end)
                i0, i1 = np.uint64(line + a), np.uint64(line + stop)
                x = 0.5 * (a + stop)
                inverse_depth = rows[y, INVERSE_DEPTH] if kind == GROUND else dx * x + dy * (y + 0.5) + at_0
                if kind == GROUND or not even or fresh:
                    if kind == GROUND:
                        through = rows[y, LEFT]
                        add_r, add_g, add_b = rows[y, ADDED], rows[y, ADDED + 1], rows[y, ADDED + 2]
                    else:
                        across, down = (x - centre_x) * per_focal, (y + 0.5 - centre_y) * per_focal
                        far = (1.0 + 0.5 * (across * across + down * down)) / max(inverse_depth, 1e-4)
                        through = _through(far, step_m, through_air)
                        fogged = 1.0 - through
                        add_r, add_g, add_b = fogged * fog_r, fogged * fog_g, fogged * fog_b
                    lit_r, lit_g, lit_b = red, green, blue
                    if shone_on:
                        near = min(inverse_depth, BEAM_NEAR_PER_M)
                        beam = rows[y, BEAM] * beams[np.uint64(x)] * near * near
                        lit_r += beam * mirror_r
                        lit_g += beam * mirror_g
                        lit_b += beam * mirror_b
                    packed = _tone(lit_r * through + add_r, tones) | (
                        _tone(lit_g * through + add_g, tones) << 8
                    )
                    colour = np.uint32(packed | (_tone(lit_b * through + add_b, tones) << 16))
                    fresh = False
                if kind == GROUND:
                    for i in range(i0, i1):
                        colours[i] = colour
                    if k == 0:
                        for i in range(i0, i1):
                            depths[i] = np.float32(inverse_depth)
                    if want_labels:
                        for i in range(i0, i1):
                            labels[i] = label
                    a = stop
                    continue
                base, step = np.float32(dx * (a + 0.5) + dy * (y + 0.5) + at_0), np.float32(dx)
                if want_labels:
                    for i in range(i0, i1):
                        if base + step * np.float32(np.int32(i - i0)) > depths[i]:
                            labels[i] = label
                for i in range(i0, i1):
                    here = base + step * np.float32(np.int32(i - i0))
                    nearer = here > depths[i]
                    depths[i] = here if nearer else depths[i]
                    colours[i] = colour if nearer else colours[i]
                a = stop
