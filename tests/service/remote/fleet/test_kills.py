"""Real processes, killed with -9 at any moment: no rollout is lost, none counts twice, the bits are the same.

The fast tests kill a few, the long ones (`make faults`) as many as it takes to hit every moment.
"""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.pool import Work, run_chunk
from service.evaluation.store.jobs import JobStore
from service.world.scenario import load_scenario
from tests.service.remote.fleet import gated_ego
from tests.service.remote.fleet import processes as P
from tests.service.remote.fleet.gated_ego import Gate
from tests.service.remote.fleet.light import free_port

SHORT_OPTIONS = {"budget": 1000, "iterations": 2, "samples_per_iteration": 150, "rho": 0.1, "mean_box": 1e-4}
LONG_OPTIONS = {"budget": 3000, "iterations": 2, "samples_per_iteration": 500, "rho": 0.1, "mean_box": 1e-4}


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


@pytest.fixture
def store(tmp_path) -> Iterator[JobStore]:
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        yield store


@pytest.fixture
def gate(tmp_path, monkeypatch) -> Iterator[Gate]:
    """Of the rollouts that processes started from here on run with the ego `gated_ego`."""
    monkeypatch.setenv("TAILROAD_PYTHON_EGOS", gated_ego.EGO)
    monkeypatch.setenv(gated_ego.GATE, str(tmp_path / "gate"))
    gate = Gate(tmp_path / "gate")
    yield gate
    gate.close()


def test_workers_their_processes_and_the_scheduler_are_killed_and_the_disk_fills(
    tmp_path, make_scenario, store, gate, monkeypatch
):
    scenario = make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})
    job = make_job(scenario, gated_ego.EGO, 1.5, "ce", 1, SHORT_OPTIONS)
    P.submit(store, job)
    port = free_port()
    options = ("--chunk-seconds", "0.02", "--audit-share", "0")
    server = P.serve(tmp_path, port, *options)
    workers = [P.worker(port, procs=2)]
    try:
        gate.let(200)  # of 1000: whatever is killed below is killed before the job can end
        P.wait(lambda: P.rollouts(store) > 0, [server, *workers])
        P.kill(workers[0].children()[0])  # one rollout's process
        done = P.rollouts(store)
        gate.let(200)
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        server.kill()  # the scheduler; the worker goes on, and finds the next one
        done = P.rollouts(store)
        gate.let(200)
        server = P.serve(tmp_path, port, *options)
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        end = P.fill_disk(server)
        done = P.rollouts(store)
        gate.let(200)
        server.wait_line("trying again")
        end()
        P.wait(lambda: P.rollouts(store) > done, [server, workers[-1]])
        workers[0].kill()
        workers.append(P.worker(port, procs=2))
        workers[1].wait_line("is connected")
        gate.let(10 * job.options["budget"])
        P.wait_done(store, [server, workers[-1]])
        assert workers[1].stop() == 0
        assert server.stop() == 0
    finally:
        for process in [server, *workers]:
            process.kill()
    monkeypatch.delenv(gated_ego.GATE)
    assert P.recorded_bits(store) == one_process(job)


# -- at length -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def long_job() -> Job:
    return make_job(load_scenario("i80-paper-10s"), "lidar", 0.8, "ce", 1, LONG_OPTIONS)


@pytest.fixture(scope="module")
def long_bits(long_job) -> tuple:
    return one_process(long_job)


def run_with_kills(folder: Path, store: JobStore, job: Job, of_workers: int, of_scheduler: int) -> tuple:
    """Run the job on 4 workers of one process; the bits.

    Kills come at random points of the job, a random part of a chunk later; a third of the schedulers are killed again
    while they start.
    """
    chance = random.Random(7)
    budget = job.options["budget"]
    points = [(chance.uniform(0.0, 0.97) * budget, "worker") for _ in range(of_workers)]
    points += [(chance.uniform(0.0, 0.97) * budget, "scheduler") for _ in range(of_scheduler)]
    P.submit(store, job)
    port = free_port()
    options = ("--chunk-seconds", "0.2", "--audit-share", "0.05")
    scheduler = P.serve(folder, port, *options)
    workers = [P.worker(port) for _ in range(4)]
    try:
        for i, (point, what) in enumerate(sorted(points)):
            P.wait(lambda: P.rollouts(store) >= point, [scheduler, *workers], 3000.0)  # noqa: B023 (used at once)
            time.sleep(chance.uniform(0.0, 0.3))
            if what == "worker":
                victim = chance.randrange(4)
                workers[victim].kill()
                workers[victim] = P.worker(port)
            else:
                scheduler.kill()
                scheduler = P.serve(folder, port, *options)
                if i % 3 == 0:
                    time.sleep(chance.uniform(0.0, 3.0))
                    scheduler.kill()
                    scheduler = P.serve(folder, port, *options)
        P.wait_done(store, [scheduler, *workers], 3000.0)
    finally:
        for process in (scheduler, *workers):
            process.kill()
    return P.recorded_bits(store)


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("workers", [1, 4])
def test_the_same_bits_for_any_number_of_workers(tmp_path, store, long_job, long_bits, workers):
    P.submit(store, long_job)
    port = free_port()
    started = [P.serve(tmp_path, port, "--chunk-seconds", "0.2"), *(P.worker(port) for _ in range(workers))]
    try:
        P.wait_done(store, limit_s=3000.0)
    finally:
        for process in started:
            process.kill()
    assert P.recorded_bits(store) == long_bits


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_fifty_five_workers_and_twenty_two_schedulers_are_killed(tmp_path, store, long_job, long_bits):
    assert run_with_kills(tmp_path, store, long_job, of_workers=55, of_scheduler=22) == long_bits
