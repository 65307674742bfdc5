"""The scenario as frozen data; a key's unit is the end of its name."""

from typing import Any, Literal

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


class NormalMixture(_Table, frozen=True, tag_field="distribution", tag="normal-mixture"):
    """Zero on average, of two spreads, given that it lies in [low, high]: `wide` with probability `share`, else
    `narrow` (standard deviations)."""

    share: float
    narrow: float
    wide: float
    low: float
    high: float


Distribution = Beta | Uniform | TruncatedNormal | NormalMixture


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


class Avoidance(_Table, frozen=True):
    """What a driver who looks takes for a conflict, and how hard he brakes then (service.world.sim.avoidance)."""

    ttc_s: float = 4.0  # to the vehicle ahead, or to one that will be in the way
    required_mps2: float = 1.0  # deceleration that would just do
    hardest_mps2: float = 7.5
    jerk_mps3: float = 12.65  # how fast the braking builds up
    gap_m: float = 2.5  # beside or behind a neighbour with less room than this, ...
    gap_closing_s: float = 3.0  # ... and this long a way at the closing speed, nobody goes on changing lanes


class Reaction(_Table, frozen=True):
    """A driver's reaction time to a conflict: lognormal, drawn once a rollout."""

    median_s: float = 0.9
    sigma: float = 0.35  # of its logarithm


class Glances(_Table, frozen=True):
    """Looks off the road, during which the last action is held."""

    epsilon: float  # probability that a glance that would begin in a conflict is not suppressed
    every_s: float = 6.0  # eyes on the road, on average, until the next one
    median_s: float = 0.75  # their duration is lognormal
    sigma: float = 0.65
    long_s: float = 1.5  # the first one this long is a part of X, by name; the others come from the seed


class NoiseProcess(_Table, frozen=True):
    """The drivers' action noise, correlated in time: correlation (1 + t / T) exp(-t / T) (service.world.sim.latent)."""

    acceleration_amplitude: float  # standard deviation, in those that the network answers
    acceleration_correlation_s: float  # T
    turn_rate_amplitude: float
    turn_rate_correlation_s: float
    modes: int = 2  # of each action: its slowest movements, a part of X by name; the rest comes from the seed
    window_s: float = 10.0  # from the start, that the modes describe


class Human(_Table, frozen=True):
    """Drivers who see, react and sometimes do not look; without this table the network drives alone."""

    glances: Glances
    noise: NoiseProcess
    avoidance: Avoidance = Avoidance()
    reaction: Reaction = Reaction()


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


class Start(_Table, frozen=True, kw_only=True):
    """Where vehicles start: distributions and sizes that hold for all, unless a vehicle says otherwise.

    Headings are given by `heading_deg`, or by `lateral_mps`: the speed across the lane of a vehicle in its middle at
    `lateral_full_mps` or faster. Off the middle it is 1 + lateral_offset_gain (offset / 1 m)^2 times that, below that
    speed (speed / lateral_full_mps)^lateral_speed_power times that; the heading is its arc sine over the speed, at
    most `lateral_steepest_deg`.
    """

    station_m: Distribution
    lane_offset_m: Distribution
    heading_deg: Distribution | None = None
    speed_mps: Distribution
    length_m: float = 4.5
    width_m: float = 1.8
    lateral_mps: Distribution | None = None
    lateral_offset_gain: float = 0.0
    lateral_full_mps: float = 7.0
    lateral_speed_power: float = 1.0
    lateral_steepest_deg: float = 20.0


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
    lateral_mps: Distribution | None = None


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


class FixedStart(_Table, frozen=True, kw_only=True):
    """Where a vehicle starts in the fixed rollout."""

    name: str  # of the vehicle
    station_m: float
    lane_offset_m: float
    heading_deg: float | None = None
    lateral_mps: float | None = None  # in place of the heading where the scenario draws it
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
    human: Human | None = None

    @property
    def start_names(self) -> tuple[str, str, str, str]:
        """The coordinates of X that a vehicle starts with: S, T, W and V of the paper, in this order."""
        return (
            "station_m",
            "lane_offset_m",
            "heading_deg" if self.start.lateral_mps is None else "lateral_mps",
            "speed_mps",
        )

    @property
    def noise_channels(self) -> int:
        """Standard normals a vehicle and step: of its acceleration and turn rate, then of its glances and their
        leaks."""
        return 2 if self.human is None else 4

    @property
    def action_noise_values(self) -> int:
        """Standard normals of a rollout's action noise, glances included: those of each step and vehicle."""
        return self.steps * len(self.vehicles) * self.noise_channels

    @property
    def steps(self) -> int:
        return round(self.time.horizon_s / self.time.step_s)

    @property
    def ego(self) -> int:
        """The row of the ego among the vehicles."""
        return next(i for i, vehicle in enumerate(self.vehicles) if vehicle.role == "ego")

    def of(self, vehicle: Vehicle, key: str) -> Any:
        """A vehicle's own value of `key`, or the one that holds for all."""
        own = getattr(vehicle, key)
        return getattr(self.start, key) if own is None else own
