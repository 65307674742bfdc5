"""Rollouts on any executor: worker processes of whatever engine give the same bits; threads are refused."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor

import polars as pl
import pytest

import tailroad
from service.errors import InputError, WorkerError

distributed = pytest.importorskip("distributed", reason="Dask is not installed: make test does it")
loky = pytest.importorskip("loky", reason="loky is not installed: make test does it")

ASKED = {"gamma": 2.0, "method": "splitting", "budget": 1000, "options": {"replications": 5}}


@pytest.fixture(scope="module")
def scenario(make_scenario):
    return make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"})


@pytest.fixture(scope="module")
def here(scenario, tmp_path_factory) -> pl.DataFrame:
    """The rollouts of a run in local processes."""
    folder = tmp_path_factory.mktemp("here") / "run"
    return rollouts(tailroad.estimate(scenario, "idm", out=folder, workers=1, **ASKED))


def rollouts(run) -> pl.DataFrame:
    return run.to_polars().sort("phase", "iteration", "row")


def test_a_dask_cluster_of_processes_gives_the_same_bits(scenario, here, tmp_path):
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        executor = client.get_executor()
        run = tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=executor, **ASKED)
    assert rollouts(run).equals(here)


@pytest.mark.parametrize("start", ["spawn", "fork"])
def test_a_process_pool_gives_the_same_bits_and_stays_open_for_the_next_run(scenario, here, tmp_path, start):
    with ProcessPoolExecutor(2, multiprocessing.get_context(start)) as pool:
        run = tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=pool, **ASKED)
        other = tailroad.estimate(scenario, "lidar", gamma=2.0, method="naive", budget=4, out=tmp_path / "other",
                                  executor=pool)  # fmt: skip
    assert rollouts(run).equals(here)
    assert other.estimate.rollouts.failed == 0


def test_loky_gives_the_same_bits(scenario, here, tmp_path):
    executor = loky.ProcessPoolExecutor(2)
    try:
        run = tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=executor, **ASKED)
    finally:
        executor.shutdown(kill_workers=True)
    assert rollouts(run).equals(here)


def test_an_executor_of_one_s_own_needs_nothing_but_submit(scenario, here, tmp_path):
    """As an adapter to a batch system is: it hands each call to a process and gives back a future."""

    class Adapter:
        def __init__(self, pool):
            self._pool = pool

        def submit(self, call, *arguments) -> Future:
            return self._pool.submit(call, *arguments)

    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        run = tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=Adapter(pool), **ASKED)
    assert rollouts(run).equals(here)


def test_a_pool_of_threads_is_refused_by_name(scenario, tmp_path):
    with (
        ThreadPoolExecutor(2) as pool,
        pytest.raises(InputError, match=r"ThreadPoolExecutor.*threads.*process"),
    ):
        tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=pool, **ASKED)


def test_dask_workers_that_are_threads_of_this_process_are_refused_by_name(scenario, tmp_path):
    with (
        distributed.Client(processes=False, dashboard_address=None) as client,
        pytest.raises(InputError, match=r"ClientExecutor.*threads of this process"),
    ):
        tailroad.estimate(scenario, "idm", out=tmp_path / "run", executor=client.get_executor(), **ASKED)


def test_dask_workers_of_several_threads_are_refused_by_name(scenario, tmp_path):
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
        pytest.raises(WorkerError, match=r"two threads of one worker process.*threads_per_worker=1"),
    ):
        tailroad.estimate(scenario, "idm", gamma=2.0, method="naive", budget=4000, out=tmp_path / "run",
                          executor=client.get_executor())  # fmt: skip


def _die() -> None:
    import os

    os._exit(1)


def test_an_executor_whose_workers_died_is_told_and_the_run_goes_on_with_another(scenario, tmp_path):
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        pool.submit(_die).exception()
        with pytest.raises(WorkerError, match="goes on with a new executor"):
            tailroad.estimate(
                scenario, "idm", gamma=2.0, method="naive", budget=20, out=tmp_path / "run", executor=pool
            )
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        assert tailroad.resume(tmp_path / "run", executor=pool).estimate.rollouts.total == 20


def test_an_ego_of_this_process_does_not_go_to_an_executor(scenario, tmp_path):
    class Mine:
        def reset(self, seed):
            pass

        def act(self, observation):
            return 0.0, 0.0

    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool,
        pytest.raises(InputError, match="'here:Mine' lives in this process"),
    ):
        tailroad.estimate(scenario, Mine, out=tmp_path / "run", executor=pool, **ASKED)
