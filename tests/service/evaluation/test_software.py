"""What decides bits besides a job: told by code and libraries, not by a version."""

from __future__ import annotations

import ast
import shutil
from pathlib import PurePath

import pytest

from policies.jit import kernel_sources
from service.evaluation import software as module
from service.evaluation.software import BESIDE, PARTS, SOURCES, Software, software, sources_of

HERE = Software({"world": "a", "egos": "b"}, {"numpy": "2.1.0", "scipy": "1.17"})
# Sources with compiled code that no rollout of a job calls.
OTHER_PROGRAMS = (
    "policies/data/",
    "policies/realism/",
    "policies/baselines/fit.py",
    "service/studies/",
    "service/training/",
)
NO_CODE = {"service/world/__init__.py", "service/closing.py", "service/errors.py"}


def test_no_compiled_code_that_a_rollout_runs_is_left_out():
    covered = {path for part in PARTS for path in sources_of(part)}
    left = {path.relative_to(SOURCES).as_posix() for path in kernel_sources(SOURCES) if path not in covered}
    assert {name for name in left - BESIDE - NO_CODE if not name.startswith(OTHER_PROGRAMS)} == set()


def test_what_is_left_out_is_not_what_rollouts_stand_on():
    ways_in = {"service/world/egos/renderer.py": "service.world.egos.sdk"}  # for the words of a refusal alone
    left_out = {name.removesuffix(".py").replace("/", ".") for name in BESIDE}
    for path in {path for part in PARTS for path in sources_of(part)}:
        found = {
            node.module for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)
        }
        assert found & left_out <= {ways_in.get(path.relative_to(SOURCES).as_posix())}, path


def test_every_glob_finds_sources():
    for patterns in PARTS.values():
        for pattern in patterns:
            assert list(SOURCES.glob(pattern)), pattern
    assert all((SOURCES / name).is_file() for name in BESIDE)


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """The sources of the measures in a folder of their own."""
    for path in sources_of("measures"):
        target = tmp_path / path.relative_to(SOURCES)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    monkeypatch.setattr(module, "SOURCES", tmp_path)
    return tmp_path / PurePath("service/world/safety/ttc.py")


def test_a_comment_leaves_the_digest_and_a_number_changes_it(copy):
    before = module._known("measures")
    assert before == software().code["measures"]
    source = copy.read_text()
    copy.write_text("# said otherwise\n" + source.replace('"""', '"""Otherwise. ', 1))
    assert module._known("measures") == before
    copy.write_text(source + "\nMORE = 1\n")
    assert module._known("measures") != before


def test_a_digest_is_taken_from_its_record_unless_that_is_damaged(copy, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    digest = module._known("measures")
    (record,) = (tmp_path / "cache/tailroad/software").iterdir()
    assert record.read_text() == digest
    record.write_text("0123456789abcdef")
    assert module._known("measures") == "0123456789abcdef"
    record.write_bytes(b"\xff cut o")
    assert module._known("measures") == digest == record.read_text()


def test_what_differs_is_named():
    later = Software({"world": "a", "egos": "c"}, {"numpy": "2.2.0", "scipy": "1.17"})
    assert later.differs_from(HERE) == "code of egos c instead of b, numpy 2.2.0 instead of 2.1.0"
    assert HERE.differs_from(HERE) == ""
    assert HERE.digest != later.digest
