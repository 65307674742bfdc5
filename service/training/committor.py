"""A committor for the method paths, taught among the drivers of one scenario with several egos.

    tailroad train committor --scenario i80-10s --ego lidar --aim 1 --aim 0 --out policies/weights

writes `committor-SCENARIO.msgpack` and its card. Estimates with that scenario and measure start from it
(`service.evaluation.shipped`), and pay for no training.
"""

import argparse
import hashlib
import json
import time
from pathlib import Path

import msgspec

from ce.paths import Teaching, saved, teach
from policies.egos import ego_digest
from service.evaluation.job import Problem, make_job
from service.evaluation.shipped import card_of, file_of, meaning_of
from service.world.paths.features import FEATURES
from service.world.paths.process import HighwayPaths
from service.world.scenario import load_scenario

NAIVE_BUDGET = 1000  # of the jobs that stand for a scenario with an ego; nothing is estimated


def process_of(scenario: str, ego: str, gamma: float) -> HighwayPaths:
    """The paths of a built-in scenario with that ego; InputError where they cannot be driven."""
    job = make_job(load_scenario(scenario), ego, gamma, "paths", 1, {"budget": NAIVE_BUDGET})
    return Problem(job).paths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenario", required=True)
    parser.add_argument("--ego", action="append", required=True, help="several: one after the other")
    parser.add_argument(
        "--aim", action="append", type=float, required=True, help="level, in the measure's unit"
    )
    parser.add_argument("--rounds", type=int, default=Teaching((0.0,)).rounds)
    parser.add_argument("--naive", type=int, default=Teaching((0.0,)).naive)
    parser.add_argument("--steps", type=int, default=Teaching((0.0,)).steps)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    how = Teaching(tuple(asked.aim), naive=asked.naive, rounds=asked.rounds, steps=asked.steps)
    began = time.process_time()
    processes = [process_of(asked.scenario, ego, min(asked.aim)) for ego in asked.ego]

    def tell(number: int, k: int, aim: float) -> None:
        print(
            f"{asked.ego[number]} round {k} aimed at {aim:.3g}, {time.process_time() - began:.0f} s",
            flush=True,
        )

    taught = teach(processes, how, asked.seed, tell)
    data = saved(taught.committor)
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / file_of(asked.scenario)).write_bytes(data)
    words = " ".join(f"--{k} {v}" for k in ("ego", "aim") for v in getattr(asked, k))
    card = {
        "name": f"committor-{asked.scenario}",
        "what": "committor of the method paths: chance that a state of the highway comes to a level of the measure",
        "scenario": asked.scenario,
        "meaning_sha256": meaning_of(load_scenario(asked.scenario)),
        "egos": {ego: ego_digest(ego) for ego in asked.ego},
        "aims": asked.aim,
        "features": FEATURES,
        "command": f"tailroad train committor --scenario {asked.scenario} {words} --naive {how.naive} "
        f"--rounds {how.rounds} --steps {how.steps} --seed {asked.seed} --out policies/weights",
        "teaching": msgspec.to_builtins(how),
        "paths": round(taught.paths),
        "processor_s": round(time.process_time() - began),
        "sha256": hashlib.sha256(data).hexdigest(),
        "checksum": taught.committor.checksum,
    }
    (asked.out / card_of(asked.scenario)).write_text(json.dumps(card, indent=2) + "\n")
    print(f"{file_of(asked.scenario)}: {taught.paths:.0f} rollouts' worth of steps")


if __name__ == "__main__":
    main()
