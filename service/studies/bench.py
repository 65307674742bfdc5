"""How fast the world is, measured beside the least that SUMO takes for the same vehicles and steps.

Rollouts are measured in SUMO, and where scenario and ego allow it as an estimate runs them: as one compiled call, a
share repeated in SUMO (`service.world.sim.audited`). The floor is the bare libsumo loop: the same moveToXY and
simulationStep calls with the same arguments, replayed from recorded rollouts in the same process, in turns with them,
so that a busy machine slows both.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import ce
from policies import layout
from policies.egos import Observation, load_ego
from policies.network import forward
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.pool import LocalPool, RolloutWorld, Work, run_chunk
from service.world.safety.ttc import ego_time_to_collision
from service.world.scenario.schema import Scenario
from service.world.sensors.lidar import beam_directions
from service.world.sim.audited import Audited
from service.world.sim.step import advance_all, observe
from service.world.sim.without_sumo import WithoutSumo, can_leave_out_sumo
from service.world.sim.world import World, action_noise

REPEATS = 2000  # of a kernel when it is timed alone


@dataclass
class _Poses:
    """Remembers where SUMO was asked to place the vehicles."""

    steps: list[np.ndarray] = field(default_factory=list)
    states: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None:
        self.steps.append(world.poses.copy())
        if len(self.states) < 1 and len(self.steps) > 20:
            self.states.append((world.agents.copy(), world.observations.copy()))


def _draws(problem: Problem, rollouts: int) -> tuple[np.ndarray, np.ndarray]:
    return ce.draw(problem.base, problem.job.seed, "estimate", 0, 0, rollouts)


def speed(scenario: Scenario, ego: str, rollouts: int, rounds: int = 5) -> dict[str, Any]:
    """One ego on one core: rollouts/s, x real time, and the ratio to the bare SUMO loop; medians over `rounds`.

    `x_realtime_of_processor` counts the time that this process was given: what a core to itself would do. These are of
    rollouts in SUMO; `ways` has those of each way there is, "sumo" and "compiled", with the share that SUMO drove.
    """
    problem = Problem(make_job(scenario, ego, 0.0, "naive", 1, {}))
    x, noise_seeds = _draws(problem, rollouts)
    with problem.simulator() as simulator:
        recordings = []
        for row, seed in zip(x, noise_seeds, strict=True):
            poses = _Poses()
            simulator.run(row, int(seed), poses)
            recordings.append(poses.steps)
        ways: dict[str, RolloutWorld] = {"sumo": simulator}
        if can_leave_out_sumo(scenario, ego):
            alone = WithoutSumo(scenario, problem.corridor, problem.drivers, ego)
            ways["compiled"] = Audited(alone, lambda: simulator, problem.job.gamma)
            run_chunk(ways["compiled"], Work(0, x[:5], noise_seeds[:5]))  # which compiles it
        walls: dict[str, list[float]] = {way: [] for way in ways}
        processor: dict[str, list[float]] = {way: [] for way in ways}
        bare, in_sumo = [], dict.fromkeys(ways, 0)
        steps = sum(len(r) - 1 for r in recordings)
        for _ in range(rounds):
            for way, world in ways.items():
                began, worked = time.perf_counter(), time.process_time()
                in_sumo[way] += run_chunk(world, Work(0, x, noise_seeds)).in_sumo or 0
                walls[way].append(time.perf_counter() - began)
                processor[way].append(time.process_time() - worked)
            sumo = simulator._sumo
            began = time.perf_counter()
            for recording in recordings:
                sumo.begin(recording[0], 0)
                for placed in recording[1:]:
                    sumo.step(placed)
            bare.append(time.perf_counter() - began)
    full, busy = walls["sumo"], processor["sumo"]
    sim_s = steps * scenario.time.step_s
    ratio = float(np.median(np.array(full) / np.array(bare)))
    return {
        "rollouts_per_s": rollouts / float(np.median(full)),
        "x_realtime": sim_s / float(np.median(full)),
        "x_realtime_best": sim_s / float(np.min(full)),
        "x_realtime_of_processor": sim_s / float(np.median(busy)),
        "us_per_step": float(np.median(full)) / steps * 1e6,
        "bare_us_per_step": float(np.median(bare)) / steps * 1e6,
        "bare_x_realtime": sim_s / float(np.median(bare)),
        "ratio_to_bare": ratio,
        "ways": {
            way: {
                "wall_us_per_step": float(np.median(walls[way])) / steps * 1e6,
                "processor_us_per_step": float(np.median(processor[way])) / steps * 1e6,
                "processor_ms_per_rollout": float(np.median(processor[way])) / rollouts * 1e3,
                "share_in_sumo": in_sumo[way] / (rollouts * rounds),
            }
            for way in ways
        },
    }


def parts(scenario: Scenario, ego: str, measured: dict[str, Any]) -> dict[str, float]:
    """Time of a step by part in us: SUMO from the bare loop, the kernels timed alone, and the rest."""
    problem = Problem(make_job(scenario, ego, 0.0, "naive", 1, {}))
    x, noise_seeds = _draws(problem, 1)
    with problem.simulator() as simulator:
        recorder = _Poses()
        simulator.run(x[0], int(noise_seeds[0]), recorder)
        world, camera = simulator._world, simulator._camera
    agents, observations = recorder.states[0] if recorder.states else (world.agents, world.observations)
    road, net = world.road, problem.drivers
    head = problem.drivers.mu0.astype(np.float32)
    outputs = np.empty(layout.OUTPUTS, np.float32)
    beams, rays = beam_directions(layout.BEAMS), beam_directions(scenario.safety.rays)
    ranges, rates = np.empty(len(rays)), np.empty(len(rays))
    n, own = world.vehicles, world.ego
    policy = load_ego(ego)
    seen = Observation(observations[own], 0.0)
    looking_on = 0.0
    if camera is not None:
        camera.begin(x[0], 1)
        seen.frame = camera.picture(agents, n, own, 0)
        looking_on = _time(lambda: camera.picture(agents, n, own, 0), REPEATS // 10)
    moving = agents.copy()
    normals = np.zeros((n, 2))

    def step_all() -> None:
        advance_all(moving, n, own, 0.0, 0.0, observations, net.w1, net.b1, net.w2, net.b2, head, net.action_scale,
                    normals, scenario.time.step_s, road.lanes.shape[1], world.poses)  # fmt: skip

    looking = _time(
        lambda: observe(
            agents, n, n, own, road.reference, road.lanes, road.spacing_m, beams, rays, observations
        )
    )
    safety = _time(lambda: ego_time_to_collision(agents, n, own, rays, ranges, rates))
    network = _time(lambda: forward(observations[1], net.w1, net.b1, net.w2, net.b2, head, outputs))
    acting = _time(lambda: policy.act(seen), REPEATS if camera is None else REPEATS // 10)
    moved = _time(step_all)
    drivers = (n - 1) * network
    result = {
        "sumo": measured["bare_us_per_step"],
        "observation": max(looking - safety, 0.0),
        "camera": looking_on,
        "policies": drivers + acting,
        "dynamics": max(moved - drivers, 0.0),
        "safety": safety,
    }
    result["noise"] = _time(lambda: action_noise(1, 100, n), 50) / 100
    result["rest"] = measured["us_per_step"] - sum(result.values())
    return result


def _time(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Microseconds a call, the median of five batches."""
    call()
    batches = []
    for _ in range(5):
        began = time.perf_counter()
        for _ in range(repeats // 5):
            call()
        batches.append((time.perf_counter() - began) / (repeats // 5))
    return float(np.median(batches)) * 1e6


def scaling(scenario: Scenario, ego: str, rollouts: int, counts: list[int]) -> list[dict[str, float]]:
    """Rollouts/s and efficiency of local pools with these numbers of workers; the first is the yardstick."""
    job: Job = make_job(scenario, ego, 0.0, "naive", 1, {})
    problem = Problem(job)
    rows: list[dict[str, float]] = []
    for workers in counts:
        x, noise_seeds = _draws(problem, rollouts * workers)
        size = 50
        chunks = [Work(i, x[i : i + size], noise_seeds[i : i + size]) for i in range(0, len(x), size)]
        with LocalPool(job, workers) as pool:
            # all workers up and compiled
            for _ in pool.run([Work(0, x[:10], noise_seeds[:10])] * (4 * workers)):
                pass
            began = time.perf_counter()
            for _ in pool.run(chunks):
                pass
            rate = len(x) / (time.perf_counter() - began)
        first = rows[0]["rollouts_per_s"] / rows[0]["workers"] if rows else rate / workers
        rows.append({"workers": workers, "rollouts_per_s": rate, "efficiency": rate / workers / first})
    return rows


def memory(scenario: Scenario, ego: str, rollouts: int) -> dict[str, float]:
    """Resident memory (MB) of one worker after a first 200 rollouts and after `rollouts`."""
    job = make_job(scenario, ego, 0.0, "naive", 1, {})
    x, noise_seeds = _draws(Problem(job), min(rollouts, 1000))
    with LocalPool(job, 1) as pool:
        for _ in pool.run([Work(0, x[:200], noise_seeds[:200])]):
            pass
        (pid,) = pool.pids()
        before = _resident_mb(pid)
        done = 200
        while done < rollouts:
            for _ in pool.run([Work(0, x[:200], noise_seeds[:200])]):
                pass
            done += 200
        return {"rollouts": done, "after_200_mb": before, "after_all_mb": _resident_mb(pid)}


def _resident_mb(pid: int) -> float:
    with open(f"/proc/{pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
