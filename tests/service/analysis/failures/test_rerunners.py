"""Processes that run rollouts again are shared by all that asks for them, and end with it."""

from __future__ import annotations

import ce
from service.analysis.failures.rerun import Rerunners
from service.evaluation.job import Problem, make_job
from service.world.scenario import load_scenario


def test_one_process_serves_all_that_is_asked_within_and_ends_after_it():
    job = make_job(load_scenario("i80-10s"), "idm", gamma=0.0, method="naive", seed=1, options={})
    x, noise = ce.draw(Problem(job).base, 1, "estimate", 0, 0, 20)
    drawn = list(zip(x, noise.tolist(), strict=True))
    with Rerunners(workers=2) as opened:
        with opened(job) as first:
            found = first.run(drawn)
            began = first._processes.pids()
        with opened(job) as second:
            again = second.run(drawn)
        assert second is first
        assert second._processes.pids() == began
        assert len(began) == 1
    assert second._processes.pids() == []
    assert [one.f for one in again] == [one.f for one in found]
