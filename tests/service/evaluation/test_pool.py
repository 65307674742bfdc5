"""Local workers, killed in every way: nothing is lost, and nothing differs."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from functools import partial

import msgspec
import numpy as np
import pytest

import ce
from policies.egos.idm import IdmEgo
from service.errors import WorkerError
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.pool import OUTCOME_CODES, OUTCOME_NAMES, LocalPool, Work, run_chunk
from service.evaluation.store import FAILED, Chunk
from service.world.sim.rollout import Simulator


@pytest.fixture(scope="module")
def job(make_scenario) -> Job:
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    return make_job(scenario, "idm", 0.5, "naive", 1, {"budget": 100})


@pytest.fixture(scope="module")
def works(job) -> list[Work]:
    x, noise_seeds = ce.draw(Problem(job).base, 1, "estimate", 0, 0, 40)
    return [Work(start, x[start : start + 5], noise_seeds[start : start + 5]) for start in range(0, 40, 5)]


@pytest.fixture(scope="module")
def expected(job, works) -> list[Chunk]:
    """What one process gives, one chunk after the other."""
    with Problem(job).simulator() as simulator:
        return [run_chunk(simulator, work) for work in works]


def same(found: list[Chunk], expected: list[Chunk]) -> bool:
    found = sorted(found, key=lambda chunk: chunk.start)
    return len(found) == len(expected) and all(
        (a.start, a.stop, a.errors) == (b.start, b.stop, b.errors)
        and all(getattr(a, k).tobytes() == getattr(b, k).tobytes() for k in ("f", "outcomes", "steps"))
        for a, b in zip(found, expected, strict=True)
    )


def kill(pool: LocalPool) -> None:
    """Kill the pool's workers and wait until its executor knows."""
    manager = pool._processes._executor._executor_manager_thread
    for pid in pool.pids():
        os.kill(pid, signal.SIGKILL)
    manager.join()


def test_a_pool_gives_the_bits_of_one_process_and_loses_nothing_when_workers_are_killed(job, works, expected):
    with LocalPool(job, 2) as pool:
        running = pool.run(works)
        found = [next(running)]
        kill(pool)  # with chunks in flight
        found += [next(running), next(running)]
        assert same([*found, *running], expected)


def test_a_worker_killed_after_its_last_chunk_was_handed_over_is_replaced(job, works, expected):
    """With one chunk at a time nothing is in flight when the worker dies, so only the next submission can tell."""
    with LocalPool(job, 1) as pool:
        found = list(pool.run(works[:1]))
        kill(pool)
        assert same([*found, *pool.run(works[1:3])], expected[:3])


def test_workers_that_cannot_start_are_one_error_not_a_failure_of_every_rollout(job):
    changed = msgspec.structs.replace(job, weights_sha256="another")
    with (
        pytest.raises(WorkerError, match="ended before its first rollout"),
        LocalPool(changed, 1) as pool,
    ):
        pool.warm_up()


class FatalEgo(IdmEgo):
    """An ego that takes its process with it in the rollouts of some seeds, as a crash in native code would."""

    def __init__(self, fatal: frozenset[int]):
        self._fatal = fatal

    def reset(self, seed: int) -> None:
        if seed in self._fatal:
            os.kill(os.getpid(), signal.SIGKILL)


def with_fatal_ego(job: Job, fatal: frozenset[int]) -> Simulator:
    problem = Problem(job)
    return Simulator(job.scenario, problem.corridor, problem.drivers, FatalEgo(fatal))


def test_a_rollout_that_kills_its_process_is_one_recorded_error(job, works, expected):
    fatal = works[1].noise_seeds[3]
    with LocalPool(job, 1, partial(with_fatal_ego, fatal=frozenset([int(fatal)]))) as pool:
        found = sorted(pool.run(works[:3]), key=lambda chunk: chunk.start)
    assert found[1].errors == {3: "the worker process died during this rollout, each time it was tried"}
    assert found[1].outcomes[3] == FAILED
    assert np.isnan(found[1].f[3])
    assert found[1].steps[3] == 0
    others = [0, 1, 2, 4]
    assert found[1].f[others].tobytes() == expected[1].f[others].tobytes()
    assert found[1].outcomes[others].tobytes() == expected[1].outcomes[others].tobytes()
    assert same([found[0], found[2]], [expected[0], expected[2]])


def test_a_failed_rollout_keeps_its_row_and_its_reason(job, works):
    class Broken(IdmEgo):
        def reset(self, seed: int) -> None:
            self.fails = seed == works[0].noise_seeds[2]

        def act(self, observation):
            if self.fails:
                raise ValueError("no camera")
            return super().act(observation)

    problem = Problem(job)
    with Simulator(job.scenario, problem.corridor, problem.drivers, Broken()) as simulator:
        chunk = run_chunk(simulator, works[0])
    assert chunk.errors == {2: "ValueError: no camera"}
    assert np.flatnonzero(np.isnan(chunk.f)).tolist() == [2]
    assert np.flatnonzero(chunk.outcomes == FAILED).tolist() == [2]


def test_outcome_codes_are_pinned_because_they_are_stored():
    assert OUTCOME_CODES == {
        "horizon": 0,
        "finished": 1,
        "collision": 2,
        "off-road": 3,
        "reversing": 4,
        "error": 255,
    }
    assert all(OUTCOME_CODES[OUTCOME_NAMES[code]] == code for code in OUTCOME_NAMES)


PARENT = """
import multiprocessing
import sys
import ce
import msgspec
from service.analysis.failures.rerun import Rerunner
from service.evaluation.job import Job, Problem
from service.evaluation.pool import LocalPool

def begin_LocalPool(pool):
    pool.warm_up()

def begin_Rerunner(rerunner):
    x, noise = ce.draw(Problem(job).base, 1, "estimate", 0, 0, 1)
    rerunner.run([(x[0], int(noise[0]))])

if __name__ == "__main__":
    job = msgspec.json.decode(sys.argv[1], type=Job)
    with {kind}(job, 1) as workers:
        begin_{kind}(workers)
        print(*(child.pid for child in multiprocessing.active_children()), flush=True)
        sys.stdin.read()
"""


@pytest.mark.parametrize("kind", ["LocalPool", "Rerunner"])
def test_workers_end_when_their_parent_is_killed(job, tmp_path, kind):
    script = tmp_path / "parent.py"
    script.write_text(PARENT.format(kind=kind), encoding="utf-8")
    command = [sys.executable, str(script), msgspec.json.encode(job).decode()]
    parent = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    workers = [os.pidfd_open(int(pid)) for pid in parent.stdout.readline().split()]
    assert workers
    parent.kill()
    parent.wait()
    for worker in workers:
        ended, _, _ = select.select([worker], [], [], 30.0)
        os.close(worker)
        assert ended, "a worker outlives its parent"
