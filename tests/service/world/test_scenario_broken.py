"""Wrong scenario files: each gives one error that names the file, the key, the value and a remedy.

Long because it is one table of mistakes, a line or two each.
"""

from __future__ import annotations

import copy
import math
import random
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import ScenarioError
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.load import FOLDER, MAX_BYTES, parse_scenario

TEXT = (FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8")
STATION = 'station_m = { distribution = "beta", alpha = 2.0, beta = 2.0, low = 80.0, high = 120.0 }'
OFFSET = 'lane_offset_m = { distribution = "beta", alpha = 2.0, beta = 2.0, low = -0.25, high = 0.25 }'
EGO = 'name = "ego"\nrole = "ego"\nlane = 3'
ENV1 = 'name = "env1"\nlane = 1'
BACKGROUND = "\n[background]\ndensity_veh_per_km_lane = {}\nspeed_mps = {}\n"
HUGE = "0x" + "f" * 6000

# name: (what is replaced, by what, the key that is named, what is said of the value, what is said to do)
BROKEN = {
    "unknown key": ("rays = 20", "rays = 20\nzzz = 3", "safety.zzz", "is 3", "unknown key; remove it"),
    "unknown table": ("[safety]", "[extra]\na = 1\n[safety]", "extra", "", "unknown key"),
    "misspelt key": ("step_s = 0.1", "stpe_s = 0.1", "time.stpe_s", "is 0.1", "did you mean `step_s`?"),
    "a key of another table": (
        "step_s = 0.1",
        "raies = 20\nstep_s = 0.1",
        "time.raies",
        "is 20",
        "unknown key; remove",
    ),
    "a key of another distribution": (
        STATION,
        STATION.replace("alpha", "mean"),
        "start.station_m.mean",
        "is 2.0",
        "unknown key",
    ),
    "uniform with its ends exchanged": (
        STATION,
        'station_m = { distribution = "uniform", low = 120.0, high = 80.0 }',
        "start.station_m.low",
        "is 120.0",
        "must lie below high",
    ),
    "normal without a spread": (
        STATION,
        'station_m = { distribution = "truncated-normal", mean = 100.0, deviation = 0.0, low = 80.0, high = 120.0 }',
        "start.station_m.deviation",
        "is 0.0",
        "lies above 0",
    ),
    "normal far from its interval": (
        STATION,
        'station_m = { distribution = "truncated-normal", mean = 0.0, deviation = 1.0, low = 80.0, high = 120.0 }',
        "start.station_m.mean",
        "is 0.0",
        "six deviations outside",
    ),
    "misspelt table": ("[drivers]", "[driver]", "driver", "", "did you mean `drivers`?"),
    "speed in km/h": (
        "speed_mps = {",
        "speed_kmh = {",
        "start.speed_kmh",
        "",
        "give metres per second as `speed_mps`",
    ),
    "heading in rad": (
        "heading_deg",
        "heading_rad",
        "start.heading_rad",
        "",
        "give degrees as `heading_deg`",
    ),
    "horizon in min": (
        "horizon_s = 10.0",
        "horizon_min = 1",
        "time.horizon_min",
        "is 1",
        "give seconds as `horizon_s`",
    ),
    "length in feet": (
        "length_m = 4.5",
        "length_ft = 15.0",
        "start.length_ft",
        "is 15.0",
        "give metres as `length_m`",
    ),
    "no unit": (
        "horizon_s = 10.0",
        "horizon = 10.0",
        "time.horizon",
        "is 10.0",
        "give seconds as `horizon_s`",
    ),
    "speed value in km/h": (
        "low = 10.0, high = 20.0",
        "low = 50.0, high = 100.0",
        "start.speed_mps.high",
        "is 100.0",
        "divide km/h by 3.6",
    ),
    "negative speed": (
        "low = 10.0, high = 20.0",
        "low = -1.0, high = 9.0",
        "start.speed_mps.low",
        "is -1.0",
        "0 to 70",
    ),
    "length value in mm": (
        "length_m = 4.5",
        "length_m = 4500.0",
        "start.length_m",
        "is 4500.0",
        "check the unit",
    ),
    "offset beyond the lane": (
        "low = -0.25",
        "low = -25.0",
        "start.lane_offset_m.low",
        "is -25.0",
        "a few metres",
    ),
    "heading the wrong way": (
        "low = -3.6, high = 3.6",
        "low = -3.6, high = 180.0",
        "start.heading_deg.high",
        "is 180.0",
        "within 90 degrees",
    ),
    "overlap in a lane": (
        ENV1,
        'name = "env1"\nlane = 2',
        "vehicles[2].station_m",
        "'80 to 120'",
        "env2 can start on top of env1",
    ),
    "overlap across lanes": (
        OFFSET,
        OFFSET.replace("0.25", "1.5"),
        "start.lane_offset_m",
        "'-1.5 to 1.5'",
        "in lane 2 can start on top of ego in lane 3",
    ),
    "missing network": (
        '"i80"\n\n[time]',
        '"my.net.xml"\nedges = ["a"]\n\n[time]',
        "network.road",
        "my.net.xml",
        "there is no network file",
    ),
    "unknown road": ('"i80"\n\n[time]', '"i81"\n\n[time]', "network.road", "is 'i81'", "built-in networks"),
    "a road's path without edges": (
        '"i80"\n\n[time]',
        '"my.net.xml"\n\n[time]',
        "network.edges",
        "my.net.xml",
        "name the edges of the corridor in driving order",
    ),
    "an edge that is not there": (
        '"i80"\n\n[time]',
        '"i80"\nedges = ["nowhere"]\n\n[time]',
        "network.edges",
        "is ['nowhere']",
        "no edge 'nowhere'",
    ),
    "a road that is no network": (
        '"i80"\n\n[time]',
        f'"{FOLDER}/i80.toml"\nedges = ["a"]\n\n[time]',
        "network.road",
        "i80.toml",
        "is no XML",
    ),
    "a road's name too long": (
        '"i80"\n\n[time]',
        f'"{"r" * 5000}.net.xml"\nedges = ["a"]\n\n[time]',
        "network.road",
        "rrr...",
        "cannot be opened",
    ),
    "a zero byte in a path": (
        '"i80"\n\n[time]',
        '"a\\u0000b.net.xml"\n\n[time]',
        "network.road",
        "a\\x00b",
        "not a path",
    ),
    "not a number": ("alpha = 2.0", "alpha = nan", "start.station_m.alpha", "is nan", "give a finite one"),
    "infinite": ("horizon_s = 10.0", "horizon_s = inf", "time.horizon_s", "is inf", "give a finite one"),
    "infinite in a list": (
        '"i80"\n\n[time]',
        '"i80"\nedges = [-inf]\n\n[time]',
        "network.edges[0]",
        "is -inf",
        "finite",
    ),
    "lane that does not exist": (
        EGO,
        EGO.replace("3", "9"),
        "vehicles[0].lane",
        "is 9",
        "lanes 1 (leftmost) to 7",
    ),
    "lane 0": (EGO, EGO.replace("3", "0"), "vehicles[0].lane", "is 0", "lanes 1 (leftmost) to 7"),
    "lane absent at the start": (
        EGO,
        EGO.replace("3", "7"),
        "vehicles[0].lane",
        "is 7",
        "lane 7 does not exist over 80 to 120 m",
    ),
    "start beyond the road": (
        "high = 120.0",
        "high = 2120.0",
        "start.station_m",
        "'80 to 2120'",
        "from 0 to 2050 m",
    ),
    "start before the road": (
        "low = 80.0",
        "low = -3.0",
        "start.station_m",
        "'-3 to 120'",
        "from 0 to 2050 m",
    ),
    "missing key": ("horizon_s = 10.0", "", "time.horizon_s", "", "missing; add it, in seconds"),
    "missing table": (
        TEXT[TEXT.index("[time]") : TEXT.index("[drivers]")],
        "",
        "time",
        "",
        "missing; add it",
    ),
    "missing lane": (ENV1, 'name = "env1"', "vehicles[1].lane", "", "missing; add it"),
    "missing format": ("format = 1\n", "", "format", "", "write format = 1"),
    "a later format": ("format = 1", "format = 2", "format", "is 2", "reads scenario format 1"),
    "text for a number": (
        "horizon_s = 10.0",
        'horizon_s = "10"',
        "time.horizon_s",
        "is '10'",
        "give a number, in seconds, not text",
    ),
    "number for a text": (
        'name = "i80-paper-10s"',
        "name = 80",
        "name",
        "is 80",
        "give text in quotes, not a whole number",
    ),
    "fraction for a count": (
        "rays = 20",
        "rays = 20.5",
        "safety.rays",
        "is 20.5",
        "give a whole number, not a number",
    ),
    "truth for a count": (
        "rays = 20",
        "rays = true",
        "safety.rays",
        "is True",
        "give a whole number, not true or false",
    ),
    "a list for a table": (
        '[safety]\nmeasure = "ttc"\nrays = 20',
        "",
        "safety",
        "",
        "give a table, not a list",
    ),
    "a date": (
        "rays = 20",
        "rays = 1979-05-27",
        "safety.rays",
        "datetime.date(1979, 5, 27)",
        "give a whole number",
    ),
    "a number for a distribution": (
        STATION,
        "station_m = 100.0",
        "start.station_m",
        "is 100.0",
        'give a distribution, as in { distribution = "beta"',
    ),
    "another distribution": (
        STATION,
        STATION.replace('beta"', 'normal"'),
        "start.station_m.distribution",
        "is 'normal'",
        "give 'beta' or 'uniform' or 'truncated-normal'",
    ),
    "unknown role": (
        'role = "ego"',
        'role = "hero"',
        "vehicles[0].role",
        "is 'hero'",
        "give 'ego' or 'environment'",
    ),
    "unknown noise mode": (
        '"drawn"',
        '"cold"',
        "drivers.noise_mode",
        "is 'cold'",
        "give 'drawn' or 'frozen'",
    ),
    "two egos": (
        ENV1,
        ENV1 + '\nrole = "ego"',
        "vehicles",
        "['ego', 'env1']",
        "exactly one vehicle must have role",
    ),
    "no ego": ('role = "ego"\n', "", "vehicles", "is []", 'exactly one vehicle must have role = "ego"'),
    "duplicate names": (ENV1, 'name = "ego"\nlane = 1', "vehicles[1].name", "is 'ego'", "give each its own"),
    "a name with spaces": (
        ENV1,
        'name = "env 1"\nlane = 1',
        "vehicles[1].name",
        "is 'env 1'",
        "use up to 32 letters",
    ),
    "a scenario's name with a slash": (
        '"i80-paper-10s"',
        '"../i80"',
        "name",
        "is '../i80'",
        "use up to 64 letters",
    ),
    "low above high": (
        "low = 80.0, high = 120.0",
        "low = 120.0, high = 80.0",
        "start.station_m.low",
        "is 120.0",
        "low must lie below high (80)",
    ),
    "low is high": (
        "low = 80.0, high = 120.0",
        "low = 80.0, high = 80.0",
        "start.station_m.low",
        "is 80.0",
        "below high",
    ),
    "alpha is 0": ("alpha = 2.0", "alpha = 0.0", "start.station_m.alpha", "is 0.0", "lie above 0"),
    "beta is negative": ("beta = 2.0", "beta = -1", "start.station_m.beta", "is -1.0", "lie above 0"),
    "alpha is huge": ("alpha = 2.0", "alpha = " + "9" * 30, "start.station_m.alpha", "100 bits", "too large"),
    "an unprintable number": ("rays = 20", f"rays = {HUGE}", "safety.rays", "24000 bits", "too large"),
    "no rays": ("rays = 20", "rays = 0", "safety.rays", "is 0", "1 to 3600"),
    "a step of 0": ("step_s = 0.1", "step_s = 0.0", "time.step_s", "is 0.0", "between 0.001 and 1 second"),
    "a step off SUMO's clock": (
        "step_s = 0.1",
        "step_s = 0.0333",
        "time.step_s",
        "is 0.0333",
        "a multiple of 0.001",
    ),
    "horizon below a step": (
        "horizon_s = 10.0",
        "horizon_s = 0.05",
        "time.horizon_s",
        "is 0.05",
        "at least one step",
    ),
    "horizon between steps": (
        "horizon_s = 10.0",
        "horizon_s = 10.05",
        "time.horizon_s",
        "is 10.05",
        "whole number of steps",
    ),
    "an endless horizon": (
        "horizon_s = 10.0",
        "horizon_s = 1e308",
        "time.horizon_s",
        "is 1e+308",
        "at most 10000 s",
    ),
    "no background density": (
        "rays = 20\n",
        "rays = 20\n" + BACKGROUND.format(0.0, 15.0),
        "background.density_veh_per_km_lane",
        "is 0.0",
        "above 0 up to 100",
    ),
    "a standing background": (
        "rays = 20\n",
        "rays = 20\n" + BACKGROUND.format(10.0, 0.0),
        "background.speed_mps",
        "is 0.0",
        "above 0 up to 70",
    ),
    "background by the mile": (
        "rays = 20\n",
        "rays = 20\n" + BACKGROUND.format(10.0, 1).replace("speed_mps", "speed_mph"),
        "background.speed_mph",
        "is 1",
        "give metres per second as `speed_mps`",
    ),
}


def load_and_check(path: Path) -> None:
    check_road(load_scenario(str(path)), str(path))


def test_the_text_that_is_broken_is_right(tmp_path):
    path = tmp_path / "right.toml"
    path.write_text(TEXT, encoding="utf-8")
    load_and_check(path)


@pytest.mark.parametrize("case", BROKEN)
def test_a_wrong_file_gives_one_error_with_file_key_value_and_remedy(tmp_path, case):
    old, new, key, said, remedy = BROKEN[case]
    assert old in TEXT
    path = tmp_path / "mine.toml"
    changed = TEXT.replace(old, new, 1)
    path.write_text(f"safety = [1]\n{changed}" if case == "a list for a table" else changed, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_and_check(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: {key}")
    assert caught.value.key == key
    assert said in message
    assert remedy in message
    assert "\n" not in message
    assert len(message) < 700


NOT_SCENARIOS = {
    "empty": (b"", "format"),
    "not TOML": (b"speed = = 3", "not valid TOML: Invalid value (at line 1"),
    "a key twice": (b"format = 1\nformat = 1", "not valid TOML"),
    "binary": (bytes(range(256)) * 4, "not a text file in UTF-8"),
    "binary zeros": (b"\0" * 100, "not valid TOML"),
    "Latin-1": ("name = 'Straße'".encode("latin-1"), "not a text file in UTF-8"),
    "huge": (b"#" * (MAX_BYTES + 1), "larger than 1000000 bytes; this is not a scenario"),
    "deep lists": (b"format = 1\na = " + b"[" * 5000 + b"]" * 5000, "nested too deeply"),
    "deep tables": (b"format = 1\n" + b".".join([b"a"] * 3000) + b" = 1", "nested too deeply"),
    "a number of 5000 digits": (b"format = " + b"9" * 5000, "not valid TOML"),
    "another TOML file": (b"[project]\nname = 'x'\n", "write format = 1"),
}


@pytest.mark.parametrize("case", NOT_SCENARIOS)
def test_a_file_that_is_no_scenario_gives_one_error_that_says_so(tmp_path, case):
    content, said = NOT_SCENARIOS[case]
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load_scenario(str(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ScenarioError, match=r"nowhere\.toml: no such file; check the path"):
        load_scenario(str(tmp_path / "nowhere.toml"))


def test_a_folder_is_not_a_scenario(tmp_path):
    with pytest.raises(ScenarioError, match="no such file"):
        load_scenario(str(tmp_path))


# fuzzing ------------------------------------------------------------------------------------------------------

ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(min_value=2**62, max_value=2**200),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["a\0b.xml", "x.net.xml", "i80", "", "../..", "w.safetensors", "beta"]),
    st.lists(st.floats(), max_size=3),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=3),
    st.just({"distribution": "beta", "alpha": 2.0, "beta": 2.0, "low": 0.0, "high": 1.0}),
)


def places(value: object, path: tuple = ()) -> list[tuple]:
    """The paths of all values in nested tables and lists."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, item in items for found in [(*path, key), *places(item, (*path, key))]]


def mutated(data: dict, pick: random.Random, odd: object) -> dict:
    """`data` with one value replaced, removed, moved to another key, or put twice."""
    changed = copy.deepcopy(data)
    *way, last = pick.choice(places(changed))
    holder = changed
    for key in way:
        holder = holder[key]
    match pick.randrange(5):
        case 0:
            del holder[last]
        case 1 if isinstance(holder, dict):
            holder[f"{last}{pick.choice(['s', '_kmh', '', '.', 'é'])}"] = holder.pop(last)
        case 2 if isinstance(holder[last], int | float):
            holder[last] = holder[last] * pick.choice([-1, 0, 1000, 1e9, 0.5])
        case 3 if isinstance(holder, list):
            holder.append(copy.deepcopy(holder[last]))
        case _:
            holder[last] = odd
    return changed


@settings(max_examples=500, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32), odds=st.lists(ODD, min_size=1, max_size=4))
def test_no_change_of_values_raises_anything_but_a_scenario_error(seed, odds):
    data, pick = tomllib.loads(TEXT), random.Random(seed)
    for odd in odds:
        data = mutated(data, pick, odd)
    found: ScenarioError | None = None
    try:
        scenario = parse_scenario(data, "fuzzed.toml", Path("/nowhere"))
        assert math.isfinite(scenario.time.horizon_s)
        assert scenario.vehicles[scenario.ego].role == "ego"
    except ScenarioError as error:
        found = error
    assert found is None or (str(found).startswith("fuzzed.toml: ") and found.remedy)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32), edits=st.lists(st.text(max_size=6), min_size=1, max_size=4))
def test_no_change_of_the_text_raises_anything_but_a_scenario_error(seed, edits, tmp_path_factory):
    text, pick = TEXT, random.Random(seed)
    for edit in edits:
        start = pick.randrange(len(text))
        text = text[:start] + edit + text[start + pick.choice([0, 1, 5, 40]) :]
    path = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    found: ScenarioError | None = None
    try:
        load_scenario(str(path))
    except ScenarioError as error:
        found = error
    assert found is None or str(found).startswith(str(path))


def test_the_fuzzing_reaches_both_right_and_wrong_scenarios():
    right = wrong = 0
    for seed in range(300):
        try:
            parse_scenario(
                mutated(tomllib.loads(TEXT), random.Random(seed), 0.5), "fuzzed.toml", Path("/nowhere")
            )
            right += 1
        except ScenarioError:
            wrong += 1
    assert right > 20
    assert wrong > 150


def test_a_road_s_check_refuses_whatever_passed_before_it(make_scenario):
    """Stations are the one distribution whose limits only the road knows."""
    scenario = make_scenario({"low = 80.0, high = 120.0": "low = -1e300, high = 1e300"})
    with pytest.raises(
        ScenarioError, match=r"start\.station_m is '-1e\+300 to 1e\+300': the road goes from 0"
    ):
        check_road(scenario, "mine")
