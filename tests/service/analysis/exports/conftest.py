"""Rollouts to export."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import ce
from service.analysis.trace import Trace, record
from service.evaluation.job import Problem, make_job
from service.world.scenario import load_scenario


@pytest.fixture(scope="session")
def trace_of() -> Callable[[str], Trace]:
    """The first rollout of a scenario by name, driven by idm, with seed 1."""

    def trace(scenario: str) -> Trace:
        problem = Problem(
            make_job(load_scenario(scenario), "idm", gamma=0.0, method="naive", seed=1, options={})
        )
        x, noise = ce.draw(problem.base, 1, "estimate", 0, 0, 1)
        with problem.simulator() as simulator:
            return record(problem, simulator, x[0], int(noise[0]))

    return trace
