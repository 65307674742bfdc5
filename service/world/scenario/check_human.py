"""What a scenario can get wrong about human drivers and about starts by their lateral speed."""

import math
from collections.abc import Callable

from service.world.scenario.schema import Scenario, Vehicle

MAX_MODES = 20
MAX_WINDOW_STEPS = 1000
# key of the human table: lowest and highest value that makes sense, and what to do
WITHIN = {
    "glances.epsilon": (0.0, 1.0, "a probability lies between 0 and 1; 0: nobody looks away in a conflict"),
    "glances.every_s": (0.5, 1e6, "give the seconds between glances, 0.5 to 1e6"),
    "glances.median_s": (0.05, 10.0, "give the median duration of a glance, 0.05 to 10 s"),
    "glances.sigma": (0.01, 2.0, "give the standard deviation of the durations' logarithm, 0.01 to 2"),
    "glances.long_s": (0.1, 20.0, "give the duration from which a glance is long, 0.1 to 20 s"),
    "noise.acceleration_amplitude": (0.0, 10.0, "give 0 (none) to 10 times what the network answers"),
    "noise.turn_rate_amplitude": (0.0, 10.0, "give 0 (none) to 10 times what the network answers"),
    "noise.acceleration_correlation_s": (0.001, 100.0, "give 0.001 to 100 s"),
    "noise.turn_rate_correlation_s": (0.001, 100.0, "give 0.001 to 100 s"),
    "noise.modes": (0, MAX_MODES, f"give 0 to {MAX_MODES} of each action"),
    "noise.window_s": (0.1, 1000.0, "give 0.1 to 1000 s"),
    "avoidance.ttc_s": (0.0, 60.0, "give 0 (never) to 60 s"),
    "avoidance.required_mps2": (0.05, 100.0, "give 0.05 to 100 m/s^2"),
    "avoidance.hardest_mps2": (0.0, 8.0, "give 0 to 8 m/s^2, what a vehicle can do"),
    "avoidance.jerk_mps3": (0.1, 1000.0, "give 0.1 to 1000 m/s^3"),
    "avoidance.gap_m": (0.0, 100.0, "give 0 to 100 m"),
    "avoidance.gap_closing_s": (0.0, 60.0, "give 0 to 60 s"),
    "reaction.median_s": (0.01, 10.0, "give 0.01 to 10 s; people need about 1 s"),
    "reaction.sigma": (0.001, 2.0, "give the standard deviation of its logarithm, 0.001 to 2"),
}


def check_human(scenario: Scenario, refuse: Callable[[str, object, str], None]) -> None:
    """Refuse values of the human table that cannot be."""
    human = scenario.human
    if human is None:
        return
    for name, (low, high, remedy) in WITHIN.items():
        table, _, key = name.partition(".")
        value = getattr(getattr(human, table), key)
        if not low <= value <= high:
            refuse(f"human.{name}", value, remedy)
    steps = min(human.noise.window_s, scenario.time.horizon_s) / scenario.time.step_s
    if steps < 2 or steps > MAX_WINDOW_STEPS:
        refuse(
            "human.noise.window_s",
            human.noise.window_s,
            f"{steps:g} steps of {scenario.time.step_s:g} s; the modes are of 2 to {MAX_WINDOW_STEPS} steps",
        )
    if human.noise.modes > steps:
        refuse("human.noise.modes", human.noise.modes, f"more than the window's {steps:g} steps")


def check_lateral(scenario: Scenario, refuse: Callable[[str, object, str], None]) -> None:
    """Refuse headings given twice or not at all, and lateral speeds that no vehicle can have."""
    start = scenario.start
    if start.heading_deg is None and start.lateral_mps is None:
        refuse("start.heading_deg", None, "missing; add it, in degrees, or lateral_mps in its place")
    if start.heading_deg is not None and start.lateral_mps is not None:
        refuse(
            "start.lateral_mps", "both", "heading_deg is given too; the one follows from the other: give one"
        )
    other = "lateral_mps" if start.lateral_mps is None else "heading_deg"
    for i, vehicle in enumerate(scenario.vehicles):
        if getattr(vehicle, other) is not None:
            refuse(
                f"vehicles[{i}].{other}",
                "a distribution",
                f"[start] has {scenario.start_names[2]}; give that",
            )
    if start.lateral_mps is None:
        return
    for key, low, high in (("lateral_offset_gain", 0.0, 10.0), ("lateral_full_mps", 0.1, 70.0),
                           ("lateral_speed_power", 0.0, 4.0), ("lateral_steepest_deg", 0.1, 60.0)):  # fmt: skip
        if not low <= getattr(start, key) <= high:
            refuse(f"start.{key}", getattr(start, key), f"give {low:g} to {high:g}")


def steepest(scenario: Scenario, vehicle: Vehicle) -> float:
    """The largest angle to its lane, in radians, that a vehicle can start at."""
    start = scenario.start
    if start.lateral_mps is None:
        heading = scenario.of(vehicle, "heading_deg")
        return math.radians(max(abs(heading.low), abs(heading.high)))
    lateral, offset = scenario.of(vehicle, "lateral_mps"), scenario.of(vehicle, "lane_offset_m")
    speed = scenario.of(vehicle, "speed_mps")
    furthest = max(abs(offset.low), abs(offset.high))
    fastest = max(abs(lateral.low), abs(lateral.high)) * (1.0 + start.lateral_offset_gain * furthest**2)
    # below lateral_full_mps the sine falls with the speed where the power is 1 or more, and rises where it is less
    sines = []
    for v in (speed.low, min(max(start.lateral_full_mps, speed.low), speed.high), speed.high):
        slowed = min(1.0, v / start.lateral_full_mps) ** start.lateral_speed_power
        sines.append(1.0 if v <= 0.0 else fastest * slowed / v)
    if speed.low <= 0.0 and start.lateral_speed_power >= 1.0:
        sines[0] = 0.0
    return min(math.asin(min(max(sines), 1.0)), math.radians(start.lateral_steepest_deg))
