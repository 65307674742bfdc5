"""How well measures tell rollouts that end in a collision of the ego from the others, and how rare hard impacts are.

python -m tests.bench.measures_and_collisions --rollouts 30000      (naive rollouts without SUMO; minutes on one core)
"""

import json
import time

import click
import numpy as np

from ce.interval import clopper_pearson
from ce.streams import Stream
from service.evaluation.job import Problem, make_job
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.measures import IMPACT
from service.world.sim.without_sumo import WithoutSumo

MEASURES = ("ttc", IMPACT)
SPEEDS_MPS = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
SHARE = 0.5  # s: the paper's measure at and below it
BLOCK = 1000


def area_under_curve(f: np.ndarray, positive: np.ndarray) -> float:
    """The chance that a rollout with a collision has the lower f of two; ties count half (Mann and Whitney)."""
    order = np.argsort(f, kind="stable")
    ranks = np.empty(f.size)
    ranks[order] = np.arange(1, f.size + 1)
    for value in np.unique(f[np.isinf(f)]):
        ranks[f == value] = ranks[f == value].mean()
    hits = int(positive.sum())
    others = f.size - hits
    return 1.0 - float(ranks[positive].sum() - hits * (hits + 1) / 2) / (hits * others)


def run(
    scenario_name: str, ego: str, measure: str, rollouts: int, seed: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """f, whether the ego collided, and processor seconds a rollout."""
    scenario = with_measure(load_scenario(scenario_name), measure)
    problem = Problem(make_job(scenario, ego, 0.0, "naive", seed, {"budget": rollouts}))
    world = WithoutSumo(scenario, problem.corridor, problem.drivers, ego)
    stream = Stream(problem.base, problem.stream_seed, "estimate", 0)
    f, collided, spent = np.empty(rollouts), np.zeros(rollouts, bool), 0.0
    for start in range(0, rollouts, BLOCK):
        stop = min(start + BLOCK, rollouts)
        x, noise_seeds = stream.draw(start, stop)
        if start == 0:
            world.run(x[0], int(noise_seeds[0]))  # compiles
        began = time.process_time()
        for i, (row, noise_seed) in enumerate(zip(x, noise_seeds, strict=True)):
            rollout = world.run(row, int(noise_seed))
            f[start + i], collided[start + i] = rollout.f, rollout.outcome == "collision"
        spent += time.process_time() - began
    return f, collided, spent / rollouts


@click.command()
@click.option("--scenario", default="i80-paper-10s", show_default=True)
@click.option("--ego", default="lidar-paper", show_default=True)
@click.option("--rollouts", default=30_000, show_default=True, type=click.IntRange(100))
@click.option("--seed", default=1, show_default=True)
def main(scenario: str, ego: str, rollouts: int, seed: int) -> None:
    """Print one JSON object."""
    found: dict[str, object] = {"scenario": scenario, "ego": ego, "rollouts": rollouts, "seed": seed}
    for measure in MEASURES:
        f, collided, cost_s = run(scenario, ego, measure, rollouts, seed)
        said: dict[str, object] = {
            "collisions": int(collided.sum()),
            "area_under_curve": round(area_under_curve(f, collided), 4),
            "ms_a_rollout": round(1e3 * cost_s, 2),
        }
        if measure == IMPACT:
            assert np.array_equal(collided, f <= 0.0)
            said["p_of_an_impact_at"] = {
                f"{speed:g} m/s or more": _share(int((f <= -speed).sum()), rollouts) for speed in SPEEDS_MPS
            }
            said["impact_speed_quantiles_mps"] = np.round(
                np.quantile(-f[collided], [0.1, 0.5, 0.9, 1.0]), 2
            ).tolist()
            said["least_time_without_contact_s"] = np.round(
                np.quantile(f[~collided], [0.001, 0.01, 0.1]), 3
            ).tolist()
        else:
            below = f <= SHARE
            said[f"at most {SHARE:g} s"] = _share(int(below.sum()), rollouts)
            said["of those a collision"] = int((below & collided).sum())
        found[measure] = said
    click.echo(json.dumps(found, indent=1))


def _share(events: int, rollouts: int) -> dict[str, float]:
    low, high = clopper_pearson(np.array([events]), rollouts, 0.95)
    return {"events": events, "p": events / rollouts, "low": float(low[0]), "high": float(high[0])}


if __name__ == "__main__":
    main()
