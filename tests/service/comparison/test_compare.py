"""Two egos on the same real rollouts."""

import json

import msgspec
import numpy as np
import pytest

import ce
from service.comparison.compare import comparison_of
from service.comparison.objects import Comparison
from service.errors import InputError
from service.job import Problem, make_job
from service.pool import Work, run_chunk
from service.record import replay
from service.report.comparison import write_comparison
from service.store import RunDirectory

ROLLOUTS = 40


@pytest.fixture(scope="module")
def records(make_scenario, tmp_path_factory):
    """The same 40 draws with the ego that follows and with one that drives as it likes."""
    found = []
    for ego in ("idm", "lidar"):
        job = make_job(make_scenario(), ego, 1.5, "naive", 1, {"budget": ROLLOUTS})
        problem = Problem(job)
        x, noise = ce.draw(problem.base, problem.stream_seed, "estimate", 0, 0, ROLLOUTS)
        folder = tmp_path_factory.mktemp(ego)
        with RunDirectory.create(folder, (job,)) as store:
            with problem.simulator() as simulator:
                store.append(job.id, "estimate", 0, run_chunk(simulator, Work(0, x, noise)))
            found.append((replay(store, job), folder))
    return found


@pytest.fixture(scope="module")
def compared(records) -> Comparison:
    (a, folder_a), (b, folder_b) = records
    return comparison_of(a, b, ("first", "second"), folders=(folder_a, folder_b))


def test_it_says_what_ce_says_of_both(records, compared):
    a, b = (record.estimate for record, _ in records)
    assert (compared.a.p, compared.b.p) == (a.p, b.p)
    assert (compared.a.name, compared.b.name) == ("idm", "lidar")
    assert compared.difference.difference == b.p - a.p
    assert compared.difference.paired
    assert compared.pairs is not None
    assert compared.pairs.both + compared.pairs.only_a == a.events
    assert compared.pairs.both + compared.pairs.only_b == b.events
    low, high = compared.difference.difference_ci
    assert low <= compared.difference.difference <= high


def test_modes_of_both_add_up_and_say_which_came_and_went(compared):
    assert sum(m.a.events for m in compared.modes) == compared.a.events
    assert sum(m.b.events for m in compared.modes) == compared.b.events
    assert sum(m.a.p for m in compared.modes) == pytest.approx(compared.a.p)
    for mode in compared.modes:
        assert (mode.change == "appeared") == (mode.a.events == 0)
        assert (mode.change == "vanished") == (mode.b.events == 0)
        assert mode.difference.difference == pytest.approx(mode.b.p - mode.a.p)


def test_the_other_way_round_it_is_mirrored(records, compared):
    (a, folder_a), (b, folder_b) = records
    back = comparison_of(b, a, ("second", "first"), folders=(folder_b, folder_a))
    low, high = compared.difference.difference_ci
    assert back.difference.difference_ci == pytest.approx((-high, -low))
    swapped = {"appeared": "vanished", "vanished": "appeared", "more": "less", "less": "more"}
    assert {m.mode: swapped.get(m.change, m.change) for m in back.modes} == {
        m.mode: m.change for m in compared.modes
    }


def test_both_curves_meet_the_estimates_at_gamma(compared):
    at = compared.curves.gamma.index(1.5)
    assert (compared.curves.a[at], compared.curves.b[at]) == (compared.a.p, compared.b.p)
    assert np.all(np.diff(compared.curves.a) >= 0)


def test_runs_of_different_events_are_not_compared(records, make_scenario):
    (a, _), (b, folder) = records
    other = make_job(b.job.scenario, "lidar", 1.4, "naive", 1, {"budget": ROLLOUTS})
    with (
        RunDirectory.open(folder) as store,
        pytest.raises(InputError, match=r"gamma 1\.5 and second gamma 1\.4"),
    ):
        comparison_of(a, replay(store, other), ("first", "second"), most=0)


def test_the_page_and_the_json_say_the_same(compared, tmp_path):
    write_comparison(compared, tmp_path / "both.html")
    html = (tmp_path / "both.html").read_text(encoding="utf-8")
    assert "lidar against idm" in html
    for mode in compared.modes:
        assert mode.name in html
    assert "<script" not in html
    told = msgspec.convert(json.loads((tmp_path / "both.json").read_text()), Comparison)
    assert told == compared
