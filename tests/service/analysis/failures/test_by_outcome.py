"""Failures by how rollouts ended, whatever their f, for every method: made-up values and endings."""

import numpy as np
import pytest

from service.analysis.failures.events import events_of
from service.analysis.failures.find import find_failures
from service.errors import InputError
from service.evaluation.pool import OUTCOME_CODES
from service.evaluation.record import replay
from tests.service.analysis.failures.test_methods import GAMMA, OPTIONS, StandIn, made_up_f, made_up_run

COLLISION, HORIZON = OUTCOME_CODES["collision"], OUTCOME_CODES["horizon"]


def collides(x: np.ndarray) -> np.ndarray:
    """Where the ego is quick and its neighbour starts just ahead, which f does not tell."""
    return (x[:, 3] > 18.0) & (x[:, 8] > x[:, 0]) & (x[:, 8] < x[:, 0] + 8.0)


@pytest.fixture(params=OPTIONS)
def run(request, make_scenario, tmp_path):
    def ended(x: np.ndarray) -> np.ndarray:
        return np.where(collides(x), COLLISION, HORIZON).astype(np.uint8)

    with made_up_run(make_scenario(), request.param, tmp_path / "run", ended) as made:
        yield made


def test_those_that_ended_so_are_found_whatever_their_f(run):
    record = replay(*run, outcome="collision")
    found = find_failures("run", record, StandIn(record.job), limit=50)
    failures = found.failures
    (ending,) = (e for e in record.endings if e.outcome == "collision")
    assert failures.outcome == "collision"
    assert failures.gamma == GAMMA
    assert failures.events > 5
    assert failures.p == pytest.approx(ending.p)
    assert failures.ci == pytest.approx(ending.ci)
    x = np.array([x for x, _ in found.examined.events.drawn(found.ranking)])
    assert collides(x).all()
    assert all(f.same_to_the_bit for f in failures.failures)
    assert np.array_equal(found.examined.events.f[found.ranking], made_up_f(x))
    assert sum(m.share for m in failures.modes) == pytest.approx(1.0)
    assert sum(m.p for m in failures.modes) == pytest.approx(failures.p, rel=1e-6)


def test_it_goes_beyond_the_threshold_where_the_method_has_looked_there(run):
    store, job = run
    events, dangerous = events_of(replay(store, job, outcome="collision")), events_of(replay(store, job))
    assert set(dangerous.f > GAMMA) == {False}
    if job.method == "naive":
        assert (events.f > GAMMA).any()
        assert (events.f <= GAMMA).any()


def test_an_ending_that_nobody_has_had_and_one_that_there_is_not(run):
    record = replay(*run, outcome="reversing")
    failures = find_failures("run", record, StandIn(record.job)).failures
    assert failures.events == 0
    assert "No rollout of the estimation has ended with reversing." in failures.notes
    for name in ("error", "crash"):
        with pytest.raises(InputError, match=f"no outcome named '{name}'; there are horizon, .*collision"):
            replay(*run, outcome=name)
