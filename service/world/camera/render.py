"""The camera: from a scene, the vehicles' poses and the weather to a picture, with depth and segmentation if wanted."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from policies.exactmath import sincos
from service.world.camera import columns as C
from service.world.camera.bodies import BRAKE_LIGHT_MPS2, bodies
from service.world.camera.collect import Scratch, collect, scratch_for
from service.world.camera.finish import add_sensor_noise, sensor_noise_table
from service.world.camera.lens import lens_of
from service.world.camera.lights import rain_streaks, shine
from service.world.camera.poses import ACCELERATION_MPS2, HEADING_RAD, X_M, Y_M
from service.world.camera.raster import ROW, TONES, beam_table, draw, row_table, tone_table
from service.world.camera.scene import Scene
from service.world.camera.sky import AIR_M, cloud_texture, sky_knots, sky_rows
from service.world.camera.weather import RANGE_STEP_M, Light, Weather, light_of
from service.world.scenario.schema import CameraSpec

SAMPLES = 2  # a side of a pixel
BAND_BYTES = 700_000  # of colour and depth: rows that are drawn together stay in the processor's cache
LARGEST_LIST = 20_000  # polygons in a picture
SEEN_TO = 0.012  # transmittance below which nothing is drawn
LARGEST_RANGE_M = 4500.0
SKY_KNOTS = 56  # across the picture
NOTHING = np.empty(0, np.uint16)


@dataclass(frozen=True)
class Images:
    """A picture and what each of its pixels is; depth and label are those of the sample up and left of the centre."""

    rgb: np.ndarray  # (h, w, 3) uint8
    depth_m: np.ndarray  # (h, w) float32 along the optical axis, inf in the sky
    label: np.ndarray  # (h, w) uint16: Label, or VEHICLE_ID + row


class Camera:
    """A camera on a vehicle. Not for several threads at once: it keeps its buffers."""

    def __init__(self, spec: CameraSpec | None = None):
        self.spec = spec = spec or CameraSpec()
        self._lens = lens = lens_of(spec)
        self._width, self._height = width, height = SAMPLES * lens.width_px, SAMPLES * lens.height_px
        rows = max(BAND_BYTES // (8 * width) // SAMPLES, 4) * SAMPLES
        self._band = rows = min(rows, height)
        self._colours = np.zeros(rows * width, np.uint32)
        self._depths = np.zeros(rows * width, np.float32)
        self._labels = np.zeros(rows * width, np.uint16)
        self._picture = np.zeros((lens.height_px, lens.width_px, 4), np.uint8)
        self._inverse_depth = np.zeros((lens.height_px, lens.width_px), np.float32)
        self._label = np.zeros((lens.height_px, lens.width_px), np.uint16)
        self._left, self._right = np.zeros(height), np.zeros(height)
        self._rows, self._beams = np.zeros((height, ROW)), np.zeros(width)
        self._step = max(8, width // SKY_KNOTS)
        self._knots = np.zeros((height // self._step + 2, width // self._step + 2, 3), np.float32)
        self._polygons = np.zeros((LARGEST_LIST, C.POLYGON))
        self._bodies = bodies()
        self._tones = tone_table()
        self._clouds = cloud_texture()
        self._sensor_noise_table = sensor_noise_table()
        self._scratch: Scratch | None = None
        self._radiance = np.zeros(3)
        self._weather: Weather | None = None
        self._state = np.zeros(C.CAMERA)
        self._state[C.FOCAL] = SAMPLES * lens.focal_px
        self._state[C.CENTRE_X] = SAMPLES * lens.centre_x_px
        self._state[C.CENTRE_Y] = SAMPLES * lens.centre_y_px
        self._state[C.WIDTH], self._state[C.HEIGHT] = width, height
        beam_table(self._state, self._beams)

    def render(
        self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, seed: int = 0, frame: int = 0
    ) -> np.ndarray:
        """The picture (h, w, 3) uint8 RGB that the vehicle in row `ego` takes.

        poses: (n, 6) float64, see `poses_of`. seed and frame number decide the sensor's noise and where raindrops
            are: the same arguments give the same bits.
        """
        self._draw(scene, poses, ego, weather, False)
        return self._finished(scene, poses, ego, seed, frame)

    def images(
        self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, seed: int = 0, frame: int = 0
    ) -> Images:
        """As `render`, with depth and segmentation of the same pass."""
        self._draw(scene, poses, ego, weather, True)
        with np.errstate(divide="ignore"):
            depth = np.float32(1.0) / self._inverse_depth
        rgb = self._finished(scene, poses, ego, seed, frame)
        return Images(rgb, self._lens.warp(depth, True), self._lens.warp(self._label.copy(), True))

    def rays(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The position (3,) of the camera on a vehicle at `pose` (6,), and the direction (h, w, 3) of each pixel of
        `depth_m` and `label`; a point at depth d lies at position + d * direction."""
        self._place(pose)
        state, lens = self._state, self._lens
        x, y = np.meshgrid(np.arange(lens.width_px), np.arange(lens.height_px))
        right = ((SAMPLES * x + 0.5) - state[C.CENTRE_X]) / state[C.FOCAL]
        down = ((SAMPLES * y + 0.5) - state[C.CENTRE_Y]) / state[C.FOCAL]
        axes = [state[a : a + 3] for a in (C.RIGHT, C.DOWN, C.FORWARD)]
        direction = right[..., None] * axes[0] + down[..., None] * axes[1] + axes[2]
        if lens.at is not None:
            direction = np.dstack([lens.warp(direction[..., c], True) for c in range(3)])
        return state[C.EYE : C.EYE + 3].copy(), direction

    def _place(self, pose: np.ndarray) -> None:
        """Where the camera on a vehicle at `pose` (6,) is."""
        spec, state = self.spec, self._state
        sine, cosine = sincos(float(pose[HEADING_RAD]))
        yaw_sine, yaw_cosine = sincos(float(pose[HEADING_RAD]) + math.radians(spec.yaw_deg))
        up, level = sincos(math.radians(spec.pitch_deg))
        state[C.EYE] = pose[X_M] + spec.x_m * cosine - spec.y_m * sine
        state[C.EYE + 1] = pose[Y_M] + spec.x_m * sine + spec.y_m * cosine
        state[C.EYE + 2] = spec.z_m
        state[C.RIGHT : C.RIGHT + 3] = yaw_sine, -yaw_cosine, 0.0
        state[C.DOWN : C.DOWN + 3] = up * yaw_cosine, up * yaw_sine, -level
        state[C.FORWARD : C.FORWARD + 3] = level * yaw_cosine, level * yaw_sine, up
        # the row whose rays are level
        state[C.HORIZON] = state[C.CENTRE_Y] + state[C.FOCAL] * up / level

    def _set_weather(self, weather: Weather) -> None:
        """What depends on the weather alone; kept until it changes."""
        self._weather, self._light, state = weather, light_of(weather), self._state
        light: Light = self._light
        hidden = np.flatnonzero(light.transmittance < SEEN_TO)
        sun_up = max(light.to_sun[2], 0.0) * light.sun
        ground = light.sky_up + sun_up
        signal = light.gain * TONES
        for column, value in (
            (C.SUN, light.sun), (C.SKY_UP, light.sky_up), (C.SKY_SIDE, light.sky_side), (C.GROUND_LIGHT, ground),
            (C.FOG, light.fog), (C.SHEEN, 0.7 * light.horizon + 0.3 * light.zenith), (C.ZENITH, light.zenith),
            (C.SKY_HORIZON, light.horizon), (C.HALO, light.glow),
            (C.CLOUD, 0.55 * light.sky_up + 0.5 * light.sun * max(light.to_sun[2], 0.15) + 0.25 * light.horizon),
        ):  # fmt: skip
            state[column : column + 3] = signal * value
        state[C.TO_SUN : C.TO_SUN + 3] = light.to_sun
        state[C.SHADE : C.SHADE + 3] = np.sqrt((light.sky_up + 0.12 * sun_up) / np.maximum(ground, 1e-9))
        state[C.CONTACT : C.CONTACT + 3] = 0.62
        state[C.SIGNAL], state[C.LAMPS], state[C.WET] = signal, signal * max(light.lamps, 1e-4), light.wet
        state[C.RANGE_M] = min(
            float(hidden[0]) * RANGE_STEP_M if len(hidden) else LARGEST_RANGE_M, LARGEST_RANGE_M
        )
        state[C.RANGE_STEP_M] = RANGE_STEP_M
        state[C.HEADLIGHT] = signal * light.lamps if light.lights_on else 0.0
        state[C.LIGHTS_ON] = 1.0 if light.lights_on else 0.0
        state[C.COVER] = max(light.clouds, 0.12)

    def _draw(self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, labels: bool) -> None:
        """Fill the level picture, and its inverse depths and labels."""
        if weather is not self._weather and weather != self._weather:
            self._set_weather(weather)
        if self._scratch is None or len(self._scratch.cells) < len(scene.stage.cells):
            self._scratch = scratch_for(scene.stage)
        self._place(poses[ego])
        state, air, tones, polygons = self._state, self._light.transmittance, self._tones, self._polygons
        count = collect(scene.stage, self._bodies, poses, ego, state, self._scratch, polygons)
        through = float(air[int(AIR_M / RANGE_STEP_M)])
        sky = sky_knots(state, through, tones, self._clouds, self._step, self._radiance, self._knots)
        row_table(state, air, self._rows)
        width, colours, depths = self._width, self._colours, self._depths
        label = self._labels if labels else NOTHING
        for first in range(0, self._height, self._band):
            last = min(first + self._band, self._height)
            sky_rows(self._knots, self._step, sky, width, first, last, colours, depths, label)
            draw(
                polygons, count, state, air, tones, self._rows, self._beams, first, last, colours, depths, label,
                self._left, self._right,
            )  # fmt: skip
            shape, n = (last - first, width), (last - first) * width
            part = slice(first // SAMPLES, last // SAMPLES)
            samples = colours[:n].view(np.uint8).reshape(*shape, 4)
            size = (width // SAMPLES, (last - first) // SAMPLES)
            cv2.resize(samples, size, self._picture[part], interpolation=cv2.INTER_AREA)
            self._inverse_depth[part] = depths[:n].reshape(shape)[::SAMPLES, ::SAMPLES]
            if labels:
                self._label[part] = label[:n].reshape(shape)[::SAMPLES, ::SAMPLES]

    def _finished(self, scene: Scene, poses: np.ndarray, ego: int, seed: int, frame: int) -> np.ndarray:
        """The level picture with lamps, through the lens, with drops and noise."""
        picture = cv2.cvtColor(self._picture, cv2.COLOR_RGBA2RGB)
        light, weather, seed = self._light, self._weather, seed & 0xFFFFFFFF
        braking = bool((poses[:, ACCELERATION_MPS2] < BRAKE_LIGHT_MPS2).any())
        if light.lights_on or light.lamps > 0.0 or braking:
            shine(picture, poses, ego, scene.lamps, light.lamps, light.lights_on, self._state, light.transmittance,
                  self._inverse_depth, SAMPLES)  # fmt: skip
        picture = self._lens.warp(picture)
        if weather is not None and weather.rain > 0.0:
            brightness = min(0.25 + float(light.horizon.mean()) * light.gain, 1.0)
            rain_streaks(picture, weather.rain, brightness, seed, frame)
        sensor_noise = self.spec.sensor_noise_levels * light.sensor_noise
        add_sensor_noise(
            picture.reshape(self.spec.height_px, -1), self._sensor_noise_table, sensor_noise, seed, frame
        )
        return picture
