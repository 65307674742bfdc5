"""The pool of worker processes by itself, with tasks that end their process."""

from __future__ import annotations

import os
import select
import signal

import pytest

from service.errors import WorkerError
from service.evaluation.process_pool import ProcessPool, TaskKind

FATAL = 7


def square(numbers: list[int]) -> list[int]:
    if FATAL in numbers:
        os.kill(os.getpid(), signal.SIGKILL)
    return [number**2 for number in numbers]


def each(numbers: list[int]) -> list[list[int]]:
    return [[number] for number in numbers]


def joined(parts) -> list[int]:
    return [number for part in parts for number in part]


def lost(numbers: list[int]) -> list[int]:
    return [-1 for _ in numbers]


SQUARES = TaskKind(square, each, joined, lost)


def nothing() -> None:
    pass


def end() -> None:
    os._exit(3)


def results(pool: ProcessPool, tasks: list[list[int]]) -> dict[int, list[int]]:
    found = [(task[0], result) for task, result in pool.run(tasks)]
    assert len(found) == len(tasks)
    return dict(found)


@pytest.fixture
def pool():
    pool = ProcessPool(2, SQUARES, nothing)
    yield pool
    pool.close(kill=True)


def test_the_one_part_that_ends_its_process_is_lost_and_all_others_get_their_result(pool):
    tasks = [[first, first + 1, first + 2] for first in range(0, 24, 3)]
    expected = {task[0]: [-1 if n == FATAL else n**2 for n in task] for task in tasks}
    assert results(pool, tasks) == expected
    assert results(pool, [[1], [2]]) == {1: [1], 2: [4]}  # the pool goes on


def test_workers_that_die_between_two_runs_are_replaced(pool):
    assert results(pool, [[1]]) == {1: [1]}
    manager = pool._executor._executor_manager_thread
    for pid in pool.pids():
        os.kill(pid, signal.SIGKILL)
    manager.join()
    assert results(pool, [[2], [3]]) == {2: [4], 3: [9]}


def test_nothing_is_started_for_nothing_and_a_closed_pool_starts_again(pool):
    assert results(pool, []) == {}
    assert pool.pids() == []
    for kill in (False, True):
        assert results(pool, [[1]]) == {1: [1]}
        workers = [os.pidfd_open(pid) for pid in pool.pids()]
        pool.close(kill)
        assert pool.pids() == []
        for worker in workers:
            assert select.select([worker], [], [], 60.0)[0], "a worker outlives its pool"
            os.close(worker)


def test_workers_that_cannot_start_are_an_error():
    pool = ProcessPool(1, SQUARES, end)
    with pytest.raises(WorkerError, match="ended before its first rollout"):
        list(pool.run([[1]]))
    pool.close(kill=True)
