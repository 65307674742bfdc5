"""`tailroad estimate --option NAME=VALUE`: what has no flag of its own reaches its method, and nothing is ignored."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from service.front.cli import main


@pytest.fixture(scope="module")
def second(scenario_text, tmp_path_factory):
    """A file with a scenario of one second."""
    path = tmp_path_factory.mktemp("options") / "second.toml"
    path.write_text(scenario_text.replace("horizon_s = 10.0", "horizon_s = 1.0"), encoding="utf-8")
    return path


def test_an_option_reaches_its_method_as_the_type_it_is(second, tmp_path):
    asked = ["estimate", str(second), "--ego", "idm", "--gamma", "2", "--method", "splitting", "--budget", "1000",
             "--workers", "1", "--no-report", "--json", "--out", str(tmp_path / "run")]  # fmt: skip
    done = CliRunner().invoke(main, [*asked, "--option", "replications=5", "--option", "p0=0.25"])
    assert done.exit_code == 0, done.output
    (job,) = json.loads((tmp_path / "run" / "run.json").read_text())["jobs"]
    assert job["options"]["replications"] == 5
    assert job["options"]["p0"] == 0.25
    other = CliRunner().invoke(main, [*asked[:-1], str(tmp_path / "other")])
    assert json.loads(other.stdout)["p"] != json.loads(done.stdout)["p"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("rho=0.2",), "rho"),
        (("replications=many",), "replications"),
        (("replications",), "NAME=VALUE"),
        (("replication=5",), "replications"),
    ],
)
def test_an_option_that_does_not_apply_is_refused_by_name(second, tmp_path, options, said):
    asked = ["estimate", str(second), "--gamma", "2", "--method", "splitting", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(main, [*asked, *(word for one in options for word in ("--option", one))])
    assert done.exit_code == 2
    assert said in done.output
    assert not (tmp_path / "run").exists()
