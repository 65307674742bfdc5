"""How well drivers drive: on the whole road from the scenario's starts, and against held-out recorded vehicles."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import beta as beta_distribution
from scipy.stats import chi2

from policies import layout as O
from policies.data.scenes import Scene
from service.training.demonstrations import held_out_vehicles
from service.training.world import (
    DT_S,
    T_ACCELERATION,
    T_ACTIVE,
    T_COLLISION,
    T_LANE,
    T_LANE_OFFSET_M,
    T_OFF_ROAD,
    T_OFFSET_M,
    T_SPEED_MPS,
    T_STATION_M,
    T_X_M,
    T_Y_M,
    Network,
    rollout,
    standard_starts,
)
from service.world import agents as A
from service.world.sim.projection import place
from service.world.sim.road import Road, scene_road

HARD_BRAKE_MPS2 = -3.0
MINIMUM_VEHICLES = 5  # horizons with fewer held-out drivers are not reported


def share(count: int, n: int) -> dict:
    """A share with its 95% Clopper-Pearson interval."""
    low = 0.0 if count == 0 else float(beta_distribution.ppf(0.025, count, n - count + 1))
    high = 1.0 if count == n else float(beta_distribution.ppf(0.975, count + 1, n - count))
    interval = [round(low, 6), round(high, 6)]
    return {"value": round(count / n, 6), "count": int(count), "n": int(n), "interval_95": interval}


def rate(count: int, km: float) -> dict[str, Any]:
    """Events per million km with the 95% interval of a Poisson count (Garwood 1936)."""
    low = 0.0 if count == 0 else 0.5 * float(chi2.ppf(0.025, 2 * count))
    high = 0.5 * float(chi2.ppf(0.975, 2 * count + 2))
    interval = [round(low / km * 1e6, 1), round(high / km * 1e6, 1)]
    return {"per_million_km": round(count / km * 1e6, 1), "count": count, "interval_95": interval}


def whole_road(
    draw: Callable[[np.random.Generator], Network],
    road: Road,
    rollouts: int,
    rng: np.random.Generator,
    *,
    ego: Network | None = None,
    seconds: float = 200.0,
    tick: Callable[[], None] = lambda: None,
) -> dict:
    """Rollouts of the i80 scenario's starts without SUMO; `draw(rng)` gives a rollout's drivers.

    With `ego`, lane 3 is driven by its mean action and the figures are the ego's; otherwise all six vehicles are
    drivers and the figures are theirs.
    """
    steps = round(seconds / DT_S)
    n = off = hit = finished = changes = hard = moving = 0
    km, speeds, wander, ends, ttc_min, reach = 0.0, [], [], [], [], []
    for _ in range(rollouts):
        drivers = draw(rng)
        agents = standard_starts(rng, road)
        noise = rng.standard_normal((steps, 6, 2))
        _, trace, ttc = rollout(
            agents, road, steps, drivers, noise, ego=2 if ego is not None else -1, ego_network=ego
        )
        ttc_min.append(float(ttc.min()))
        for v in [2] if ego is not None else range(6):
            on = trace[:, v, T_ACTIVE] > 0
            bad = on & (trace[:, v, T_OFF_ROAD] + trace[:, v, T_COLLISION] > 0)
            first = int(np.argmax(bad)) if bad.any() else len(on)
            left = bool(bad.any() and trace[first, v, T_OFF_ROAD] > 0)
            own = trace[:first, v][on[:first]]
            n += 1
            off += left
            hit += bool(bad.any() and not left)
            reached = own[-1, T_STATION_M] > road.length_m - 8.0
            finished += bool(reached and not bad.any())
            reach.append(own[-1, T_STATION_M])
            lane = own[:, T_LANE]
            changes += int((np.diff(lane) != 0).sum())
            km += float(own[-1, T_STATION_M] - own[0, T_STATION_M]) / 1000.0
            speeds.append(float(own[:, T_SPEED_MPS].mean()))
            ends.append(float(own[-1, T_SPEED_MPS]))
            hard += int((own[:, T_ACCELERATION] <= HARD_BRAKE_MPS2).sum())
            moving += len(own)
            values, counts = np.unique(lane, return_counts=True)
            keep = own[lane == values[counts.argmax()], T_LANE_OFFSET_M]
            if len(keep) > 100:
                wander.append(float(keep.std()))
        tick()
    result = {
        "rollouts": rollouts,
        "finished_without_leaving_the_road_or_hitting": share(finished, n),
        "left_the_road": share(off, n),
        "collided": share(hit, n),
        "mean_speed_mps": round(float(np.mean(speeds)), 3),
        "speed_at_the_end_mps_mean_sd": [round(float(np.mean(ends)), 3), round(float(np.std(ends)), 3)],
        "lane_changes_per_vehicle_km": round(changes / km, 4),
        "lateral_wander_sd_m_median": round(float(np.median(wander)), 4),
        "hard_brake_share_of_steps": round(hard / moving, 6),
        "vehicle_km": round(km, 1),
    }
    if ego is not None:
        result["minimum_ttc_s_quantiles_0.1_1_10_50"] = [
            round(float(q), 3) for q in np.quantile(ttc_min, [0.001, 0.01, 0.1, 0.5])
        ]
    return result


def nll(network: Network, features: np.ndarray, action: np.ndarray) -> np.ndarray:
    """Negative log likelihood (n, 2) of accelerations and turn rates (n, 2) m/s^2, rad/s, in scaled units."""
    outputs = np.column_stack([features, np.ones(len(features))]) @ network.head.reshape(-1, O.OUTPUTS)
    log_std = np.clip(outputs[:, 2:], O.LOG_STD_MIN, O.LOG_STD_MAX)
    z = (action / network.action_scale - outputs[:, :2]) * np.exp(-log_std)
    return 0.5 * z**2 + log_std + 0.5 * np.log(2.0 * np.pi)


def held_out_windows(scenes: list[Scene], seconds: float, every_s: float = 5.0) -> list[tuple[int, int, int]]:
    """(scene, vehicle, first frame) of windows in which a held-out vehicle is there all the time."""
    steps, stride = round(seconds / DT_S), round(every_s / DT_S)
    windows = []
    for number, scene in enumerate(scenes):
        for v in np.flatnonzero(held_out_vehicles(scene)):
            start = 0
            while start + steps < len(scene.frame):
                if scene.usable[start, v] and scene.present[start : start + steps + 1, v].all():
                    windows.append((number, int(v), start))
                    start += stride
                else:
                    start += 5
    return windows


def closed_loop(
    draw: Callable[[np.random.Generator], Network],
    scenes: list[Scene],
    horizons_s: tuple[float, ...],
    rng: np.random.Generator,
    *,
    samples: int = 2,
    ego: bool = False,
) -> dict:
    """Drive held-out vehicles from their recorded states, the others replayed; errors at each horizon.

    Root mean squares over windows and samples; beside them constant velocity (along the lane). Windows differ between
    horizons: each needs its own length of recording. Intervals: bootstrap over vehicles.
    """
    roads = [scene_road(scene.road) for scene in scenes]
    result = {}
    for horizon in horizons_s:
        steps = round(horizon / DT_S)
        errors, straight, owner = [], [], []
        events = np.zeros(4)
        for number, v, start in held_out_windows(scenes, horizon):
            scene, road = scenes[number], roads[number]
            others = np.flatnonzero(scene.present[start : start + steps + 1].any(axis=0))
            others = others[others != v]
            state = np.stack([scene.x, scene.y, scene.heading, scene.speed], axis=-1)
            replay = np.ascontiguousarray(state[start : start + steps + 1, others])
            target = state[start + steps, v]
            for _ in range(samples):
                agents = np.zeros((1 + len(others), A.COLUMNS))
                agents[0, A.X_M : A.SPEED_MPS + 1] = state[start, v]
                agents[0, A.STATION] = max(round(scene.station[start, v]), 0)
                agents[1:, A.LENGTH_M], agents[1:, A.WIDTH_M] = scene.length_m[others], scene.width_m[others]
                agents[0, A.LENGTH_M], agents[0, A.WIDTH_M] = scene.length_m[v], scene.width_m[v]
                agents[0, A.ACTIVE] = 1.0
                noise = rng.standard_normal((steps, 1, 2)) * (0.0 if ego else 1.0)
                _, trace, _ = rollout(agents, road, steps, draw(rng), noise, controlled=1, replay=replay)
                own = trace[trace[:, 0, T_ACTIVE] > 0, 0]
                last = own[-1]
                errors.append(
                    [
                        np.hypot(last[T_X_M] - target[0], last[T_Y_M] - target[1]),
                        last[T_SPEED_MPS] - target[3],
                        last[T_OFFSET_M] - scene.lateral[start + steps, v],
                    ]
                )
                owner.append((number, v))
                events += [
                    len(own),
                    (own[:-1, T_ACCELERATION] <= HARD_BRAKE_MPS2).sum(),
                    (own[:, T_OFF_ROAD] > 0).sum(),
                    (own[:, T_COLLISION] > 0).sum(),
                ]
            ds = scene.speed[start, v] * horizon - (scene.station[start + steps, v] - scene.station[start, v])
            dd = scene.lateral[start, v] - scene.lateral[start + steps, v]
            straight.append([np.hypot(ds, dd), scene.speed[start, v] - target[3], dd])
        if len(set(owner)) < MINIMUM_VEHICLES:
            continue
        error, still = np.array(errors), np.array(straight)
        vehicles, index = np.unique(np.array(owner), axis=0, return_inverse=True)
        result[f"{horizon:g}s"] = {
            "windows": len(straight),
            "vehicles": len(vehicles),
            "rmse_position_m": _rmse(error[:, 0], index.ravel(), rng),
            "rmse_speed_mps": _rmse(error[:, 1], index.ravel(), rng),
            "rmse_lateral_m": _rmse(error[:, 2], index.ravel(), rng),
            "constant_velocity": [round(float(x), 3) for x in np.sqrt((still**2).mean(axis=0))],
            "hard_brake_share": round(events[1] / events[0], 5),
            "off_road_share": round(events[2] / events[0], 5),
            "collision_share": round(events[3] / events[0], 5),
        }
    return result


def _rmse(error: np.ndarray, vehicle: np.ndarray, rng: np.random.Generator, resamples: int = 200) -> dict:
    """Root mean square with a bootstrap interval over vehicles."""
    total = np.bincount(vehicle, weights=error**2)
    count = np.bincount(vehicle)
    picks = rng.integers(0, len(count), (resamples, len(count)))
    spread = np.sqrt(total[picks].sum(axis=1) / count[picks].sum(axis=1))
    low, high = np.quantile(spread, [0.025, 0.975])
    return {
        "value": round(float(np.sqrt(total.sum() / count.sum())), 3),
        "interval_95": [round(float(low), 3), round(float(high), 3)],
    }


def brakes_for_leader(network: Network, road: Road, rng: np.random.Generator, cases: int = 60) -> dict:
    """A driver behind a slower vehicle in its lane: share of rear-end collisions in 20 s, and the closest gap."""
    hits, gaps, changed = 0, [], 0
    for _ in range(cases):
        agents = standard_starts(rng, road, vehicles=2)
        own_speed = rng.uniform(10.0, 20.0)
        slower = rng.uniform(0.5, 0.9) * own_speed
        _place_pair(agents, road, own_speed, slower, rng.uniform(25.0, 60.0))
        leader = agents[1]
        steps = 200
        t = np.arange(steps + 1) * DT_S
        replay = np.zeros((steps + 1, 1, 4))
        station = leader[A.STATION] * road.spacing_m + slower * t
        k = np.clip(np.round(station).astype(int), 0, len(road.reference) - 1)
        centre = 0.5 * road.lanes[k, 2, :2].sum(axis=1)
        stations = np.arange(len(road.reference)) * road.spacing_m
        x, y, heading = (np.interp(station, stations, road.reference[:, c]) for c in range(3))
        replay[:, 0, 0] = x - centre * np.sin(heading)
        replay[:, 0, 1] = y + centre * np.cos(heading)
        replay[:, 0, 2], replay[:, 0, 3] = heading, slower
        noise = rng.standard_normal((steps, 1, 2))
        _, trace, _ = rollout(agents, road, steps, network, noise, controlled=1, replay=replay)
        own = trace[:, 0]
        hits += bool((own[:, T_COLLISION] > 0).any())
        changed += bool((own[:, T_LANE] != 2).any())
        gaps.append(float((station[: len(own)] - own[:, T_STATION_M]).min() - 4.5))
    return {
        "rear_end_collisions": share(hits, cases),
        "left_the_lane": share(changed, cases),
        "closest_gap_m_quantiles_5_50_95": [round(float(q), 2) for q in np.quantile(gaps, [0.05, 0.5, 0.95])],
    }


def _place_pair(agents: np.ndarray, road: Road, own_speed: float, slower: float, gap_m: float) -> None:
    """Both in lane 3, the second `gap_m` (bumper to bumper) ahead."""
    for row, station in ((0, 120.0), (1, float(round(120.0 + gap_m + 4.5)))):
        place(agents[row], station, 2, 0.0, 0.0, road.reference, road.lanes, road.spacing_m)
        agents[row, A.STATION] = round(station)
    agents[0, A.SPEED_MPS], agents[1, A.SPEED_MPS] = own_speed, slower
    agents[:, A.LENGTH_M], agents[:, A.WIDTH_M] = 4.5, 1.8
