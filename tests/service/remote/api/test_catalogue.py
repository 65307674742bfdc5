"""What a job ran is had again: by the scenario's name where that brings it back, else by the text of its file."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from service.remote.api.catalogue import Catalogue
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.fixed import toml_of
from service.world.scenario.noise_mode import with_noise_mode


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory: pytest.TempPathFactory) -> Catalogue:
    """Of a service whose owner offers a scenario on a road of his own."""
    folder: Path = tmp_path_factory.mktemp("offered")
    text = toml_of(load_scenario("i80-10s")).replace('name = "i80-10s"', 'name = "ours"')
    own = folder / "ours.toml"
    own.write_text(text, encoding="utf-8")
    return Catalogue([str(own)])


def test_a_listed_scenario_is_had_again_by_its_name_measure_and_noise(catalogue: Catalogue):
    listed = catalogue.named("i80-10s")
    assert catalogue.again(listed) == (None, None)
    assert catalogue.again(with_measure(listed, "rss")) == ("rss", None)
    assert catalogue.again(with_noise_mode(listed, "frozen")) == (None, "frozen")


def test_another_scenario_is_had_again_by_its_text(catalogue: Catalogue):
    data = tomllib.loads(toml_of(load_scenario("i80-10s")))
    data["time"]["horizon_s"] = 5.0
    mine = catalogue.by_value(data)  # of a name that is listed, and not what is listed
    assert catalogue.again(mine) is None
    assert catalogue.by_value(tomllib.loads(catalogue.text_of(mine))) == mine


@pytest.mark.parametrize("name", ["ours", "i80", "us101-10s"])
def test_the_text_of_a_scenario_brings_it_back(catalogue: Catalogue, name: str):
    scenario = with_measure(catalogue.named(name), "rss")
    assert catalogue.by_value(tomllib.loads(catalogue.text_of(scenario))) == scenario
