"""Egos on the same dangerous draws: those in which a compiled ego comes close to a contact.

    python -m tests.bench.dangerous_draws --ego vision --ego vision-paper --ego lidar [--ego PATH.onnx]

Camera egos cost a hundred times what a compiled one does, and contacts come once in 10^4 rollouts and more, too rare
to count. So naive rollouts of --by (seed as of `tailroad estimate`) are driven without SUMO, and every ego drives those
of its draws again in which f was at most --near. Contacts among them say which ego is better where it is difficult;
they are no rates: an ego has contacts elsewhere, too, of which --others of the remaining draws give a glimpse.
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np
from scipy.stats import beta

import ce
from policies.egos.vision import VisionEgo
from service.evaluation.job import Problem, make_job
from service.world.scenario import load_scenario
from service.world.scenario.schema import Scenario
from service.world.sim.rollout import Rollout, Simulator
from service.world.sim.without_sumo import WithoutSumo

LEVELS_S = (1.0, 2.0, 3.0, 4.0)


def chosen(scenario: Scenario, by: str, rollouts: int, seed: int, near: float) -> np.ndarray:
    """Rows of the draws in which f of the ego `by` is at most `near`."""
    problem = Problem(make_job(scenario, by, 0.0, "naive", seed, {}))
    alone = WithoutSumo(scenario, problem.corridor, problem.drivers, by)
    found = []
    for first in range(0, rollouts, 500):
        x, seeds = ce.draw(problem.base, seed, "estimate", 0, first, min(first + 500, rollouts))
        found += [first + i for i in range(len(x)) if alone.run(x[i], int(seeds[i])).f <= near]
    return np.array(found, dtype=np.int64)


def driven(scenario: Scenario, ego: str, seed: int, rows: np.ndarray) -> list[Rollout]:
    """The rollouts of these rows with an ego, by name or the weights of a vision ego."""
    own = ego if not ego.endswith(".onnx") else "vision"
    problem = Problem(make_job(scenario, own, 0.0, "naive", seed, {}))
    policy = VisionEgo(Path(ego)) if ego.endswith(".onnx") else problem.ego()
    told = []
    with problem.simulator(ego=policy) as simulator:
        assert isinstance(simulator, Simulator)
        for row in rows.tolist():
            x, seeds = ce.draw(problem.base, seed, "estimate", 0, row, row + 1)
            told.append(simulator.run(x[0], int(seeds[0])))
    return told


def facts(rollouts: list[Rollout]) -> dict[str, object]:
    n = len(rollouts)
    contacts = [r.contact for r in rollouts if r.contact is not None]
    f = np.array([r.f for r in rollouts])
    k = len(contacts)
    return {
        "n": n,
        "contacts": k,
        "share": [0.0 if k == 0 else float(beta.ppf(0.025, k, n - k + 1)),
                  1.0 if k == n else float(beta.ppf(0.975, k + 1, n - k))],
        "runs_into_the_other": sum(c.striking == "ego" for c in contacts),
        "fastest_mps": max((c.speed_mps for c in contacts), default=None),
        "off_road": sum(r.outcome == "off-road" for r in rollouts),
        "failed": sum(math.isnan(r.f) for r in rollouts),
        "f": [round(float(value), 2) if value < 100.0 else None for value in f],
        **{f"f at most {level:g} s": int((f <= level).sum()) for level in LEVELS_S},
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="i80-10s", help="[i80-10s]")
    parser.add_argument(
        "--ego", action="append", required=True, help="name, or .onnx weights of a vision ego"
    )
    parser.add_argument(
        "--by", default="lidar-paper", help="compiled ego that chooses the draws [lidar-paper]"
    )
    parser.add_argument("--rollouts", type=int, default=40_000, help="of it [40000]")
    parser.add_argument("--near", type=float, default=3.0, help="f of it at most, s [3]")
    parser.add_argument("--most", type=int, default=1_000, help="of these draws, the first [1000]")
    parser.add_argument("--others", type=int, default=0, help="of the first remaining draws, too [0]")
    parser.add_argument("--seed", type=int, default=2, help="[2]")
    a = parser.parse_args()
    scenario = load_scenario(a.scenario)
    rows = chosen(scenario, a.by, a.rollouts, a.seed, a.near)
    rest = np.setdiff1d(np.arange(a.rollouts), rows)[: a.others]
    print(
        json.dumps({"dangerous draws": rows.size, "of": a.rollouts, "driven": rows[: a.most].size}),
        flush=True,
    )
    for ego in a.ego:
        told = {"ego": ego, "on dangerous draws": facts(driven(scenario, ego, a.seed, rows[: a.most]))}
        if rest.size:
            told["on others"] = facts(driven(scenario, ego, a.seed, rest))
        print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
