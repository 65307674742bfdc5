"""What the tables of a page withhold: ratios made of a variance that says nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec
import numpy as np
import pytest

from service.studies.reproduce.local import Outcome
from service.studies.reproduce.plans import Plan, Run, Truth
from service.studies.reproduce.results import Reading, Result
from service.studies.reproduce.tables import LEAST_EFFECTIVE, tables_of, thresholds_table

P, N = 1e-3, 100_000
RUN = Run(
    series="tried",
    scenario="i80-paper-10s",
    ego="idm",
    gamma=0.5,
    method="ce",
    options={"budget": 1000},
    seed=1,
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
    plan = Plan(name="table1", scale="smoke", title="", truth=Truth(scenario="i80-paper-10s", ego="idm", rollouts=N),
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


def test_a_single_run_has_no_spread_beside_a_series_that_was_repeated():
    tried = outcome(LEAST_EFFECTIVE)
    (result,) = tried.results
    once = msgspec.structs.replace(result, run=msgspec.structs.replace(RUN, series="once"))
    again = msgspec.structs.replace(result, run=msgspec.structs.replace(RUN, seed=2))
    tables = {table.title: table for table in tables_of(replace(tried, results=(result, again, once)))}
    together = tables["Repeats together, ± standard error from their spread"].rows
    assert [row[0] for row in together] == ["tried", "naive Monte Carlo (ground truth)"]
    assert not any("nan" in cell for row in together for cell in row)
    assert tables["Efficiency by repeated runs, training counted"].rows[1][1] == "–"


def test_thresholds_are_order_statistics_as_far_as_the_ground_truth_goes():
    """f uniform on (0, 10 s): p is a tenth of the threshold."""

    class Uniform(Known):
        def at(self, gammas):
            p = np.asarray(gammas) / 10.0
            return {"events": np.floor(N * p + 1e-9).astype(int)}

    rows = thresholds_table(Outcome(outcome(1.0).plan, Uniform(), (), False)).rows
    assert [(row[0], row[1], row[3]) for row in rows] == [
        ("0.010", "0.100 s", "1,000"),
        ("0.0010", "0.010 s", "100"),
        ("1.0 × 10⁻⁴", "0.002 s", "10"),  # 1 ms is finer than what is read
        ("1.0 × 10⁻⁵", "0.002 s", "1"),
    ]
    # 1,000 of 100,000, plus or minus 1.96 times the square root of 990
    assert rows[0][2] == "0.094 s to 0.108 s"
    assert rows[3][2].startswith("not known to")
