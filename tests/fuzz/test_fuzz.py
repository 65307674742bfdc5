"""The fast share of the fuzzing (tests/fuzz/run.py has the rest)."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.fuzz.run import memory_mb, run_round
from tests.fuzz.targets import Targets

NAMES = (
    "api keys and parameters", "api submissions", "api scenarios by value", "worker messages", "ego messages",
    "options", "scenario files", "batch files", "formulas", "run.json", "run databases", "chunks in run databases",
    "remembered rollouts", "road networks", "recordings as text", "imported tables", "driver weights",
    "cards of drivers",
)  # fmt: skip
FEW = {"run.json", "run databases", "chunks in run databases", "recordings as text", "imported tables",
       "driver weights"}  # fmt: skip


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Targets]:
    with Targets(tmp_path_factory.mktemp("fuzz")) as opened:
        yield opened


@pytest.mark.parametrize("name", NAMES)
def test_bad_input_ends_in_the_error_that_is_promised(targets: Targets, name: str) -> None:
    (target,) = [t for t in targets.all if t.name == name]
    count = 10 if name in FEW else 40
    assert sum(run_round(target, count, 1).values()) >= count


def test_every_target_is_here(targets: Targets) -> None:
    assert tuple(t.name for t in targets.all) == NAMES


def test_refused_requests_leave_no_memory_behind(targets: Targets) -> None:
    body = b'{"scenario": "' + b"x" * 900_000 + b'"}'
    wrong = [
        ("jobs", "", body),
        ("jobs", "", b"[" * 900_000),
        ("jobs/x/estimate", "gamma=" + "1" * 20_000, None),
    ]
    application = targets._application

    def ask(times: int) -> None:
        for _ in range(times):
            for one in wrong:
                assert not application.answer(*one).ok

    ask(20)
    before = memory_mb()
    ask(200)  # half a gigabyte of them
    assert memory_mb() - before < 30.0
