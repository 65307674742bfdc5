"""Egos on the same real rollouts."""

import json

import msgspec
import numpy as np
import pytest

import ce
from ce.interval import clopper_pearson
from service.analysis.comparison.compare import change_of, comparison_of
from service.analysis.comparison.differences import bounds_of
from service.analysis.comparison.objects import Comparison, Pair
from service.analysis.comparison.words import pair_summary
from service.analysis.report.comparison import write_comparison
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.evaluation.pool import Work, run_chunk
from service.evaluation.record import replay
from service.evaluation.store import RunDirectory

ROLLOUTS = 40


@pytest.fixture(scope="module")
def records(make_scenario, tmp_path_factory):
    """The same 40 draws with the ego that follows and with one that drives as it likes."""
    found = []
    for ego in ("idm", "lidar"):
        job = make_job(make_scenario(), ego, 1.5, "naive", 1, {"budget": ROLLOUTS})
        problem = Problem(job)
        x, noise_seeds = ce.draw(problem.base, problem.stream_seed, "estimate", 0, 0, ROLLOUTS)
        folder = tmp_path_factory.mktemp(ego)
        with RunDirectory.create(folder, (job,)) as store:
            with problem.simulator() as simulator:
                store.append(job.id, "estimate", 0, run_chunk(simulator, Work(0, x, noise_seeds)))
            found.append((replay(store, job), folder))
    return found


@pytest.fixture(scope="module")
def compared(records) -> Comparison:
    (a, folder_a), (b, folder_b) = records
    return comparison_of([a, b], ["first", "second"], folders=[folder_a, folder_b])


@pytest.fixture(scope="module")
def pair(compared) -> Pair:
    (found,) = compared.pairs
    return found


def test_it_says_what_ce_says_of_both(records, compared, pair):
    a, b = (record.estimate for record, _ in records)
    assert [side.p for side in compared.sides] == [a.p, b.p]
    assert [side.name for side in compared.sides] == ["idm", "lidar"]
    assert (pair.a, pair.b) == (0, 1)
    assert pair.difference.difference == b.p - a.p
    assert pair.difference.paired
    assert pair.draws is not None
    assert pair.draws.both + pair.draws.only_a == a.events
    assert pair.draws.both + pair.draws.only_b == b.events
    low, high = pair.difference.difference_ci
    assert low <= pair.difference.difference <= high


def test_modes_of_both_add_up_and_say_which_came_and_went(compared, pair):
    a, b = compared.sides
    assert sum(m.a.events for m in pair.modes) == a.events
    assert sum(m.b.events for m in pair.modes) == b.events
    assert sum(m.a.p for m in pair.modes) == pytest.approx(a.p)
    for mode in pair.modes:
        low, high = mode.difference.difference_ci
        assert (mode.change == "unclear") == (low <= 0.0 <= high)
        assert (mode.change == "appeared") == (low > 0.0 and mode.a.events == 0)
        assert (mode.change == "vanished") == (high < 0.0 and mode.b.events == 0)
        assert mode.difference.difference == pytest.approx(mode.b.p - mode.a.p)


@pytest.mark.parametrize(
    ("events", "change"), [((0, 1), "unclear"), ((0, 40), "appeared"), ((2, 40), "more"), ((3, 4), "unclear")]
)
def test_a_mode_came_or_went_only_where_the_interval_says_so(events, change):
    """Of 1,000 rollouts of each: one event against none is what chance does."""
    shares = [(k / 1000, *clopper_pearson(k, 1000, 0.975)) for k in events]
    found = bounds_of(*shares)
    back = bounds_of(*reversed(shares))
    assert change_of(found, *events) == change
    assert change_of(back, *reversed(events)) == {"appeared": "vanished", "more": "less"}.get(change, change)


def test_the_words_name_what_is_clear_and_count_what_is_not(compared, pair):
    mode = pair.modes[0]
    modes = [msgspec.structs.replace(mode, name=name, change=change) for name, change in
             (("cut in", "appeared"), ("boxed in", "unclear"), ("rear end", "unclear"))]  # fmt: skip
    said = pair_summary(compared.sides, pair.difference, modes, "f <= 1.5 s", 0.95)
    assert "p(f <= 1.5 s) is" in said
    assert "Ways to fail met in lidar only: cut in." in said
    assert "In the 2 other ways to fail they are not distinguishable." in said
    assert "boxed in" not in said


def test_the_other_way_round_it_is_mirrored(records, pair):
    (a, folder_a), (b, folder_b) = records
    (back,) = comparison_of([b, a], ["second", "first"], folders=[folder_b, folder_a]).pairs
    low, high = pair.difference.difference_ci
    assert back.difference.difference_ci == pytest.approx((-high, -low))
    swapped = {"appeared": "vanished", "vanished": "appeared", "more": "less", "less": "more"}
    assert {m.mode: swapped.get(m.change, m.change) for m in back.modes} == {
        m.mode: m.change for m in pair.modes
    }


def test_of_three_each_is_held_against_each_before_it(records):
    (a, _), (b, _) = records
    found = comparison_of([a, b, a], ["first", "second", "third"], most=0)
    assert [(p.a, p.b) for p in found.pairs] == [(0, 1), (0, 2), (1, 2)]
    assert [side.name for side in found.sides] == ["first", "lidar", "third"]
    assert found.pairs[1].difference.difference == 0.0
    assert len(found.curves.sides) == 3


def test_all_curves_meet_the_estimates_at_gamma(compared):
    at = compared.curves.gamma.index(1.5)
    for side, line in zip(compared.sides, compared.curves.sides, strict=True):
        assert line.p[at] == side.p
        assert np.all(np.diff(line.p) >= 0)


def test_another_threshold_counts_other_rollouts(records, pair):
    a = records[0][0]
    wider = []
    for record, folder in records:
        with RunDirectory.open(folder) as store:
            wider.append(replay(store, record.job, 3.0))
    found = comparison_of(wider, ["first", "second"], most=0)
    assert found.gamma == 3.0
    assert found.sides[0].p == a.estimate.curve([3.0]).p[0]
    assert found.sides[0].events == np.count_nonzero(a.estimate.f <= 3.0) == wider[0].event_rows.size


def test_runs_of_different_events_are_not_compared(records, make_scenario):
    (a, _), (b, folder) = records
    other = make_job(b.job.scenario, "lidar", 1.4, "naive", 1, {"budget": ROLLOUTS})
    with (
        RunDirectory.open(folder) as store,
        pytest.raises(InputError, match=r"gamma 1\.5 and second gamma 1\.4"),
    ):
        comparison_of([a, replay(store, other)], ["first", "second"], most=0)


def test_the_page_and_the_json_say_the_same(compared, tmp_path):
    write_comparison(compared, tmp_path / "both.html")
    html = (tmp_path / "both.html").read_text(encoding="utf-8")
    assert "lidar against idm" in html
    for mode in compared.pairs[0].modes:
        assert mode.name in html
    assert "<script" not in html
    told = msgspec.convert(json.loads((tmp_path / "both.json").read_text()), Comparison)
    assert told == compared
