"""The camera: from a scene, the vehicles' poses and the weather to a picture, with depth and segmentation if wanted."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from policies.exactmath import sincos
from service.camera import columns as C
from service.camera.bodies import BRAKE_LIGHT_MPS2, bodies
from service.camera.collect import collect
from service.camera.finish import add_noise, noise_table
from service.camera.lights import rain_streaks, shine
from service.camera.poses import ACCELERATION_MPS2, HEADING_RAD, X_M, Y_M
from service.camera.raster import ROW, TONES, draw, row_table, tone_table
from service.camera.scene import Scene
from service.camera.sky import AIR_M, cloud_texture, sky_rows
from service.camera.weather import RANGE_STEP_M, Light, Weather, light_of
from service.scenario.schema import CameraSpec

SAMPLES = 2  # a side of a pixel
BAND = 96  # rows of samples drawn together
LARGEST_LIST = 20_000  # polygons in a picture
SEEN_TO = 0.012  # transmittance below which nothing is drawn
LARGEST_RANGE_M = 4500.0
SKY_KNOTS = 56  # across the picture
NO_LABELS = np.empty(0, np.uint16)


@dataclass(frozen=True)
class Images:
    """A picture and what each of its pixels is; depth and label are those of the sample up and left of the centre."""

    rgb: np.ndarray  # (h, w, 3) uint8
    depth_m: np.ndarray  # (h, w) float32 along the optical axis, inf in the sky
    label: np.ndarray  # (h, w) uint16: Label, or VEHICLE_ID + row


class Camera:
    """A pinhole camera on a vehicle. Not for several threads at once: it keeps its buffers."""

    def __init__(self, spec: CameraSpec | None = None):
        self.spec = spec = spec or CameraSpec()
        self._width, self._height = SAMPLES * spec.width_px, SAMPLES * spec.height_px
        size = self._width * self._height
        self._colours = np.zeros(size, np.uint32)
        self._depths = np.zeros(size, np.float32)
        self._labels = NO_LABELS
        self._left, self._right = np.zeros(self._height), np.zeros(self._height)
        self._rows = np.zeros((self._height, ROW))
        self._polygons = np.zeros((LARGEST_LIST, C.POLYGON))
        self._bodies = bodies()
        self._tones = tone_table()
        self._clouds = cloud_texture()
        self._noise = noise_table()
        self._cells = np.zeros(0, np.int64)
        self._weather: Weather | None = None
        self._state = np.zeros(C.CAMERA)
        focal = 0.5 * spec.width_px / math.tan(math.radians(0.5 * spec.hfov_deg))
        self._state[C.FOCAL] = SAMPLES * focal
        self._state[C.CENTRE_X], self._state[C.CENTRE_Y] = 0.5 * self._width, 0.5 * self._height
        self._state[C.WIDTH], self._state[C.HEIGHT] = self._width, self._height

    def render(
        self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, seed: int = 0, frame: int = 0
    ) -> np.ndarray:
        """The picture (h, w, 3) uint8 RGB that the vehicle in row `ego` takes.

        poses: (n, 6) float64, see `poses_of`. seed and frame number decide the sensor's noise: the same arguments give
        the same bits.
        """
        self._draw(scene, poses, ego, weather, NO_LABELS)
        return self._picture(seed, frame)

    def images(
        self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, seed: int = 0, frame: int = 0
    ) -> Images:
        """As `render`, with depth and segmentation of the same pass."""
        if not len(self._labels):
            self._labels = np.zeros(len(self._colours), np.uint16)
        self._draw(scene, poses, ego, weather, self._labels)
        shape = (self._height, self._width)
        with np.errstate(divide="ignore"):
            depth = np.float32(1.0) / self._depths.reshape(shape)[::SAMPLES, ::SAMPLES]
        label = self._labels.reshape(shape)[::SAMPLES, ::SAMPLES].copy()
        return Images(self._picture(seed, frame), depth, label)

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

    def _draw(self, scene: Scene, poses: np.ndarray, ego: int, weather: Weather, labels: np.ndarray) -> None:
        if weather is not self._weather and weather != self._weather:
            self._set_weather(weather)
        if len(self._cells) < len(scene.stage.cells):
            self._cells = np.zeros(len(scene.stage.cells), np.int64)
        self._place(poses[ego])
        self._poses, self._own, self._lamps = poses, ego, scene.lamps
        state, air, tones = self._state, self._light.transmittance, self._tones
        colours, depths = self._colours, self._depths
        self._count = count = collect(
            scene.stage, self._bodies, poses, ego, state, self._cells, self._polygons
        )
        through = float(air[int(AIR_M / RANGE_STEP_M)])
        sky_rows(
            state, through, tones, self._clouds, max(8, self._width // SKY_KNOTS), colours, depths, labels
        )
        row_table(state, air, self._rows)
        for first in range(0, self._height, BAND):
            draw(
                self._polygons, count, state, air, tones, self._rows, first, min(first + BAND, self._height), colours,
                depths, labels, self._left, self._right,
            )  # fmt: skip

    def _picture(self, seed: int, frame: int) -> np.ndarray:
        spec = self.spec
        samples = self._colours.view(np.uint8).reshape(self._height, self._width, 4)
        size = (spec.width_px, spec.height_px)
        picture = cv2.cvtColor(cv2.resize(samples, size, interpolation=cv2.INTER_AREA), cv2.COLOR_RGBA2RGB)
        noise = spec.noise_levels * self._light.noise
        light, weather = self._light, self._weather
        if (
            light.lights_on
            or light.lamps > 0.0
            or bool((self._poses[:, ACCELERATION_MPS2] < BRAKE_LIGHT_MPS2).any())
        ):
            shine(picture, self._poses, self._own, self._lamps, light.lamps, light.lights_on, self._state,
                  light.transmittance, self._depths, SAMPLES)  # fmt: skip
        if weather is not None and weather.rain > 0.0:
            brightness = min(0.25 + float(light.horizon.mean()) * light.gain, 1.0)
            rain_streaks(picture, weather.rain, brightness, seed & 0xFFFFFFFF, frame)
        add_noise(picture.reshape(spec.height_px, -1), self._noise, noise, seed & 0xFFFFFFFF, frame)
        return picture
