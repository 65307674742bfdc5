"""Real processes, killed with -9 at any moment: no rollout is lost, none counts twice, the bits are the same.

The fast tests kill a few, the long ones (`make faults`) as many as it takes to hit every moment.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.evaluate import evaluate
from service.job import Job, Problem, make_job
from service.pool import Work, run_chunk
from service.scenario import load_scenario
from service.store.jobs import JobStore
from tests.service.fleet import processes as P
from tests.service.fleet.light import free_port

SHORT_OPTIONS = {"budget": 1000, "iterations": 2, "samples_per_iteration": 150, "rho": 0.1, "mean_box": 1e-4}
LONG_OPTIONS = {"budget": 6000, "iterations": 2, "samples_per_iteration": 1000, "rho": 0.1, "mean_box": 1e-4}


def one_process(job: Job) -> tuple:
    """The bits that one process comes to, without scheduler, database or network."""
    problem = Problem(job)
    with problem.simulator() as simulator:
        estimate = evaluate(
            problem.algorithm,
            problem.stream_seed,
            lambda batch: run_chunk(simulator, Work(batch.start, batch.x, batch.noise)).f,
        )
    return P.bits(estimate)


@pytest.fixture(scope="module")
def short_job(make_scenario) -> Job:
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    return make_job(scenario, "idm", 1.5, "ce", 1, SHORT_OPTIONS)


@pytest.fixture(scope="module")
def short_bits(short_job) -> tuple:
    return one_process(short_job)


@pytest.fixture
def store(tmp_path) -> Iterator[JobStore]:
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        yield store


def test_workers_their_processes_and_the_scheduler_are_killed_and_the_disk_fills(
    tmp_path, store, short_job, short_bits
):
    P.submit(store, short_job)
    port = free_port()
    options = ("--chunk-seconds", "0.02", "--audit-share", "0")
    server = P.serve(tmp_path, port, *options)
    workers = [P.worker(port, procs=2)]
    try:
        P.wait(lambda: P.rollouts(store) > 0, [server, *workers])
        P.kill(workers[0].children()[0])  # one rollout's process
        done = P.rollouts(store)
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        server.kill()  # the scheduler; the worker goes on, and finds the next one
        done = P.rollouts(store)
        server = P.serve(tmp_path, port, *options)
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        end = P.fill_disk(server)
        server.wait_line("trying again")
        end()
        done = P.rollouts(store)
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        workers[0].kill()
        workers.append(P.worker(port, procs=2))
        P.wait_done(store, [server, workers[-1]])
        assert workers[1].stop() == 0
        assert server.stop() == 0
    finally:
        for process in [server, *workers]:
            process.kill()
    assert P.recorded_bits(store) == short_bits


# -- at length -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_job() -> Job:
    return make_job(load_scenario("i80-10s"), "lidar", 0.8, "ce", 1, LONG_OPTIONS)


@pytest.fixture(scope="module")
def long_bits(long_job) -> tuple:
    return one_process(long_job)


class Killer(threading.Thread):
    """Keeps `count` processes going, and kills each after a random time, until there were `kills`."""

    def __init__(self, start, count: int, kills: int, longest_s: float, seed: int):
        super().__init__(daemon=True)
        self._start_one, self._longest_s = start, longest_s
        self._random = random.Random(seed)
        self.kills = kills
        self.killed = 0
        self.over = threading.Event()
        self.processes = [start() for _ in range(count)]

    def run(self) -> None:
        ends = [time.monotonic() + self._life() for _ in self.processes]
        while not self.over.wait(0.01):
            for i, process in enumerate(self.processes):
                if self.killed < self.kills and time.monotonic() > ends[i]:
                    assert process.alive
                    process.kill()
                    self.killed += 1
                    self.processes[i] = self._start_one()
                    ends[i] = time.monotonic() + self._life()

    def _life(self) -> float:
        return self._random.uniform(0.0, self._longest_s)

    def end(self) -> None:
        self.over.set()
        self.join()
        for process in self.processes:
            process.kill()


def run_with_kills(folder: Path, store: JobStore, job: Job, kill_workers: int, kill_scheduler: int) -> tuple:
    """Run the job on 4 workers of one process; the bits, and how many were killed before it was done."""
    P.submit(store, job)
    port = free_port()
    options = ("--chunk-seconds", "0.3", "--audit-share", "0.05")
    workers = Killer(lambda: P.worker(port), 4, kill_workers, 40.0, seed=1)
    scheduler = Killer(lambda: P.serve(folder, port, *options), 1, kill_scheduler, 30.0, seed=2)
    try:
        workers.start()
        scheduler.start()
        P.wait_done(store, limit_s=3000.0)
        killed = workers.killed, scheduler.killed
    finally:
        workers.end()
        scheduler.end()
    return P.recorded_bits(store), killed


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("workers", [1, 4])
def test_the_same_bits_for_any_number_of_workers(tmp_path, store, long_job, long_bits, workers):
    P.submit(store, long_job)
    port = free_port()
    started = [P.serve(tmp_path, port), *(P.worker(port) for _ in range(workers))]
    try:
        P.wait_done(store, limit_s=3000.0)
    finally:
        for process in started:
            process.kill()
    assert P.recorded_bits(store) == long_bits


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_fifty_workers_are_killed(tmp_path, store, long_job, long_bits):
    found, killed = run_with_kills(tmp_path, store, long_job, kill_workers=60, kill_scheduler=0)
    print(f"killed {killed[0]} workers")
    assert killed[0] >= 50
    assert found == long_bits


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_the_scheduler_is_killed_twenty_times(tmp_path, store, long_job, long_bits):
    found, killed = run_with_kills(tmp_path, store, long_job, kill_workers=0, kill_scheduler=25)
    print(f"killed the scheduler {killed[1]} times")
    assert killed[1] >= 20
    assert found == long_bits
