"""The folder of compiled code is named after everything that decides compiled code."""

import subprocess
import sys
from pathlib import Path

import pytest

from policies.jit import kernel_sources, source_digest

ROOT = Path(__file__).parents[2]
FILES = {
    "service/world/sim/step.py": "from policies.jit import kernel\nfrom service.world import columns as A\n",
    "service/world/columns.py": "from service.world.sizes import (\n    WIDTH,\n)\nX = 1\n",
    "service/world/sizes.py": "WIDTH = 2\n",
    "service/world/film.py": "from service.world.sim import step\n",
    "policies/jit.py": "def kernel(f): return f\n",
    "ce/run.py": "import numpy\n",
}


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return tmp_path


def test_files_with_kernels_and_all_that_they_import_are_found(sources: Path) -> None:
    found = [path.relative_to(sources).as_posix() for path in kernel_sources(sources)]
    assert found == [
        "policies/jit.py",
        "service/world/columns.py",
        "service/world/sim/step.py",
        "service/world/sizes.py",
    ]


@pytest.mark.parametrize("name", ["service/world/sim/step.py", "service/world/sizes.py", "policies/jit.py"])
def test_a_changed_kernel_or_constant_changes_the_digest(sources: Path, name: str) -> None:
    before = source_digest(sources)
    path = sources / name
    path.write_text(path.read_text(encoding="utf-8") + "# changed\n", encoding="utf-8")
    assert source_digest(sources) != before


def test_a_moved_kernel_changes_the_digest(sources: Path) -> None:
    before = source_digest(sources)
    (sources / "service/world/sim/step.py").rename(sources / "service/world/step.py")
    assert source_digest(sources) != before


@pytest.mark.parametrize("name", ["service/world/film.py", "ce/run.py"])
def test_other_files_do_not_change_it(sources: Path, name: str) -> None:
    before = source_digest(sources)
    (sources / name).write_text("import numpy\nx = 1\n", encoding="utf-8")
    assert source_digest(sources) == before


def test_every_file_with_a_kernel_of_ours_counts() -> None:
    decorated = {
        path
        for package in ("policies", "service")
        for path in (ROOT / package).rglob("*.py")
        if any(line in ("@kernel", "@bare") for line in path.read_text(encoding="utf-8").splitlines())
    }
    found = set(kernel_sources(ROOT))
    assert decorated
    assert decorated <= found
    assert ROOT / "service/world/agents.py" in found


def test_every_process_finds_the_same_digest() -> None:
    script = "from policies.jit import *; print(source_digest(Path('.').resolve()))"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == source_digest(ROOT)
