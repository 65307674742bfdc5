"""What a scenario's camera and weather can get wrong."""

from collections.abc import Callable

from service.world.scenario.schema import CameraSpec, RandomWeather, Scenario

Refuse = Callable[[str, object, str], None]

# the widest values that make sense, and what to give
CAMERA_RANGES: dict[str, tuple[float, float, str]] = {
    "width_px": (8, 4096, "give 8 to 4096 pixels"),
    "height_px": (8, 4096, "give 8 to 4096 pixels"),
    "hfov_deg": (5.0, 150.0, "give an angle of view of 5 to 150 degrees"),
    "x_m": (-20.0, 20.0, "metres ahead of the vehicle's centre, -20 to 20"),
    "y_m": (-5.0, 5.0, "metres to the left of the vehicle's centre, -5 to 5"),
    "z_m": (0.2, 50.0, "metres above the road, 0.2 to 50"),
    "yaw_deg": (-180.0, 180.0, "degrees to the left, -180 to 180"),
    "pitch_deg": (-60.0, 60.0, "degrees up, -60 to 60"),
    "roll_deg": (-45.0, 45.0, "degrees clockwise, -45 to 45"),
    "sensor_noise_levels": (0.0, 100.0, "a standard deviation of 0 to 100 (of 255)"),
}
WEATHER_RANGES: dict[str, tuple[float, float, str]] = {
    "sun_elevation_deg": (-90.0, 90.0, "an elevation lies within -90 to 90 degrees"),
    "sun_azimuth_deg": (-360.0, 360.0, "a compass direction in degrees, -360 to 360"),
    "fog_per_km": (
        0.0,
        500.0,
        "an extinction coefficient of 0 to 500 per km; visibility in km is 3.912 / it",
    ),
    "rain_mmph": (-100.0, 200.0, "millimetres an hour up to 200; 0 and below are dry"),
    "exposure_ev": (-6.0, 6.0, "an error of exposure within 6 stops"),
}
LARGEST_DISTORTION = 2.0


def check_camera(scenario: Scenario, refuse: Refuse) -> None:
    """Call `refuse` with the key, the value and the remedy for the first value that cannot be."""
    camera = scenario.camera
    for key in CameraSpec.__struct_fields__:
        if key in CAMERA_RANGES:
            low, high, remedy = CAMERA_RANGES[key]
            if not low <= getattr(camera, key) <= high:
                refuse(f"camera.{key}", getattr(camera, key), remedy)
    if len(camera.distortion) not in (0, 5):
        refuse(
            "camera.distortion", list(camera.distortion), "give OpenCV's k1, k2, p1, p2 and k3, or nothing"
        )
    for i, value in enumerate(camera.distortion):
        if abs(value) > LARGEST_DISTORTION:
            refuse(
                f"camera.distortion[{i}]", value, f"give -{LARGEST_DISTORTION:g} to {LARGEST_DISTORTION:g}"
            )
    if scenario.weather is None:
        return
    for key in RandomWeather.__struct_fields__:
        low, high, remedy = WEATHER_RANGES[key]
        dist = getattr(scenario.weather, key)
        for end in ("low", "high"):
            if not low <= getattr(dist, end) <= high:
                refuse(f"weather.{key}.{end}", getattr(dist, end), remedy)
