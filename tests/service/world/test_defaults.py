"""Defaults of the scenario's schema: once released they stay, so that a file means what it meant."""

import msgspec

from service.world.scenario import load_scenario
from service.world.scenario.schema import Beta, Scenario, Time

PAPER = ("i80-paper", "i80-paper-10s", "i80-paper-data", "us101-paper-10s")


def test_defaults_are_what_they_were():
    anywhere = Beta(alpha=2.0, beta=2.0, low=0.0, high=1.0)
    scenario = load_scenario("i80-paper-10s")
    start = msgspec.structs.replace(scenario.start, station_m=anywhere)
    least = Scenario(
        format=1, name="n", description="d", network=scenario.network, time=Time(horizon_s=10.0), start=start,
        vehicles=scenario.vehicles,
    )  # fmt: skip
    assert least.time.step_s == 0.1
    assert (least.drivers.weights, least.drivers.noise_mode) == ("drivers-gail", "drawn")
    assert (least.safety.measure, least.safety.rays) == ("ttc", 20)
    assert (least.background, least.weather, least.fixed) == (None, None, None)


def test_the_papers_scenarios_keep_the_papers_measure_and_drivers():
    for name in PAPER:
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.safety.measure == "ttc"
        assert scenario.drivers.weights == "drivers-gail"
        assert scenario.drivers.noise_mode == "drawn"
