"""The search finds the weather that an ego fails in: fog, for one that brakes where all it sees is white."""

from __future__ import annotations

import numpy as np

import ce
from policies.egos import Observation
from service.evaluation.evaluate import evaluate
from service.world.safety.measure import with_measure
from service.world.scenario.base import base_distribution, weather_values
from service.world.sim.rollout import Simulator
from tests.service.world.camera.test_weather import WEATHER_TABLE

GAMMA = -2.9  # m/s^2: it brakes harder than this


class Dazzled:
    """Brakes the harder the whiter the picture."""

    name = "dazzled"
    wants_camera = True

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        assert observation.frame is not None
        return min(0.05 * (150.0 - float(observation.frame.mean())), 0.0), 0.0


def test_the_search_finds_the_fog_that_an_ego_brakes_in(make_scenario, i80, drivers):
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 0.1"}, more=WEATHER_TABLE)
    scenario = with_measure(scenario, "stl: always(acceleration_mps2 >= 0)")
    base = base_distribution(scenario, drivers)
    options = ce.CrossEntropyOptions(
        iterations=3, samples_per_iteration=150, rho=0.1, estimation_rollouts=300, beta_bounds=(0.5, 40.0),
        mean_box=1e-4, max_kl=6.0,
    )  # fmt: skip
    algorithm = ce.CrossEntropy(base, GAMMA, options)
    events: list[dict[str, float]] = []
    with Simulator(scenario, i80, drivers, Dazzled()) as simulator:

        def run_batch(batch: ce.Batch) -> np.ndarray:
            f = np.array([simulator.run(x, int(s)).f for x, s in zip(batch.x, batch.noise, strict=True)])
            events.extend(weather_values(scenario, x) for x in batch.x[f <= GAMMA])
            return f

        states: list[ce.CrossEntropyState] = []
        estimate = evaluate(algorithm, 1, run_batch, lambda state, record: states.append(state))
    names = [name.removeprefix("weather.") for name in base.names or ()]
    moved = algorithm.proposal(states[-1])
    column = names.index("fog_per_km")
    fog = {
        key: np.median(ce.draw(product, 0, "estimate", 0, 0, 1000)[0][:, column])
        for key, product in (("base", base), ("moved", moved))
    }
    assert 0.001 < estimate.p < 0.07
    assert fog["moved"] > 1.4 * fog["base"]
    assert np.median([event["fog_per_km"] for event in events]) > 1.8 * fog["base"]
