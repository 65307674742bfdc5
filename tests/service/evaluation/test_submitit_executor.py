"""Rollouts in jobs of submitit, and in processes of MPI: the same bits as here."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from concurrent.futures import BrokenExecutor
from pathlib import Path

import polars as pl
import pytest

import tailroad
from service.errors import InputError
from service.evaluation.submitit_executor import SubmititExecutor

ROOT = Path(__file__).parents[3]
ASKED = {"gamma": 2.0, "method": "naive", "budget": 300}
POLL_S = 0.1


class Now:
    """Stands for submitit: a job is over as soon as it is submitted."""

    def __init__(self) -> None:
        self.calls: list[int] = []

    def submit(self, fn, *arguments):
        self.calls.append(len(arguments[0]))
        found = fn(*arguments)

        class Job:
            def done(self):
                return True

            def result(self):
                return found

        return Job()


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> pl.DataFrame:
    """The rollouts of a run in a process of this machine."""
    return rollouts(
        tailroad.estimate(
            "i80-paper-10s", "idm", out=tmp_path_factory.mktemp("here") / "run", workers=1, **ASKED
        )
    )


def rollouts(run: tailroad.Run) -> pl.DataFrame:
    return run.to_polars().sort("phase", "iteration", "row")


def test_waiting_calls_are_dealt_out_evenly_to_the_jobs():
    now = Now()
    with SubmititExecutor(now, jobs=4, poll_s=POLL_S) as executor:
        futures = [executor.submit(pow, 2, n) for n in range(10)]
        assert [future.result() for future in futures] == [2**n for n in range(10)]
    assert sum(now.calls) == 10
    assert max(now.calls) <= 3  # not all by one job, however many of them waited when jobs were begun
    with pytest.raises(RuntimeError, match="after shutdown"):
        executor.submit(pow, 2, 2)


def test_what_a_call_raises_is_its_own():
    with SubmititExecutor(Now(), jobs=1, poll_s=POLL_S) as executor:
        wrong, right = executor.submit(divmod, 1, 0), executor.submit(divmod, 7, 2)
        assert right.result() == (3, 1)
        with pytest.raises(ZeroDivisionError):
            wrong.result()


def test_a_job_that_ends_early_breaks_its_calls():
    class Lost(Now):
        def submit(self, fn, *arguments):
            job = super().submit(fn, *arguments)

            def lost():
                raise RuntimeError("preempted")

            job.result = lost
            return job

    with (
        SubmititExecutor(Lost(), jobs=1, poll_s=POLL_S) as executor,
        pytest.raises(BrokenExecutor, match="preempted"),
    ):
        executor.submit(pow, 2, 2).result()


def test_calls_that_no_job_has_yet_are_cancelled():
    executor = SubmititExecutor(Now(), jobs=1, poll_s=3600.0)
    future = executor.submit(pow, 2, 2)
    executor.shutdown(cancel_futures=True)
    assert future.cancelled()


def test_jobs_of_this_machine_give_the_same_bits(here, tmp_path):
    submitit = pytest.importorskip("submitit", reason="submitit is not installed: make test does it")
    local = submitit.AutoExecutor(tmp_path / "logs", cluster="local")
    with SubmititExecutor(local, jobs=2, poll_s=POLL_S) as executor:
        run = tailroad.estimate("i80-paper-10s", "idm", out=tmp_path / "run", executor=executor, **ASKED)
    assert rollouts(run).equals(here)


def test_jobs_within_this_process_are_refused_by_name(tmp_path):
    submitit = pytest.importorskip("submitit", reason="submitit is not installed: make test does it")
    debug = submitit.AutoExecutor(tmp_path / "logs", cluster="debug")
    with (
        SubmititExecutor(debug, jobs=1, poll_s=POLL_S) as executor,
        pytest.raises(InputError, match=r"SubmititExecutor.*this process"),
    ):
        tailroad.estimate("i80-paper-10s", "idm", out=tmp_path / "run", executor=executor, **ASKED)


def test_a_job_that_dies_is_told_and_the_run_goes_on_elsewhere(tmp_path):
    submitit = pytest.importorskip("submitit", reason="submitit is not installed: make test does it")
    local = submitit.AutoExecutor(tmp_path / "logs", cluster="local")
    with SubmititExecutor(local, jobs=1, poll_s=POLL_S) as executor:
        with pytest.raises(BrokenExecutor, match="ended before its work did"):
            executor.submit(os._exit, 1).result()
        assert executor.submit(pow, 2, 3).result() == 8


def test_processes_of_mpi_give_the_same_bits(here, tmp_path):
    pytest.importorskip("mpi4py", reason="mpi4py is not installed: make test does it")
    script = tmp_path / "ask.py"
    script.write_text(
        "import sys\n"
        "import tailroad\n"
        "from mpi4py.futures import MPIPoolExecutor\n"
        "if __name__ == '__main__':\n"
        "    with MPIPoolExecutor() as executor:\n"
        f"        tailroad.estimate('i80-paper-10s', 'idm', out=sys.argv[1], executor=executor, **{ASKED!r})\n"
    )
    mpiexec = Path(sysconfig.get_path("scripts")) / "mpiexec"
    command = [mpiexec, "-n", "2", sys.executable, "-m", "mpi4py.futures", script, tmp_path / "run"]
    subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True, timeout=240)
    assert rollouts(tailroad.resume(tmp_path / "run")).equals(here)
