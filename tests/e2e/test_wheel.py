"""The built wheel, in an environment with what it says it needs and nothing else, works from any directory."""

import json
import os
import subprocess
import sys
import venv
from importlib.metadata import distribution
from pathlib import Path

import pytest

from docs.site.licences import packages

ROOT = Path(__file__).parents[2]
CONSTRAINTS = ROOT / "constraints.txt"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)],
        check=True, capture_output=True, timeout=280,
    )  # fmt: skip
    (made,) = folder.glob("tailroad-*.whl")
    return made


def environment(folder: Path) -> Path:
    """The scripts of a new environment without any package."""
    venv.create(folder)
    return folder / "bin"


def pip(scripts: Path, *arguments: str) -> None:
    # byte code of what is not imported here would take half the time
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(scripts / "python"), "install", "-q", "--no-compile",
         "--disable-pip-version-check", *arguments],
        check=True, timeout=600,
    )  # fmt: skip


def share_what_is_needed(scripts: Path) -> None:
    """Links to the installed packages that the wheel's metadata ask for, of all that are here."""
    (packages_here,) = (scripts.parent / "lib").glob("python*/site-packages")
    for needed in packages(extras=()):
        there = distribution(needed.name)
        for name in {file.parts[0] for file in there.files or ()} - {"..", "__pycache__"}:
            link = packages_here / name
            if not link.exists():
                link.symlink_to(Path(str(there.locate_file(name))))


def call(scripts: Path, folder: Path, *arguments: str) -> str:
    variables = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [str(scripts / "tailroad"), *arguments],
        cwd=folder, env=variables, capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def check(scripts: Path, folder: Path) -> None:
    """The same bits as here, and a whole estimate with its report."""
    assert "good" in call(scripts, folder, "scenario", "check", "i80", "i80-paper-10s")
    rollout = ("rollout", "i80-paper-10s", "--ego", "lidar", "--seed", "3", "--json")
    there = json.loads(call(scripts, folder, *rollout))
    assert there == json.loads(call(Path(sys.executable).parent, folder, *rollout))
    options = ["--gamma", "1.5", "--method", "naive", "--budget", "20", "--workers", "1", "--out", "run"]
    told = json.loads(call(scripts, folder, "estimate", "i80-paper-10s", *options, "--json"))
    assert told["rollouts"]["total"] == 20
    assert (folder / "run" / "report.html").is_file()


@pytest.mark.timeout(900)
def test_the_wheel_drives_the_same_bits_from_any_directory(wheel: Path, tmp_path: Path) -> None:
    scripts = environment(tmp_path / "env")
    share_what_is_needed(scripts)
    pip(scripts, "--no-deps", str(wheel))
    check(scripts, tmp_path)


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_an_index_brings_all_that_the_wheel_needs(wheel: Path, tmp_path: Path) -> None:
    scripts = environment(tmp_path / "env")
    pip(scripts, "-c", str(CONSTRAINTS), str(wheel))
    check(scripts, tmp_path)
