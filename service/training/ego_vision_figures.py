"""The vision ego in figures: its error against the expert, and what becomes of its drives, weather by weather."""

import numpy as np
from scipy.stats import beta

from policies.egos.protocol import EgoPolicy, Observation
from service.training.demonstrator import demonstrated
from service.training.ego_vision_world import VisionWorld
from service.training.expert import Expert
from service.world.camera import Weather
from service.world.sim import step

STEPS = 100  # of a drive of the closed loop: i80-paper-10s
LONG_STEPS = 900
OPEN_LOOP = 300  # moments of the open loop in each weather


def figures(
    world: VisionWorld,
    ego: EgoPolicy,
    expert: Expert,
    weather: Weather,
    drives: int,
    rng: np.random.Generator,
) -> dict:
    """Open- and closed-loop figures in one weather, with n and 95% intervals."""
    states = world.scattered(OPEN_LOOP, rng)
    answers = []
    for k in range(OPEN_LOOP):
        frame = world.camera.render(world.scene, states.poses[k], int(states.own[k]), weather, k)
        answers.append(ego.act(Observation(states.seen[k], 0.0, None, frame)))
    error = np.array(answers) - demonstrated(expert, states.seen[:OPEN_LOOP], states.avoidance[:OPEN_LOOP])
    runs = [world.drive(ego, weather, world.names[0], STEPS, rng) for _ in range(drives)]
    long = [world.drive(ego, weather, world.names[0], LONG_STEPS, rng) for _ in range(max(drives // 10, 1))]
    return {
        "open_loop": {
            "n": OPEN_LOOP,
            "rmse_accel_mps2": round(float(np.sqrt(np.mean(error[:, 0] ** 2))), 4),
            "rmse_turn_rate_radps": round(float(np.sqrt(np.mean(error[:, 1] ** 2))), 5),
        },
        "i80_10s": outcomes(runs),
        "whole_road": outcomes(long),
    }


def outcomes(drives: list) -> dict:
    """Shares of endings and offsets; offsets are those of the lane it is in, after the first two seconds."""
    status = np.array([d.status for d in drives])
    late = [np.abs(d.offset_m[20:]).mean() for d in drives if len(d.offset_m) > 20]
    mean = float(np.mean(late)) if late else float("nan")
    half = 1.96 * float(np.std(late, ddof=1)) / np.sqrt(len(late)) if len(late) > 1 else float("inf")
    return {
        "n": len(drives),
        "off_road": _share(int((status == step.OFF_ROAD).sum()), len(drives)),
        "collision": _share(int((status == step.COLLIDED).sum()), len(drives)),
        "mean_abs_lane_offset_m": {
            "value": round(mean, 4) if late else None,
            "ci95": [round(mean - half, 4), round(mean + half, 4)] if np.isfinite(half) else None,
        },
        "mean_speed_mps": round(float(np.mean([d.speed_mps.mean() for d in drives])), 3),
    }


def _share(events: int, n: int) -> dict:
    """A share with its 95% interval (Clopper and Pearson 1934)."""
    low = 0.0 if events == 0 else float(beta.ppf(0.025, events, n - events + 1))
    high = 1.0 if events == n else float(beta.ppf(0.975, events + 1, n - events))
    return {"value": round(events / n, 5), "events": events, "ci95": [round(low, 5), round(high, 5)]}
