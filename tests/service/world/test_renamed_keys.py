"""Keys of scenario files that have got another name: the old one is read as before, with a line of notice."""

import logging
import tomllib
from pathlib import Path

import msgspec
import pytest

from service.errors import ScenarioError
from service.world.scenario.fixed import toml_of
from service.world.scenario.load import digest, parse_scenario
from service.world.scenario.renamed import RENAMED, to_stored, to_written, written_key

VALUES = {"noise_mode": "frozen", "sensor_noise_levels": 5.0}


def given(scenario_text: str, table: str, **values: object) -> dict:
    data = tomllib.loads(scenario_text)
    data["drivers"].pop("noise_mode", None)
    return data | {table: data.get(table, {}) | values}


@pytest.mark.parametrize(("table", "stored", "written"), RENAMED)
def test_the_old_name_means_the_same_and_is_noticed_once(scenario_text, caplog, table, stored, written):
    value = VALUES[written]
    source = f"{stored}.toml"
    new = parse_scenario(given(scenario_text, table, **{written: value}), "new.toml", Path())
    assert getattr(getattr(new, table), written) == value
    assert not caplog.records
    with caplog.at_level(logging.WARNING):
        for _ in range(2):
            old = parse_scenario(given(scenario_text, table, **{stored: value}), source, Path())
    assert old == new
    assert digest(old) == digest(new)
    (notice,) = caplog.messages
    assert notice == f"{source}: {table}.{stored} is called {written} now; the old name is still read"


@pytest.mark.parametrize(("table", "stored", "written"), RENAMED)
def test_both_names_are_refused(scenario_text, table, stored, written):
    value = VALUES[written]
    with pytest.raises(ScenarioError, match=rf"both\.toml: {table}\.{stored}.*old name of `{written}`"):
        parse_scenario(given(scenario_text, table, **{written: value, stored: value}), "both.toml", Path())


def test_a_scenario_is_stored_as_ever_and_written_with_the_new_names(make_scenario):
    scenario = make_scenario()
    stored = msgspec.to_builtins(scenario)
    assert stored["drivers"]["noise"] == "drawn"
    assert stored["camera"]["noise_levels"] == 2.0
    written = tomllib.loads(toml_of(scenario))
    assert written["drivers"]["noise_mode"] == "drawn"
    assert "noise" not in written["drivers"]
    assert to_stored(to_written(stored), "again") == stored
    assert parse_scenario(written, "again", Path()) == scenario


def test_messages_have_the_new_names(scenario_text):
    assert written_key("drivers.noise") == "drivers.noise_mode"
    assert written_key("drivers.weights") == "drivers.weights"
    for data, match in (
        (given(scenario_text, "drivers", noise="cold"), "drivers.noise_mode is 'cold'"),
        (given(scenario_text, "drivers", noise_modes="drawn"), "did you mean `noise_mode`"),
    ):
        with pytest.raises(ScenarioError, match=match):
            parse_scenario(data, "wrong.toml", Path())
