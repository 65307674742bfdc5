"""What a worker's process refuses to run: files that are not the scheduler's, and rows that it draws otherwise."""

from __future__ import annotations

import pytest

from service.evaluation.job import Job, Problem, make_job
from service.remote.fleet.messages import ChunkKey, Drawn, Failed, JobSpec, Lease
from service.remote.fleet.runner import _Bench
from service.remote.fleet.versions import digests


@pytest.fixture(scope="module")
def job(make_scenario) -> Job:
    return make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})


@pytest.mark.parametrize(("what", "named"), [("road", "the road 'i80'"), ("drivers", "the drivers '")])
def test_a_job_whose_files_differ_is_refused_by_name(job, what, named):
    theirs = digests(Problem(job)) | {what: "0" * 16}
    told = _Bench("w").open(JobSpec("j1", job, theirs))
    assert named in told
    assert "of job j1 differ from the scheduler's; install the same files" in told


def test_rows_that_are_drawn_otherwise_here_are_asked_for(job):
    problem = Problem(job)
    bench = _Bench("w")
    bench._problem, bench._simulator = problem, object()  # no rollout is run
    lease = Lease(
        7, ChunkKey("j1", "estimate", 0, 0, 2, "0" * 16), Drawn(1, problem.base.parameters().tobytes()), 9.0
    )
    told = bench.run(lease)
    assert isinstance(told, Failed)
    assert told.explicit
    assert "random draws" in told.reason
