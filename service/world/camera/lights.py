"""Lamps that shine into the lens, their gleam on a wet road, and falling rain: drawn into the finished picture."""

import math

import numpy as np

from policies.exactmath import sincos
from policies.jit import bare
from service.world.camera.bodies import BRAKE_LIGHT_MPS2, TRUCK_LENGTH_M
from service.world.camera.columns import (
    CENTRE_X,
    CENTRE_Y,
    DOWN,
    EYE,
    FOCAL,
    FORWARD,
    RANGE_STEP_M,
    RIGHT,
    WET,
)  # fmt: skip
from service.world.camera.finish import mixed
from service.world.camera.poses import ACCELERATION_MPS2, HEADING_RAD, LENGTH_M, WIDTH_M, X_M, Y_M

LAMP_M = 0.09  # radius of the bright disc
FARTHEST_LAMP_M = 500.0
STREAKS = 14.0  # per mm/h and 10,000 pixels, near 1 mm/h
RAIN_GREY = 200.0


@bare
def _spot(picture: np.ndarray, x: float, y: float, radius: float, tall: float, red: float, green: float, blue: float
          ) -> None:  # fmt: skip
    """Add a soft spot at pixel position (x, y), `tall` times as high as wide; colours are strengths up to 1."""
    reach = min(3.5 * radius, 0.12 * picture.shape[1])
    y0, y1 = max(int(y - reach * tall), 0), min(int(y + reach * tall) + 1, picture.shape[0])
    x0, x1 = max(int(x - reach), 0), min(int(x + reach) + 1, picture.shape[1])
    narrow = 1.0 / (radius * radius)
    for j in range(y0, y1):
        dy = (j + 0.5 - y) / tall
        for i in range(x0, x1):
            dx = i + 0.5 - x
            r2 = dx * dx + dy * dy
            if r2 > reach * reach:
                continue
            fall = 1.0 + r2 * narrow
            strength = (1.0 - r2 / (reach * reach)) / (fall * fall)
            for c in range(3):
                share = strength * (red if c == 0 else (green if c == 1 else blue))
                value = np.float64(picture[j, i, c])
                picture[j, i, c] = np.uint8(value + (255.0 - value) * min(share, 1.0))


@bare
def _lamp(picture: np.ndarray, x: float, y: float, z: float, red: float, green: float, blue: float, strength: float,
          size_m: float, camera: np.ndarray, through_air: np.ndarray, inverse_depth: np.ndarray, samples: int
          ) -> None:  # fmt: skip
    """A lamp at the world point (x, y, z), if nothing hides it, and its gleam where the road is wet."""
    dx, dy, dz = x - camera[EYE], y - camera[EYE + 1], z - camera[EYE + 2]
    ahead = dx * camera[FORWARD] + dy * camera[FORWARD + 1] + dz * camera[FORWARD + 2]
    if ahead < 1.0 or ahead > FARTHEST_LAMP_M:
        return
    scale = camera[FOCAL] / ahead
    right = dx * camera[RIGHT] + dy * camera[RIGHT + 1]
    down = dx * camera[DOWN] + dy * camera[DOWN + 1] + dz * camera[DOWN + 2]
    sx, sy = camera[CENTRE_X] + right * scale, camera[CENTRE_Y] + down * scale
    column, row = math.floor(sx / samples), math.floor(sy / samples)
    if column < 0 or row < 0 or column >= picture.shape[1] or row >= picture.shape[0]:
        return
    if inverse_depth[row, column] * (ahead - 0.6) > 1.0:
        return
    step = min(int(ahead / camera[RANGE_STEP_M]), through_air.shape[0] - 1)
    through = np.float64(through_air[step])
    px = 1.0 / samples
    radius = max(size_m * scale * px, 0.75) * (1.0 + 0.8 * (1.0 - through))
    # a lamp smaller than a pixel is dimmer, not smaller
    dim = min(size_m * scale * px / 0.35, 1.0)
    strength = min(strength * (0.35 + 0.65 * through) * math.sqrt(through) * (0.25 + 0.75 * dim), 1.0)
    _spot(picture, sx * px, sy * px, radius, 1.0, red * strength, green * strength, blue * strength)
    if camera[WET] > 0.0:
        below = dx * camera[DOWN] + dy * camera[DOWN + 1] + (-z - camera[EYE + 2]) * camera[DOWN + 2]
        gleam = 0.45 * camera[WET] * strength
        tall = min(max(0.35 * (below - down) * scale * px / radius, 1.0), 8.0)
        _spot(picture, sx * px, (camera[CENTRE_Y] + below * scale) * px, radius, tall, red * gleam, green * gleam,
              blue * gleam)  # fmt: skip


@bare
def shine(picture: np.ndarray, poses: np.ndarray, own: int, lamps: np.ndarray, night: float, lights_on: bool,
          camera: np.ndarray, through_air: np.ndarray, inverse_depth: np.ndarray, samples: int) -> None:  # fmt: skip
    """Draw the vehicles' lamps and the street lamps (n, 3) that can be seen into `picture` (h, w, 3)."""
    for row in range(poses.shape[0]):
        length, width = poses[row, LENGTH_M], poses[row, WIDTH_M]
        braking = poses[row, ACCELERATION_MPS2] < BRAKE_LIGHT_MPS2
        if row == own or length <= 0.0 or not (lights_on or braking):
            continue
        x, y = poses[row, X_M], poses[row, Y_M]
        if (x - camera[EYE]) * camera[FORWARD] + (y - camera[EYE + 1]) * camera[FORWARD + 1] < 0.0:
            continue
        sine, cosine = sincos(poses[row, HEADING_RAD])
        along = cosine * camera[FORWARD] + sine * camera[FORWARD + 1]
        end, height = (-0.5 if along > 0.0 else 0.5), 0.78
        if end > 0.0 and not lights_on:
            continue
        if length > TRUCK_LENGTH_M:
            height = 0.98
        for side in (-0.36, 0.36):
            lx = x + end * length * cosine - side * width * sine
            ly = y + end * length * sine + side * width * cosine
            if end > 0.0:
                _lamp(picture, lx, ly, 0.65, 1.0, 0.95, 0.85, 0.5 + 0.5 * night, 2.0 * LAMP_M, camera, through_air,
                      inverse_depth, samples)  # fmt: skip
            else:
                bright = (0.75 if braking else 0.4) * (0.5 + 0.5 * night)
                _lamp(
                    picture,
                    lx,
                    ly,
                    height,
                    1.0,
                    0.10,
                    0.07,
                    bright,
                    LAMP_M,
                    camera,
                    through_air,
                    inverse_depth,
                    samples,
                )
    if night > 0.15:
        for i in range(lamps.shape[0]):
            _lamp(picture, lamps[i, 0], lamps[i, 1], lamps[i, 2], 1.0, 0.80, 0.50, 0.9 * night, 1.6 * LAMP_M, camera,
                  through_air, inverse_depth, samples)  # fmt: skip


@bare
def rain_streaks(picture: np.ndarray, rain_mmph: float, brightness: float, seed: int, frame: int) -> None:
    """Draw falling drops as short pale streaks, placed by (seed, frame)."""
    h, w = picture.shape[0], picture.shape[1]
    count = int(STREAKS * math.sqrt(rain_mmph) * math.sqrt(h * w / 1e4))
    for k in range(count):
        place, shape = mixed(seed, frame, 3 * k + 1), mixed(seed, frame, 3 * k + 2)
        x, y = float(place % w), float((place // w) % h)
        length = max(2, int((0.04 + 0.10 * ((shape & 255) / 255.0)) * h))
        slant = (x / w - 0.5) * 0.8  # drops seem to come from ahead
        strength = 0.10 + 0.22 * (((shape >> 8) & 255) / 255.0)
        for j in range(length):
            px, py = int(x + slant * j), int(y) + j
            if 0 <= px < w and 0 <= py < h:
                for c in range(3):
                    value = float(picture[py, px, c])
                    picture[py, px, c] = np.uint8(value + (RAIN_GREY * brightness - value) * strength)
