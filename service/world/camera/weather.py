"""Weather and light: the few numbers a scenario draws, and what they mean to a surface, the sky and the sensor.

Radiances are linear and relative: 1 is a white diffuse surface in full sun at noon. The curves over the sun's elevation
are drawn by eye after photographs; extinction follows Koschmieder (contrast at distance d is exp(-sigma d), so the
meteorological visibility, contrast 2%, is 3.912 / sigma).
"""

import math
from dataclasses import dataclass

import numpy as np

from policies.exactmath import exp, log, sincos
from policies.jit import bare
from service.world.scenario.base import weather_values
from service.world.scenario.schema import Scenario

KOSCHMIEDER = 3.912  # -ln 0.02
CLEAR_PER_KM = 0.12  # extinction of clean air
MAX_RANGE_M = 6000.0
RANGE_STEP_M = 2.0  # of the transmittance table


@dataclass(frozen=True)
class Weather:
    """Light and weather of a rollout; the default is a clear afternoon."""

    sun_elevation_deg: float = 48.0  # above the horizon; below -6 is night
    sun_azimuth_deg: float = 215.0  # compass: 0 north, 90 east
    fog_per_km: float = 0.15  # extinction coefficient; 3.912 / it is the visibility in km
    rain_mmph: float = 0.0  # 0 and below: dry
    exposure_ev: float = 0.0  # error of the exposure control, in stops

    @property
    def visibility_m(self) -> float:
        return 1000.0 * KOSCHMIEDER / (max(self.fog_per_km, CLEAR_PER_KM) + RAIN_PER_KM * self.rain)

    @property
    def rain(self) -> float:
        """Rain rate in mm/h, 0 when dry."""
        return max(self.rain_mmph, 0.0)

    @property
    def lights_on(self) -> bool:
        """Vehicles drive with their headlights on: low sun, rain or fog."""
        return self.sun_elevation_deg < 4.0 or self.rain > 0.3 or self.visibility_m < 900.0


def weather_of(scenario: Scenario, x: np.ndarray) -> Weather:
    """The weather of a draw x (d,); a clear afternoon where the scenario draws none."""
    return Weather(**weather_values(scenario, x))


RAIN_PER_KM = 0.16  # extinction of rain per mm/h (Atlas 1953, rounded)

# Over the sun's elevation (degrees): night, nautical, civil twilight, sunset, low sun, day, high sun.
_ELEVATION = np.array([-18.0, -12.0, -6.0, -1.0, 2.0, 8.0, 20.0, 60.0])
_SUN = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0.34, 0.13, 0.035], [0.85, 0.52, 0.26],
                 [1.15, 0.98, 0.78], [1.32, 1.22, 1.10]])  # fmt: skip
_ZENITH = np.array([[0.0003, 0.0004, 0.0009], [0.0007, 0.0011, 0.0028], [0.010, 0.017, 0.042],
                    [0.040, 0.065, 0.140], [0.070, 0.110, 0.220], [0.095, 0.165, 0.33], [0.10, 0.20, 0.44],
                    [0.10, 0.22, 0.50]])  # fmt: skip
_HORIZON = np.array([[0.0019, 0.0015, 0.0013], [0.0045, 0.0034, 0.0038], [0.060, 0.040, 0.045],
                     [0.24, 0.15, 0.12], [0.42, 0.27, 0.20], [0.48, 0.42, 0.38], [0.48, 0.56, 0.64],
                     [0.50, 0.62, 0.74]])  # fmt: skip
_STREET_LIGHT = np.array([0.0130, 0.0105, 0.0070])  # of a lit freeway at night, on average
_GREY = np.array([0.32, 0.34, 0.37])  # what an overcast sky makes of the light, relative to its brightness


@dataclass(frozen=True)
class Light:
    """What the renderer needs of the weather; radiances (3,) are linear RGB."""

    to_sun: np.ndarray  # (3,) unit vector
    sun: np.ndarray  # irradiance of a surface facing the sun
    sky_up: np.ndarray  # irradiance of a surface facing up, without the sun
    sky_side: np.ndarray  # of a vertical surface
    zenith: np.ndarray  # radiance overhead
    horizon: np.ndarray
    glow: np.ndarray  # added round the sun
    fog: np.ndarray  # radiance of the air itself
    clouds: float  # 0 to 1
    wet: float  # 0 to 1
    lamps: float  # 0 by day, 1 when headlights and street lamps matter fully
    lights_on: bool
    gain: float  # radiance to signal
    sensor_noise: float  # standard deviation factor of the sensor noise
    transmittance: np.ndarray  # (n,) at RANGE_STEP_M steps of distance, float32


def light_of(weather: Weather) -> Light:
    """The light of a weather; raises ValueError for values that are not finite."""
    values = (
        weather.sun_elevation_deg, weather.sun_azimuth_deg, weather.fog_per_km, weather.rain_mmph, weather.exposure_ev
    )  # fmt: skip
    if not all(math.isfinite(v) for v in values):
        raise ValueError(f"weather must be finite numbers, not {weather}")
    sine, cosine = sincos(math.radians(weather.sun_elevation_deg))
    azimuth_sine, azimuth_cosine = sincos(math.radians(90.0 - weather.sun_azimuth_deg))
    extinction = max(weather.fog_per_km, CLEAR_PER_KM) + RAIN_PER_KM * weather.rain
    clouds = min(weather.rain / 1.5, 1.0)
    clouds = max(clouds, min(max(extinction - 1.0, 0.0) / 6.0, 1.0))

    e = weather.sun_elevation_deg
    sun, zenith, horizon = (_curve(table, e) for table in (_SUN, _ZENITH, _HORIZON))
    brightness = float((0.5 * zenith + 0.5 * horizon + 0.35 * max(sine, 0.0) * sun).mean())
    grey = 0.8 * _GREY / _GREY.mean() * brightness * (1.0 - 0.3 * min(weather.rain / 20.0, 1.0))
    sun = sun * (1.0 - clouds) ** 2
    zenith = zenith + clouds * (0.8 * grey - zenith)
    horizon = horizon + clouds * (1.15 * grey - horizon)
    lamps = _ramp(e, 4.0, -5.0)
    sky_up = 1.1 * (0.6 * zenith + 0.4 * horizon) + lamps * _STREET_LIGHT
    sky_side = 0.55 * (0.35 * zenith + 0.65 * horizon) + 0.10 * (sky_up + max(sine, 0.0) * sun)
    fog = 0.75 * horizon + 0.08 * sky_up
    # exposure: an automatic control that follows the light, but lets the night be darker than the day
    level = float((sky_up + max(sine, 0.0) * sun).mean()) + 0.035 * lamps + 0.002
    gain = 0.92 * _power(level, -0.82) * _power(2.0, weather.exposure_ev)
    transmittance = np.empty(int(MAX_RANGE_M / RANGE_STEP_M) + 1, np.float32)
    _fill_transmittance(extinction / 1000.0, transmittance)
    return Light(
        to_sun=np.array([cosine * azimuth_cosine, cosine * azimuth_sine, sine]),
        sun=sun if e > 0.0 else np.zeros(3),
        sky_up=sky_up,
        sky_side=sky_side,
        zenith=zenith,
        horizon=horizon,
        glow=(1.0 - clouds) * (0.55 * sun + 0.35 * horizon * _ramp(e, -10.0, 0.0)),
        fog=fog,
        clouds=clouds,
        wet=min(weather.rain / 1.0, 1.0),
        lamps=lamps,
        lights_on=weather.lights_on,
        gain=gain,
        sensor_noise=1.0 + 2.0 * _ramp(gain, 4.0, 25.0),
        transmittance=transmittance,
    )


@bare
def _fill_transmittance(extinction_per_m: float, out: np.ndarray) -> None:
    for i in range(out.shape[0]):
        out[i] = exp(-extinction_per_m * RANGE_STEP_M * i)


def _curve(table: np.ndarray, elevation_deg: float) -> np.ndarray:
    """Row of a table at an elevation, linear between its rows."""
    return np.array([np.interp(elevation_deg, _ELEVATION, table[:, c]) for c in range(3)])


def _ramp(value: float, low: float, high: float) -> float:
    """0 at `low`, 1 at `high`, straight between."""
    return min(max((value - low) / (high - low), 0.0), 1.0)


def _power(base: float, exponent: float) -> float:
    """base ** exponent with the same bits everywhere."""
    return float(exp(exponent * log(base)))
