"""What paths are worth on the highway: runs of several seeds about a naive truth, training counted, per simulated step.

    python tests/bench/highway_paths.py run --scenario i80-paper-10s --ego lidar-paper --gamma 0.48 --seeds 1-5 \
        --out build/paths.jsonl
    python tests/bench/highway_paths.py tell --out build/paths.jsonl --truth deploy/results/truths/...npz

`run --committor shipped` starts from the committor that comes with tailroad; without it one is trained in every run.
`run` adds a line a seed and leaves out those that are there, so that it can be cut off and go on. `tell` prints, of
each question, the efficiency p (1 - p) / n / mean squared error about the truth, n the naive rollouts of as many
steps, with an interval of the mean squared error by chi-squared, and how many intervals held the truth. The truth's
own error is in the mean squared error, and stands beside it.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from scipy.special import chdtri

from ce.paths import PathOptions, PathSampling, drive
from service.analysis.run.committors import committor_for
from service.evaluation.job import Problem, make_job
from service.evaluation.options import PATHS
from service.studies.reproduce.truth import read_truth
from service.world.scenario import load_scenario


def run_seed(asked: argparse.Namespace, seed: int) -> dict[str, object]:
    """One run in this process."""
    options = {"budget": asked.budget}
    job = make_job(load_scenario(asked.scenario), asked.ego, asked.gamma, PATHS, seed, options)
    problem = Problem(job)
    given = None
    if asked.committor != "own":
        found = committor_for(None if asked.committor == "shipped" else asked.committor, job.scenario)
        assert found is not None, f"no committor comes with tailroad for {asked.scenario}"
        given = found[0]
    method = PathSampling(problem.paths, job.gamma, PathOptions(**options), given)
    state, began = method.init(problem.stream_seed), time.process_time()
    while (batch := method.propose(state)) is not None:
        driven = drive(
            problem.paths,
            batch.roots,
            batch.levels,
            method.checkpoints,
            batch.plan,
            method.committor(state),
            batch.record,
        )
        state, _ = method.update(state, batch, driven)
    e = method.estimate(state)
    return {
        "scenario": asked.scenario,
        "ego": asked.ego,
        "ego_sha256": job.ego_sha256,
        "gamma": asked.gamma,
        "budget": asked.budget,
        "committor": asked.committor,
        "seed": seed,
        "p": e.p,
        "std_error": e.std_error,
        "ci": list(e.ci),
        "events": e.events,
        "steps": e.cost.steps,
        "training_steps": e.cost.training_steps,
        "begun": e.cost.begun,
        "path_steps": e.cost.path_steps,
        "aim": state.aim,
        "warnings": [w.name for w in e.warnings],
        "cpu_s": time.process_time() - began,
    }


def tell(lines: list[dict], truth: Path | None, p: float | None, events: int) -> None:
    """Print a line for each question."""
    questions = sorted({_asked_in(line) for line in lines})
    for question in questions:
        mine = [line for line in lines if _asked_in(line) == question]
        known, n_events = p, events
        if truth is not None:
            kept = read_truth(truth)
            n = sum(stop - start for start, stop in kept.ran.ranges)
            n_events = int((kept.f <= question[2]).sum())
            known = n_events / n
        if not known:
            print(question, "no truth")
            continue
        found = np.array([line["p"] for line in mine])
        mse = float(np.mean((found - known) ** 2))
        cost = float(np.mean([line["steps"] / line["path_steps"] for line in mine]))
        begun = float(np.mean([line["begun"] for line in mine]))
        held = sum(line["ci"][0] <= known <= line["ci"][1] for line in mine)
        k = len(mine)
        low, high = chdtri(k, 0.975) / k, chdtri(k, 0.025) / k
        worth = known * (1 - known) / cost / mse
        own = known / n_events**0.5 if n_events else float("nan")
        print(f"{question}: {k} seeds of {cost:.0f} rollouts' worth, {begun:.0f} paths begun")
        print(
            f"  truth {known:.3g} +- {own:.1g}, mean {found.mean():.3g}, rms error {mse**0.5:.2g}, held {held}/{k}"
        )
        print(f"  efficiency by steps {worth:.1f} ({worth * low:.1f} to {worth * high:.1f})")
        print(
            f"  efficiency by paths begun {worth * cost / begun:.1f}; cpu {_mean(mine, 'cpu_s'):.0f} s a seed"
        )


def _asked_in(line: dict) -> tuple[str, str, float, int, str]:
    names = ("scenario", "ego", "gamma", "budget", "committor")
    return tuple(line.get(name, "own") for name in names)


def _mean(lines: list[dict], name: str) -> float:
    return float(np.mean([line[name] for line in lines]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("run", "tell"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scenario", default="i80-paper-10s")
    parser.add_argument("--ego", default="lidar-paper")
    parser.add_argument("--gamma", type=float, default=0.48)
    parser.add_argument("--budget", type=int, default=20_000)
    parser.add_argument("--seeds", default="1-5")
    parser.add_argument("--committor", default="own")
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--p", type=float)
    parser.add_argument("--events", type=int, default=0)
    asked = parser.parse_args()
    lines = [json.loads(line) for line in asked.out.read_text().splitlines()] if asked.out.exists() else []
    if asked.what == "tell":
        tell(lines, asked.truth, asked.p, asked.events)
        return
    first, _, last = asked.seeds.partition("-")
    for seed in range(int(first), int(last or first) + 1):
        key = (asked.scenario, asked.ego, asked.gamma, asked.budget, asked.committor, seed)
        if key in {(*_asked_in(d), d["seed"]) for d in lines}:
            continue
        line = run_seed(asked, seed)
        print(json.dumps(line), flush=True)
        with asked.out.open("a") as file:
            file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
