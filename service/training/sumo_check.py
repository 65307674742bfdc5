"""What becomes of the environment vehicles with SUMO in the loop: how many leave the road or hit somebody.

    python -m service.training.sumo_check --scenario i80 --ego lidar --rollouts 300 --seed 1

A rollout ends with the ego; a slower vehicle has not reached the road's end then and counts as on the road.
"""

import argparse
import json

import numpy as np
from rich.progress import track

import ce
from policies.drivers import load_drivers
from policies.egos import load_ego
from service.training.metrics import share
from service.world import agents as A
from service.world.scenario import load_scenario
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.sim.rollout import Simulator
from service.world.sim.world import World


class Fates:
    """Looks on at a rollout: who left the road, who hit somebody, lane changes and the way driven, before either."""

    def __init__(self, vehicles: int):
        self.left = np.zeros(vehicles, dtype=bool)
        self.hit = np.zeros(vehicles, dtype=bool)
        self.changes = np.zeros(vehicles, dtype=np.int64)
        self.metres = np.zeros(vehicles)
        self._lane: np.ndarray | None = None

    def see(self, world: World, time_s: float, ttc_s: float, action: tuple[float, float] | None) -> None:
        agents = world.agents[: world.vehicles]
        here = (agents[:, A.ACTIVE] > 0) & ~self.left & ~self.hit
        off = here & (agents[:, A.OFF_ROAD] > 0)
        self.left |= off
        self.hit |= here & ~off & (agents[:, A.COLLISION] > 0)
        lane = agents[:, A.LANE].copy()
        if self._lane is not None:
            self.changes += here & (lane != self._lane)
            self.metres += here * agents[:, A.SPEED_MPS] * world.dt_s
        self._lane = lane


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="i80-paper")
    parser.add_argument("--ego", default="lidar")
    parser.add_argument("--rollouts", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    scenario = load_scenario(arguments.scenario)
    drivers = load_drivers(scenario.drivers.weights)
    options = ce.NaiveOptions(budget=max(arguments.rollouts, 1000))
    algorithm = ce.algorithm("naive", base_distribution(scenario, drivers), 0.2, options)
    batch = algorithm.propose(algorithm.init(arguments.seed))
    assert batch is not None
    outcomes: dict[str, int] = {}
    others = np.arange(len(scenario.vehicles)) != scenario.ego
    left = hit = changes = 0
    km = 0.0
    corridor = check_road(scenario, scenario.name)
    with Simulator(scenario, corridor, drivers, load_ego(arguments.ego)) as simulator:
        rows = list(zip(batch.x, batch.noise, strict=True))[: arguments.rollouts]
        for x, noise in track(rows, "rollouts", transient=True):
            fates = Fates(len(scenario.vehicles))
            found = simulator.run(x, int(noise), fates)
            outcomes[found.outcome] = outcomes.get(found.outcome, 0) + 1
            left, hit = left + int(fates.left[others].sum()), hit + int(fates.hit[others].sum())
            changes, km = changes + int(fates.changes[others].sum()), km + fates.metres[others].sum() / 1e3
    n = len(rows) * int(others.sum())
    print(
        json.dumps(
            {
                "scenario": scenario.name, "drivers": scenario.drivers.weights, "ego": arguments.ego,
                "rollouts": len(rows), "ego_outcomes": outcomes, "environment_left_the_road": share(left, n),
                "environment_collided": share(hit, n), "lane_changes_per_vehicle_km": round(changes / km, 3),
                "vehicle_km": round(float(km), 1),
            },
            indent=1,
        )
    )  # fmt: skip


if __name__ == "__main__":
    main()
