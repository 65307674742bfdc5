"""The scenario as frozen data; a key's unit is the end of its name."""

from typing import Literal

import msgspec

FORMAT = 1


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class Beta(_Table, frozen=True, tag_field="distribution", tag="beta"):
    """A Beta(alpha, beta) stretched to [low, high]."""

    alpha: float
    beta: float
    low: float
    high: float


class Uniform(_Table, frozen=True, tag_field="distribution", tag="uniform"):
    """Uniform on [low, high]."""

    low: float
    high: float


class TruncatedNormal(_Table, frozen=True, tag_field="distribution", tag="truncated-normal"):
    """N(mean, deviation^2) given that it lies in [low, high]."""

    mean: float
    deviation: float
    low: float
    high: float


Distribution = Beta | Uniform | TruncatedNormal


class Network(_Table, frozen=True):
    road: str  # a built-in road ("i80"), or the path of a SUMO .net.xml, relative to the scenario's file
    edges: tuple[str, ...] = ()  # for a path: the edges of the corridor, from its start to its end


class Time(_Table, frozen=True):
    horizon_s: float  # a rollout ends here at the latest
    step_s: float = 0.1


class Drivers(_Table, frozen=True):
    weights: str = "drivers-gail"  # built-in weights, or the path of a .safetensors file
    # of the drivers' actions: a stream for each rollout, one stream for all, or a part of X that searches can move
    noise_mode: Literal["drawn", "frozen", "searched"] = msgspec.field(default="drawn", name="noise")


class Rss(_Table, frozen=True):
    """What responsibility-sensitive safety assumes of vehicles (Shalev-Shwartz et al. 2017, Definitions 1 and 6)."""

    response_s: float = 1.0
    acceleration_mps2: float = 3.5  # of the vehicle behind, during its response time
    least_braking_mps2: float = 4.0  # that the vehicle behind does then
    hardest_braking_mps2: float = 8.0  # that the vehicle in front may do
    lateral_acceleration_mps2: float = 0.2  # towards each other, during the response time
    lateral_braking_mps2: float = 0.8  # then
    lateral_margin_m: float = 0.1  # for the small movements within a lane


class Safety(_Table, frozen=True):
    measure: str = "ttc"  # a name of service.world.scenario.measures, or "stl: FORMULA"
    rays: int = 20  # of ttc
    rss: Rss = Rss()


class Start(_Table, frozen=True):
    """Where vehicles start: distributions and sizes that hold for all, unless a vehicle says otherwise."""

    station_m: Distribution
    lane_offset_m: Distribution
    heading_deg: Distribution
    speed_mps: Distribution
    length_m: float = 4.5
    width_m: float = 1.8


class Vehicle(_Table, frozen=True):
    name: str
    lane: int  # 1 is the leftmost, as NGSIM counts
    role: Literal["ego", "environment"] = "environment"
    station_m: Distribution | None = None
    lane_offset_m: Distribution | None = None
    heading_deg: Distribution | None = None
    speed_mps: Distribution | None = None
    length_m: float | None = None
    width_m: float | None = None


class Background(_Table, frozen=True):
    """Traffic that SUMO drives around the controlled vehicles."""

    density_veh_per_km_lane: float
    speed_mps: float


class CameraSpec(_Table, frozen=True):
    """The ego's camera: picture, lens and where it sits; for egos that look, and for pictures."""

    width_px: int = 200
    height_px: int = 66
    hfov_deg: float = 66.0  # angle of view across the picture
    x_m: float = 0.4  # ahead of the vehicle's centre
    y_m: float = 0.0  # to the left
    z_m: float = 1.35  # above the road
    yaw_deg: float = 0.0  # to the left
    pitch_deg: float = -4.5  # up; below 0 it looks down on the road
    roll_deg: float = 0.0  # clockwise, seen from behind
    distortion: tuple[float, ...] = ()  # OpenCV's k1, k2, p1, p2 and k3; empty: none
    # standard deviation of the sensor's noise by day, of 255
    sensor_noise_levels: float = msgspec.field(default=2.0, name="noise_levels")


class RandomWeather(_Table, frozen=True):
    """Light and weather as random variables: a coordinate of X each. What they mean: service.world.camera.weather."""

    sun_elevation_deg: Distribution  # above the horizon; below -6 is night
    sun_azimuth_deg: Distribution  # compass: 0 north, 90 east
    fog_per_km: Distribution  # extinction coefficient; 3.912 / it is the visibility in km
    rain_mmph: Distribution  # 0 and below: dry
    exposure_ev: Distribution  # error of the camera's exposure control, in stops


class FixedStart(_Table, frozen=True):
    """Where a vehicle starts in the fixed rollout."""

    name: str  # of the vehicle
    station_m: float
    lane_offset_m: float
    heading_deg: float
    speed_mps: float


class Fixed(_Table, frozen=True):
    """One rollout of the scenario, every random value given: what `tailroad rollout FILE` runs. P0 stays as it is."""

    noise_seed: str  # of the action noise, 0 to 2**64 - 1, as text because TOML's integers are shorter
    starts: tuple[FixedStart, ...]  # one for each vehicle
    driver_weights: tuple[float, ...]  # xi: the last layer of the driver network that all others share
    others: dict[str, float] = {}  # what else the scenario draws, by its name in P0
    ego: str | None = None  # that drove on record; --ego says otherwise
    f: float | None = None  # on record with that ego
    weights_sha256: str | None = None  # of the drivers' weights that were used


class Scenario(_Table, frozen=True):
    format: int
    name: str
    description: str
    network: Network
    time: Time
    start: Start
    vehicles: tuple[Vehicle, ...]
    drivers: Drivers = Drivers()
    safety: Safety = Safety()
    background: Background | None = None
    camera: CameraSpec = CameraSpec()
    weather: RandomWeather | None = None  # without it: a clear afternoon
    fixed: Fixed | None = None

    @property
    def action_noise_values(self) -> int:
        """Standard normals in the action noise of a rollout: acceleration and turn rate, each step, each vehicle."""
        return self.steps * len(self.vehicles) * 2

    @property
    def steps(self) -> int:
        return round(self.time.horizon_s / self.time.step_s)

    @property
    def ego(self) -> int:
        """The row of the ego among the vehicles."""
        return next(i for i, vehicle in enumerate(self.vehicles) if vehicle.role == "ego")

    def of(self, vehicle: Vehicle, key: str):
        """A vehicle's own value of `key`, or the one that holds for all."""
        own = getattr(vehicle, key)
        return getattr(self.start, key) if own is None else own
