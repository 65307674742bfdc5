"""Where a scenario's rare events are: thresholds gamma at which p = P0(f <= gamma) is 1e-2, 1e-3, 1e-4 and 1e-5.

    tailroad train thresholds --scenario i80-paper-10s --ego lidar --ego idm --rollouts 100000 --out DIR

f is the scenario's own measure.

The rollouts are those of `tailroad estimate SCENARIO --ego NAME --method naive --seed S`, with the same starts,
weights and noise, in the same kernels; SUMO, which does not move the vehicles, is left out. Thresholds are order
statistics of f with the binomial 95% interval, which has no lower end where hardly a rollout is left below. Beside them
stands p at one threshold further down, by multilevel splitting with `--splitting` rollouts; its interval has been seen
to miss (deploy/decisions/0014), so thresholds are not read off it. Written to --out: thresholds-SCENARIO.json; with
--card, its contents go into that weights card too. An interrupted run continues after its last finished batch.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import Progress
from scipy.stats import beta as beta_distribution

import ce
from policies.drivers import DriverModel, load_drivers
from policies.egos import Observation, ego_weights, load_ego
from policies.egos.lidar import LidarEgo
from policies.egos.protocol import EgoPolicy
from policies.egos.registry import LIDAR
from service.world.safety.measure import open_monitor
from service.world.scenario import load_scenario
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.scenario.load import digest
from service.world.scenario.measures import measure_kind
from service.world.scenario.schema import Scenario
from service.world.sim import step
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.world import World

PROBABILITIES = (1e-2, 1e-3, 1e-4, 1e-5)
DEEP = 0.75  # splitting's threshold, as a share of the one at p = 2e-4; below 0 the other way round


class Rollouts:
    """The service's rollouts without SUMO: f of (x, noise seed), by the scenario's own measure."""

    def __init__(self, scenario: Scenario, drivers: DriverModel, ego: EgoPolicy):
        self._scenario, self._ego = scenario, ego
        self._world = World.of(scenario, road_of(check_road(scenario, scenario.name)), drivers)
        self._draw = Draw(scenario)
        self._monitor = open_monitor(scenario, len(scenario.vehicles))

    def f(self, x: np.ndarray, seed: int) -> tuple[float, int]:
        """The safety value of a rollout, and how the ego stood at its end (service.world.sim.step)."""
        world, ego, monitor = self._world, self._ego, self._monitor
        seed, happens = self._draw.begin(world, x, seed)
        ego.reset(seed)
        status, smallest = world.observe()
        if monitor is not None:
            monitor.reset()
            monitor.see(world.agents, world.count, smallest)
        seen = Observation(world.observations[world.ego], 0.0, world.agents[world.ego])
        k = 0
        while status == step.RUNNING and k < self._scenario.steps:
            seen.time_s = k * self._scenario.time.step_s
            a, w = ego.act(seen)
            world.advance(float(a), float(w), happens[k])
            status, ttc = world.observe()
            if monitor is not None:
                monitor.see(world.agents, world.count, ttc)
            smallest = min(smallest, ttc)
            k += 1
        return (smallest if monitor is None else monitor.value()), status


def run(
    algorithm: ce.Algorithm, seed: int, rollouts: Rollouts, folder: Path, progress: Progress, label: str
) -> Any:
    """Estimate by `algorithm`; each batch's values are kept in `folder` for a run that goes on."""
    folder.mkdir(parents=True, exist_ok=True)
    outcomes: dict[int, int] = {}
    task = progress.add_task(label, total=None)
    state = algorithm.init(seed)
    done = 0
    while (batch := algorithm.propose(state)) is not None:
        path = folder / f"{batch.phase}-{batch.iteration}-{batch.start}-{batch.stop}.npz"
        if path.is_file():
            stored = np.load(path)
            f, ends = stored["f"], stored["ends"]
        else:
            found = [rollouts.f(x, int(noise)) for x, noise in zip(batch.x, batch.noise, strict=True)]
            f, ends = np.array([one for one, _ in found]), np.array([end for _, end in found])
            np.savez(folder / "part.npz", f=f, ends=ends)
            (folder / "part.npz").replace(path)
        for end, count in zip(*np.unique(ends, return_counts=True), strict=True):
            outcomes[int(end)] = outcomes.get(int(end), 0) + int(count)
        done += len(f)
        progress.update(task, description=f"{label}: {done} rollouts")
        state, _ = algorithm.update(state, batch, f)
    progress.remove_task(task)
    return algorithm.estimate(state), outcomes


def thresholds_of(f: np.ndarray) -> list[dict]:
    """Thresholds at PROBABILITIES from independent values f (n,): order statistics with 95% intervals, whose lower end
    is None where not even the smallest value is surely above it."""
    n, ordered = len(f), np.sort(f)
    found = []
    for p in PROBABILITIES:
        k = round(p * n)
        if k < 1:
            continue
        # ranks whose binomial counts put p into their interval
        low = int(
            np.searchsorted(beta_distribution.ppf(0.975, np.arange(1, 4 * k) + 1, n - np.arange(1, 4 * k)), p)
        )
        high = int(
            np.searchsorted(beta_distribution.ppf(0.025, np.arange(1, 4 * k), n - np.arange(1, 4 * k) + 1), p)
        )
        interval = [round(float(ordered[low - 1]), 4) if low else None, round(float(ordered[high]), 4)]
        found.append(
            {"p": p, "gamma": round(float(ordered[k - 1]), 4), "interval_95": interval, "events": k, "n": n,
             "method": "naive"}
        )  # fmt: skip
    return found


def deep(estimate: Any, gamma: float) -> dict:
    """The probability at a small threshold, by splitting."""
    (p,), (low,), (high,) = (
        getattr(estimate.curve(np.array([gamma])), name) for name in ("p", "low", "high")
    )
    return {
        "gamma": round(gamma, 4), "p": float(p), "interval_95": [float(low), float(high)],
        "n": int(estimate.rollouts), "method": str(estimate.method),
    }  # fmt: skip


def ego_of(name: str, folder: Path | None) -> EgoPolicy:
    """The ego of that name; one with lidar by its weights in `folder`, where one is given."""
    path = ego_weights(name)
    if folder is None or path is None or path.suffix != LIDAR:
        return load_ego(name)
    return LidarEgo(load_drivers(folder / path.name))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="i80-paper-10s")
    parser.add_argument("--ego", action="append", required=True)
    parser.add_argument("--rollouts", type=int, default=100_000)
    parser.add_argument(
        "--splitting", type=int, default=0, help="rollouts of splitting below the smallest threshold"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--card", type=Path, help="a weights card that takes the result too")
    parser.add_argument(
        "--weights", type=Path, help="folder whose drivers and lidar ego take the place of the shipped ones"
    )
    arguments = parser.parse_args()
    scenario = load_scenario(arguments.scenario)
    own = arguments.weights
    drivers = load_drivers(scenario.drivers.weights if own is None else own / "drivers-gail.safetensors")
    base = base_distribution(scenario, drivers)
    result: dict[str, Any] = {
        "scenario": scenario.name, "measure": scenario.safety.measure,
        "unit": measure_kind(scenario.safety.measure).unit,
        "drivers": str(drivers.card.get("name", "")), "seed": arguments.seed,
        "command": f"tailroad train thresholds --scenario {arguments.scenario} "
        + " ".join(f"--ego {name}" for name in arguments.ego)
        + f" --rollouts {arguments.rollouts} --splitting {arguments.splitting} --seed {arguments.seed} --out DIR",
        "egos": {},
    }  # fmt: skip
    with Progress() as progress:
        for name in arguments.ego:
            ego = ego_of(name, own)
            rollouts = Rollouts(scenario, drivers, ego)
            decisive = drivers.mu0.tobytes() + name.encode() + digest(scenario).encode()
            if isinstance(ego, LidarEgo):
                decisive += bytes([ego.kind])
                decisive += b"".join(np.ascontiguousarray(part).tobytes() for part in ego.weights)
            key = hashlib.sha256(decisive).hexdigest()[:12]
            folder = (
                arguments.out
                / f".unfinished-{scenario.name}-{name}-{arguments.seed}-{arguments.rollouts}-{key}"
            )
            naive = ce.algorithm("naive", base, 0.2, ce.NaiveOptions(budget=arguments.rollouts))
            estimate, outcomes = run(naive, arguments.seed, rollouts, folder, progress, name)
            found = {
                "thresholds": thresholds_of(estimate.f),
                "smallest_f": [round(float(v), 4) for v in np.sort(estimate.f)[:10]],
                "outcomes": {_NAMES[end]: count for end, count in sorted(outcomes.items())},
                "rollouts": arguments.rollouts,
            }
            if arguments.splitting:
                highest = float(np.sort(estimate.f)[max(round(2e-4 * arguments.rollouts), 5)])
                gamma = DEEP * highest if highest > 0.0 else highest / DEEP
                splitting = ce.algorithm(
                    "splitting", base, gamma, ce.SplittingOptions(budget=arguments.splitting)
                )
                label = f"{name}, splitting"
                tail, _ = run(splitting, arguments.seed, rollouts, folder / "deep", progress, label)
                found["deep"] = [deep(tail, gamma)]
            result["egos"][name] = found
    arguments.out.mkdir(parents=True, exist_ok=True)
    target = arguments.out / f"thresholds-{scenario.name}.json"
    target.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if arguments.card is not None:
        card = json.loads(arguments.card.read_text(encoding="utf-8"))
        card.setdefault("thresholds", {})[scenario.name] = result
        arguments.card.write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(result["egos"], indent=1))


_NAMES = {
    step.RUNNING: "horizon", step.FINISHED: "finished", step.COLLIDED: "collision", step.OFF_ROAD: "off-road",
    step.REVERSED: "reversing",
}  # fmt: skip


if __name__ == "__main__":
    main()
