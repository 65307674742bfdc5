"""A scenario file that holds one rollout brings it back to the bit, and says what is wrong with a broken one."""

import json
import re
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

import ce
from service.analysis.failures.scenario_file import scenario_text
from service.errors import InputError, ScenarioError
from service.evaluation.job import Problem, make_job
from service.front.cli import main
from service.world.scenario import load_scenario
from service.world.scenario.fixed import fixed_draw, released
from service.world.scenario.noise import PathNoise, noise_of


@pytest.fixture(scope="module")
def held(make_scenario, tmp_path_factory) -> tuple[Path, Problem, float]:
    """A file that holds a rollout, the problem it is of, and its f."""
    problem = Problem(make_job(make_scenario(), "idm", 0.0, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 5, "estimate", 0, 3, 4)
    with problem.simulator() as simulator:
        rollout = simulator.run(x[0], int(noise_seeds[0]))
    path = tmp_path_factory.mktemp("held") / "held.toml"
    path.write_text(scenario_text(problem, x[0], int(noise_seeds[0]), rollout.f, "a title\nof two lines"))
    return path, problem, rollout.f


def test_every_bit_of_the_draw_comes_back(held):
    path, problem, _ = held
    scenario = load_scenario(str(path))
    assert scenario.fixed is not None
    x, noise_seeds = ce.draw(problem.base, 5, "estimate", 0, 3, 4)
    again, seed = fixed_draw(problem.base, scenario.fixed, problem.job.weights_sha256, "held")
    assert again.tobytes() == x[0].tobytes()
    assert seed == int(noise_seeds[0])
    assert released(scenario) == problem.job.scenario


def test_the_rollout_comes_back_to_the_bit(held):
    path, _, f = held
    done = CliRunner().invoke(main, ["rollout", str(path), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert (told["f"], told["ego"], told["same_to_the_bit"]) == (f, "idm", True)


def test_the_noise_of_a_path_comes_back_to_the_bit(held, tmp_path):
    """Its parts have seeds of their own, and the file says where each begins."""
    _, problem, _ = held
    x, _ = ce.draw(problem.base, 5, "estimate", 0, 3, 4)
    noise = PathNoise(2**64 - 1, (0, 5, 20), (3, 2**63 + 5, 4))
    with problem.simulator() as simulator:
        rollout = simulator.run(x[0], noise)
        assert rollout.f != simulator.run(x[0], noise.seed).f
    path = tmp_path / "path.toml"
    path.write_text(scenario_text(problem, x[0], noise, rollout.f, "a path"))
    told = json.loads(CliRunner().invoke(main, ["rollout", str(path), "--json"]).stdout)
    assert (told["f"], told["same_to_the_bit"]) == (rollout.f, True)


@pytest.mark.parametrize(
    "text", ["", "x", str(2**64), "1/", "1/5:3", "1/0:3/0:4", "1/0:x", "1/0:99999999999999999999"]
)
def test_noise_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="give a whole number"):
        noise_of(text)


def test_a_changed_value_makes_another_rollout(held, tmp_path):
    path, _, f = held
    changed = re.sub(r"speed_mps = 1\d\.\d+", "speed_mps = 25.0", path.read_text(), count=1)
    (tmp_path / "changed.toml").write_text(changed)
    told = json.loads(CliRunner().invoke(main, ["rollout", str(tmp_path / "changed.toml"), "--json"]).stdout)
    assert told["f"] != f
    assert not told["same_to_the_bit"]


def test_another_ego_can_drive_it(held):
    told = json.loads(CliRunner().invoke(main, ["rollout", str(held[0]), "--ego", "lidar", "--json"]).stdout)
    assert told["ego"] == "lidar"
    assert "same_to_the_bit" not in told


def test_it_cannot_be_estimated(held):
    with pytest.raises(InputError, match="holds one fixed rollout"):
        make_job(load_scenario(str(held[0])), "idm", 1.0, "naive", 1, {})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (r'noise_seed = "\d+"', 'noise_seed = "18446744073709551616"', r"fixed\.noise_seed.*2\*\*64"),
        (r'noise_seed = "\d+"', 'noise_seed = "-1"', r"fixed\.noise_seed"),
        (r'noise_seed = "\d+"', "noise_seed = 5", r"fixed\.noise_seed.*text"),
        (r'(fixed.starts\]\]\nname = )"ego"', r'\1"eggo"', r"fixed\.starts.*env1"),
        (r"driver_weights = \[\n[^\n]+\n", "driver_weights = [\n", r"fixed\.driver_weights is 403: give 404"),
        (r"speed_mps = 1\d\.\d+", "speed_mps = 250.0", r"fixed\.starts\[0\]\.speed_mps is 250.*3\.6"),
        (r'weights_sha256 = "\w+"', 'weights_sha256 = "0"', r"fixed\.weights_sha256.*others now"),
        (r"(driver_weights = )", r"others = { wind = 1.0 }\n\1", r"fixed\.others\.wind.*draws no such"),
        (r"station_m = \d+\.\d+\nlane_offset", "station_m = 9000.0\nlane_offset", r"station_m is 9000.*road goes"),
    ],
)  # fmt: skip
def test_a_broken_one_is_refused_with_its_key(held, tmp_path, old, new, said):
    path, _, _ = held
    text, count = re.subn(old, new, path.read_text(), count=1)
    assert count == 1
    (tmp_path / "broken.toml").write_text(text)
    done = CliRunner().invoke(main, ["rollout", str(tmp_path / "broken.toml")])
    assert done.exit_code == 2
    assert re.search(said, done.output, re.S)


def test_a_value_that_the_scenario_draws_may_not_be_missing(held):
    path, problem, _ = held
    fixed = load_scenario(str(path)).fixed
    assert fixed is not None
    fewer = msgspec.structs.replace(fixed, starts=fixed.starts[1:])
    with pytest.raises(ScenarioError, match=r"station_m: missing"):
        fixed_draw(problem.base, fewer, problem.job.weights_sha256, "held")
