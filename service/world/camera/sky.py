"""The sky: brighter towards the horizon and round the sun, with clouds; computed at knots, linear between them."""

import math

import numpy as np

from policies.jit import bare
from service.world.camera.columns import (
    CENTRE_X,
    CENTRE_Y,
    CLOUD,
    COVER,
    DOWN,
    FOCAL,
    FOG,
    FORWARD,
    HALO,
    HEIGHT,
    HORIZON,
    RIGHT,
    SKY_HORIZON,
    TO_SUN,
    ZENITH,
)  # fmt: skip
from service.world.camera.raster import TONES

CLOUD_CELLS = 256
AIR_M = 400.0  # as if the sky were this far away: fog hides it


def cloud_texture() -> np.ndarray:
    """Periodic smooth noise of several octaves in [0, 1], (CLOUD_CELLS, CLOUD_CELLS); the same on every machine."""
    bits = np.random.Philox(key=20).random_raw(CLOUD_CELLS * CLOUD_CELLS)
    white = (bits >> np.uint64(40)).astype(np.float64) / 2.0**24
    total = np.zeros((CLOUD_CELLS, CLOUD_CELLS))
    at = np.arange(CLOUD_CELLS)
    for octave, cells in enumerate((8, 16, 32, 64, 128)):
        coarse = white[octave * 5 :][: cells * cells].reshape(cells, cells)
        u = at * cells / CLOUD_CELLS
        i, f = u.astype(np.int64), u - u.astype(np.int64)
        f = f * f * (3.0 - 2.0 * f)
        j = (i + 1) % cells
        rows = coarse[i] + f[:, None] * (coarse[j] - coarse[i])
        total += (rows[:, i] + f * (rows[:, j] - rows[:, i])) * 0.55**octave
    low, high = total.min(), total.max()
    return (total - low) / (high - low)


@bare
def _radiance(x: float, y: float, z: float, camera: np.ndarray, clouds: np.ndarray, out: np.ndarray) -> None:
    """Radiance (3,) of the sky in the unit direction (x, y, z)."""
    height = max(z, 0.0)
    fall = 1.0 - height
    fall = fall * fall
    fall = fall * fall
    towards = x * camera[TO_SUN] + y * camera[TO_SUN + 1] + z * camera[TO_SUN + 2]
    apart = max(1.0 - towards, 0.0)  # about half the squared angle
    halo = 0.30 / (1.0 + 40.0 * apart) + 0.9 / (1.0 + 900.0 * apart)
    # clouds lie on a plane; towards the horizon they merge
    scale = 38.0 / (height + 0.10)
    u, v = x * scale + 17.0, y * scale + 91.0
    i, j = math.floor(u), math.floor(v)
    f, g = u - i, v - j
    i0, j0 = np.int64(i) & (CLOUD_CELLS - 1), np.int64(j) & (CLOUD_CELLS - 1)
    i1, j1 = (i0 + 1) & (CLOUD_CELLS - 1), (j0 + 1) & (CLOUD_CELLS - 1)
    a = clouds[i0, j0] + g * (clouds[i0, j1] - clouds[i0, j0])
    b = clouds[i1, j0] + g * (clouds[i1, j1] - clouds[i1, j0])
    density = a + f * (b - a)
    cover = min(max((density - 0.50 + 0.75 * camera[COVER]) * 3.2, 0.0), 1.0) * min(height * 9.0, 1.0)
    cover *= 0.85 - 0.25 * camera[COVER]
    for k in range(3):
        glow = halo * camera[HALO + k]
        clear = camera[ZENITH + k] + fall * (camera[SKY_HORIZON + k] - camera[ZENITH + k]) + glow
        lit = camera[CLOUD + k] * (0.75 + 0.5 * density) + 0.5 * glow
        out[k] = clear + cover * (lit - clear)


@bare
def _knots(y: float, step: int, camera: np.ndarray, through: float, tones: np.ndarray, clouds: np.ndarray,
           radiance: np.ndarray, out: np.ndarray) -> None:  # fmt: skip
    """Fill `out` (columns, 3) with signals along the picture's row y, `step` samples apart."""
    v = (y - camera[CENTRE_Y]) / camera[FOCAL]
    for i in range(out.shape[0]):
        u = (i * step - camera[CENTRE_X]) / camera[FOCAL]
        norm = 1.0 / math.sqrt(1.0 + u * u + v * v)
        _radiance(
            (u * camera[RIGHT] + v * camera[DOWN] + camera[FORWARD]) * norm,
            (u * camera[RIGHT + 1] + v * camera[DOWN + 1] + camera[FORWARD + 1]) * norm,
            (v * camera[DOWN + 2] + camera[FORWARD + 2]) * norm,
            camera, clouds, radiance,
        )  # fmt: skip
        for c in range(3):
            value = camera[FOG + c] + through * (radiance[c] - camera[FOG + c])
            tone = tones[np.uint64(min(max(value, 0.0), TONES - 1.0))]
            out[i, c] = np.float32(tone)


@bare
def sky_knots(camera: np.ndarray, through: float, tones: np.ndarray, clouds: np.ndarray, step: int,
              radiance: np.ndarray, out: np.ndarray) -> int:  # fmt: skip
    """Fill `out` (bands + 1, columns, 3) with signals at knots `step` samples apart; returns the rows of sky.

    radiance (3,) is scratch.
    """
    last = min(max(math.ceil(camera[HORIZON] - 0.5), 0), int(camera[HEIGHT]))
    for band in range((last + step - 1) // step + 1):
        _knots(np.float64(min(band * step, last)), step, camera, through, tones, clouds, radiance, out[band])
    return last


@bare
def sky_rows(knots: np.ndarray, step: int, sky: int, width: int, first: int, last: int, colours: np.ndarray,
             depths: np.ndarray, labels: np.ndarray) -> None:  # fmt: skip
    """Fill rows [first, last) as far as they show sky, the picture's first `sky` rows; first is even."""
    half, eight, sixteen = np.float32(0.5), np.uint32(8), np.uint32(16)
    share = np.float32(1.0 / step)
    until = min(last, sky)
    for y in range(first, until):
        line = (y - first) * width
        if y & 1:  # two rows of samples are a row of pixels
            for i in range(np.uint64(line), np.uint64(line + width)):
                colours[i] = colours[i - np.uint64(width)]
            continue
        band = y // step
        top, bottom = band * step, min((band + 1) * step, sky)
        down = np.float32((y + 0.5 - top) / (bottom - top))
        for k in range((width + step - 1) // step):
            a, b = k * step, min((k + 1) * step, width)
            r0 = knots[band, k, 0] + down * (knots[band + 1, k, 0] - knots[band, k, 0])
            g0 = knots[band, k, 1] + down * (knots[band + 1, k, 1] - knots[band, k, 1])
            b0 = knots[band, k, 2] + down * (knots[band + 1, k, 2] - knots[band, k, 2])
            k1 = k + 1
            r1 = (knots[band, k1, 0] + down * (knots[band + 1, k1, 0] - knots[band, k1, 0]) - r0) * share
            g1 = (knots[band, k1, 1] + down * (knots[band + 1, k1, 1] - knots[band, k1, 1]) - g0) * share
            b1 = (knots[band, k1, 2] + down * (knots[band + 1, k1, 2] - knots[band, k1, 2]) - b0) * share
            i0 = np.uint64(line + a)
            for i in range(i0, np.uint64(line + b)):
                t = np.float32(np.int32(i - i0)) + half
                red, green, blue = np.int32(r0 + r1 * t), np.int32(g0 + g1 * t), np.int32(b0 + b1 * t)
                colours[i] = np.uint32(red) | (np.uint32(green) << eight) | (np.uint32(blue) << sixteen)
    for i in range(np.uint64(max(until - first, 0) * width)):
        depths[i] = np.float32(0.0)
    if labels.shape[0] > 0:
        for i in range(np.uint64(max(until - first, 0) * width)):
            labels[i] = np.uint16(0)
