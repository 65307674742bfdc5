"""What commonroad-crime and ad-rss answer to questions whose answers are known here, as JSON.

commonroad-crime wants protobuf 3.20.2 and cannot be installed beside tailroad; in an environment of its own:

    python3.11 -m venv other && other/bin/pip install commonroad-crime==0.4.5 ad-rss==5.0.0
    other/bin/python tests/reference/other_measures/ask.py > tests/reference/other_measures/answers.json
    TAILROAD_MEASURES_PYTHON=other/bin/python pytest -m long tests/service/analysis/criticality

`make other-measures` does the first and the last.
"""

import json
import math
from types import SimpleNamespace

import numpy as np
from ad_physics import physics
from ad_rss import rss
from commonroad_crime.utility.solver import solver_wttc

LENGTH_M = 4.5
WIDTH_M = LENGTH_M * math.sqrt(8.0) / 3.0  # its circles have half the length for a radius then
WTTC = ((20.0, 10.0, 8.0), (6.0, -2.0, 11.5), (40.0, 0.0, 3.0), (3.0, 5.0, 8.0))  # gap m, closing m/s, m/s^2
# m/s of the one behind and the one ahead
RSS = ((20.0, 10.0), (15.0, 15.0), (30.0, 0.0), (5.0, 30.0), (25.0, 24.0))


def vehicle(x: float, speed: float) -> SimpleNamespace:
    state = SimpleNamespace(position=np.array([x, 0.0]), velocity=speed, velocity_y=0.0)
    shape = SimpleNamespace(length=LENGTH_M, width=WIDTH_M)
    return SimpleNamespace(obstacle_type=None, obstacle_shape=shape, state_at_time=lambda step: state)


def wttc(gap: float, closing: float, acceleration: float) -> float:
    roots = solver_wttc(vehicle(0.0, 10.0 + closing), vehicle(gap + LENGTH_M, 10.0), 0, acceleration)
    return min(float(np.real(t)) for t in roots if abs(np.imag(t)) < 1e-9 and np.real(t) > 0)


def moving(speed: float) -> rss.core.RelativeObjectState:
    """A vehicle with the accelerations of `service.world.scenario.schema.Rss`; the rest only has to be valid."""
    it = rss.core.RelativeObjectState()
    it.object_type = rss.world.ObjectType.OtherVehicle
    dynamics = it.dynamics
    dynamics.response_time = physics.Duration(1.0)
    dynamics.alpha_lon.accel_max = physics.Acceleration(3.5)
    dynamics.alpha_lon.brake_min = dynamics.alpha_lon.brake_min_correct = physics.Acceleration(-4.0)
    dynamics.alpha_lon.brake_max = physics.Acceleration(-8.0)
    dynamics.alpha_lat.accel_max, dynamics.alpha_lat.brake_min = (
        physics.Acceleration(0.2),
        physics.Acceleration(-0.8),
    )
    dynamics.max_speed_on_acceleration = physics.Speed(100.0)
    dynamics.lateral_fluctuation_margin = dynamics.min_longitudinal_safety_distance = physics.Distance(0.0)
    open_space = dynamics.unstructured_settings
    open_space.pedestrian_turning_radius, open_space.vehicle_min_radius = (
        physics.Distance(2.0),
        physics.Distance(3.5),
    )
    open_space.drive_away_max_angle = physics.Angle(2.4)
    open_space.vehicle_yaw_rate_change = physics.AngularAcceleration(0.3)
    open_space.vehicle_trajectory_calculation_step = physics.Duration(0.2)
    place = it.unstructured_object_state
    place.yaw = place.steering_angle = physics.Angle(0.0)
    place.yaw_rate = physics.AngularVelocity(0.0)
    place.dimension.length, place.dimension.width = physics.Distance(4.5), physics.Distance(1.8)
    place.center_point.x = place.center_point.y = physics.Distance(0.0)
    place.speed_range.minimum = place.speed_range.maximum = physics.Speed(speed)
    lane = it.structured_object_state
    lane.distance_to_enter_intersection = physics.Distance(0.0)
    lane.distance_to_leave_intersection = physics.Distance(1000.0)
    lane.velocity.speed_lon_min = lane.velocity.speed_lon_max = physics.Speed(speed)
    lane.velocity.speed_lat_min = lane.velocity.speed_lat_max = physics.Speed(0.0)
    return it


def safe_distance(rear: float, front: float) -> float:
    found = physics.Distance(0.0)
    ask = rss.structured.calculateSafeLongitudinalDistanceSameDirection
    assert ask(moving(front), moving(rear), found)
    return round(float(found.mDistance), 9)


if __name__ == "__main__":
    answers = {
        "wttc": [[*case, round(wttc(*case), 9)] for case in WTTC],
        "safe_distance_along": [[*case, safe_distance(*case)] for case in RSS],
    }
    print(json.dumps(answers, indent=1))
