"""The built wheel, installed in an empty environment, works from any directory."""

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CONSTRAINTS = ROOT / "constraints.txt"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of scripts of a new environment into which nothing but the wheel was installed."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)],
        check=True, capture_output=True, timeout=280,
    )  # fmt: skip
    (wheel,) = folder.glob("tailroad-*.whl")
    venv.create(folder / "env")
    scripts = folder / "env" / "bin"
    # byte code of what is not imported here would take half the time
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(scripts / "python"), "install", "-q", "--no-compile",
         "--disable-pip-version-check", "-c", str(CONSTRAINTS), str(wheel)],
        check=True, timeout=600,
    )  # fmt: skip
    return scripts


@pytest.mark.timeout(900)
def test_the_wheel_drives_the_same_bits_from_any_directory(installed: Path, tmp_path: Path) -> None:
    def call(scripts: Path, *arguments: str) -> str:
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        done = subprocess.run(
            [str(scripts / "tailroad"), *arguments],
            cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "good" in call(installed, "scenario", "check", "i80", "i80-paper-10s")
    rollout = ("rollout", "i80-paper-10s", "--ego", "lidar", "--seed", "3", "--json")
    there = json.loads(call(installed, *rollout))
    here = json.loads(call(Path(sys.executable).parent, *rollout))
    assert there == here
    estimate = (
        "--gamma",
        "1.5",
        "--method",
        "naive",
        "--budget",
        "20",
        "--workers",
        "1",
        "--out",
        "run",
        "--json",
    )
    assert json.loads(call(installed, "estimate", "i80-paper-10s", *estimate))["rollouts"]["total"] == 20
    assert (tmp_path / "run" / "report.html").is_file()
