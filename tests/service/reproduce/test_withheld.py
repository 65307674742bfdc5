"""What the tables of a page withhold: ratios made of a variance that says nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from service.reproduce.local import Outcome
from service.reproduce.plans import Plan, Run, Truth
from service.reproduce.results import Reading, Result
from service.reproduce.tables import LEAST_EFFECTIVE, tables_of

P, N = 1e-3, 100_000
RUN = Run(
    series="tried", scenario="i80-10s", ego="idm", gamma=0.5, method="ce", options={"budget": 1000}, seed=1
)


@dataclass(frozen=True)
class Known:
    """A ground truth of N rollouts."""

    rollouts: int = N
    worker_s: float = 1.0

    def at(self, gammas):
        p = np.full(len(gammas), P)
        return {
            "p": p,
            "low": 0.8 * p,
            "high": 1.2 * p,
            "events": (N * p).astype(int),
            "std_error": np.sqrt(p / N),
        }


def outcome(ess: float) -> Outcome:
    reading = Reading(
        gamma=0.5, p=P, std_error=1e-100, low=0.0, high=1.0, events=40, ess=ess, variance_error=0.1
    )
    result = Result(run=RUN, method="ce", rollouts=1000, training=500, readings=(reading,), warnings=("few-events",),
                    reliable=False, max_weight_share=0.9, worker_s=1.0, sim_s=1.0, wall_s=1.0,
                    tailroad="0")  # fmt: skip
    plan = Plan(name="table1", scale="smoke", title="", truth=Truth(scenario="i80-10s", ego="idm", rollouts=N),
                gammas=(0.5,), runs=(RUN,))  # fmt: skip
    return Outcome(plan, Known(), (result,), False)


@pytest.mark.parametrize(("ess", "withheld"), [(LEAST_EFFECTIVE - 0.1, True), (LEAST_EFFECTIVE, False)])
def test_a_variance_of_hardly_any_effective_events_is_compared_with_nothing(ess, withheld):
    tables = {table.title: table for table in tables_of(outcome(ess))}
    for title in ("Ratio of variances, training left out", "Efficiency, training counted"):
        (row,) = tables[title].rows
        assert row[0] == "tried *"
        assert (row[1] == "–") == withheld
    assert tables["Ratio of rare events to naive Monte Carlo"].rows[0][1] != "–"
