"""Processes that wait for the next question about a job."""

from __future__ import annotations

import threading
from typing import ClassVar

import msgspec
import pytest

from service.evaluation.job import make_job
from service.remote.api import reruns
from service.remote.api.reruns import Reruns


class Counted:
    """Stands for a rerunner."""

    made: ClassVar[list[Counted]] = []

    def __init__(self, job, procs):
        self.job, self.open = job, True
        self.made.append(self)

    def close(self):
        self.open = False


@pytest.fixture
def jobs(make_scenario, monkeypatch):
    monkeypatch.setattr(reruns, "Rerunner", Counted)
    monkeypatch.setattr(Counted, "made", [])
    first = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})
    return [msgspec.structs.replace(first, seed=seed) for seed in (1, 2, 3)]


def test_the_next_question_about_a_job_finds_the_same_processes_and_old_jobs_are_put_away(jobs):
    kept = Reruns(1, most=2, idle_s=1000.0)
    for job in (jobs[0], jobs[0], jobs[1], jobs[0], jobs[2]):
        with kept.of(job) as rerunner:
            assert rerunner.job == job
    assert [one.job.seed for one in Counted.made] == [1, 2, 3]
    assert [one.open for one in Counted.made] == [True, False, True]  # the one that was used longest ago
    kept.close()
    assert not any(one.open for one in Counted.made)
    with kept.of(jobs[0]) as late:
        pass
    assert not late.open


def test_an_error_ends_them_and_two_at_a_time_each_have_their_own(jobs):
    kept = Reruns(1, most=2, idle_s=1000.0)
    with pytest.raises(ValueError, match="spoilt"), kept.of(jobs[0]) as spoilt:
        raise ValueError("spoilt")
    assert not spoilt.open
    with kept.of(jobs[0]) as one, kept.of(jobs[0]) as other:
        assert one is not other
        assert one.open
        assert other.open
    assert [one.open, other.open] == [False, True]
    kept.close()


def test_who_has_waited_long_is_ended(jobs):
    now = [0.0]
    kept = Reruns(1, most=2, idle_s=60.0, clock=lambda: now[0])
    for job in jobs[:2]:
        with kept.of(job):
            now[0] += 40.0
    now[0] = 70.0
    kept.drop_idle()
    assert [one.open for one in Counted.made] == [True, True]
    now[0] = 110.0
    kept.drop_idle()
    assert [one.open for one in Counted.made] == [False, True]
    kept.close()


def test_they_are_ended_without_anybody_asking(jobs):
    kept = Reruns(1, most=2, idle_s=0.01)
    ended = threading.Event()
    with kept.of(jobs[0]) as rerunner:
        rerunner.close = ended.set
    assert ended.wait(60.0)
    kept.close()
