"""Options that have got another name: the old one works as before, with a line of notice."""

import json

import msgspec
import pytest
from click.testing import CliRunner, Result

from service.evaluation.store import RunDirectory
from service.front.cli import main

SHORT = (
    "--ego",
    "idm",
    "--gamma",
    "2.5",
    "--method",
    "naive",
    "--budget",
    "4",
    "--workers",
    "1",
    "--no-report",
)


def estimate(*options: str) -> Result:
    return CliRunner().invoke(main, ["estimate", *options])


@pytest.fixture
def short(tmp_path, scenario_text) -> str:
    path = tmp_path / "short.toml"
    path.write_text(scenario_text.replace("horizon_s = 10.0", "horizon_s = 1.0"))
    return str(path)


def test_noise_is_the_old_name_of_noise_mode(short, tmp_path):
    found = {}
    for option in ("--noise", "--noise-mode"):
        out = tmp_path / option.strip("-")
        done = estimate(short, *SHORT, option, "frozen", "--out", str(out), "--json")
        assert done.exit_code == 0, done.output
        assert done.stderr.count("--noise is called --noise-mode now") == (option == "--noise")
        found[option] = json.loads(done.stdout)
        store = RunDirectory.open(out)
        assert [job.scenario.drivers.noise_mode for job in store.jobs] == ["frozen"]
        assert msgspec.to_builtins(store.jobs[0].scenario)["drivers"]["noise"] == "frozen"
    assert found["--noise"]["p"] == found["--noise-mode"]["p"]


def test_both_names_are_refused(short):
    done = estimate(short, *SHORT, "--noise", "frozen", "--noise-mode", "drawn")
    assert done.exit_code == 2
    assert "--noise is the old name of --noise-mode; give one of them" in done.output


def test_help_shows_the_new_name():
    done = estimate("--help")
    assert "--noise-mode [drawn|frozen|searched]" in done.output
    assert "--noise [" not in done.output
