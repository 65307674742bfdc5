"""A real run: its dangerous rollouts are found, ranked, brought back to the bit, grouped, and remembered."""

import numpy as np
import pytest

import ce
from service.analysis.failures.events import events_of
from service.analysis.failures.find import find_failures
from service.analysis.failures.memory import Memory
from service.analysis.failures.rerun import Rerunner
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.evaluation.pool import Work, run_chunk
from service.evaluation.record import replay
from service.evaluation.store import RunDirectory

ROLLOUTS = 60


class NoRerunner(Rerunner):
    """Has nothing left to run."""

    def run(self, drawn, traced=(), on_done=lambda count: None):
        assert not drawn
        return []


@pytest.fixture(scope="module")
def record(make_scenario, tmp_path_factory):
    """Naive Monte Carlo with 60 rollouts, and the folder of the run."""
    job = make_job(make_scenario(), "idm", 1.5, "naive", 1, {"budget": ROLLOUTS})
    problem = Problem(job)
    x, noise_seeds = ce.draw(problem.base, problem.stream_seed, "estimate", 0, 0, ROLLOUTS)
    folder = tmp_path_factory.mktemp("run")
    with RunDirectory.create(folder, (job,)) as store:
        with problem.simulator() as simulator:
            store.append(job.id, "estimate", 0, run_chunk(simulator, Work(0, x, noise_seeds)))
        return replay(store, job), folder


@pytest.fixture(scope="module")
def found(record):
    with Rerunner(record[0].job) as rerunner:
        return find_failures("run", record[0], rerunner, folder=record[1])


def test_every_dangerous_rollout_comes_back_to_the_bit(record, found):
    failures = found.failures
    assert failures.events == np.count_nonzero(record[0].estimate.f <= 1.5) >= 5
    assert all(f.same_to_the_bit and f.f == f.f_again <= 1.5 for f in failures.failures)
    assert failures.notes == ()


def test_the_likeliest_ranks_first(record, found):
    base = record[0].problem.base
    listed = found.failures.failures
    assert [f.rank for f in listed] == list(range(1, len(listed) + 1))
    x, noise_seeds = zip(*found.examined.events.drawn(found.ranking[: len(listed)]), strict=True)
    density = base.log_density(np.array(x))
    assert density == pytest.approx([f.log_likelihood for f in listed])
    assert density.tolist() == sorted(density, reverse=True)
    assert [str(n) for n in noise_seeds] == [f.noise_seed for f in listed]
    starts = [f.starts_log_likelihood for f in listed]
    drivers = base.blocks[-1]
    assert [d - s for d, s in zip(density, starts, strict=True)] == pytest.approx(
        drivers.log_density(np.array(x)[:, -drivers.dim :])
    )


def test_other_orders_rank_by_f_or_weight(record):
    events = events_of(record[0])
    assert np.all(np.diff(events.f[events.ranking("f")]) >= 0)
    assert events.ranking("weight").tolist() == list(range(len(events)))  # equal weights: by row
    with pytest.raises(InputError, match="likelihood, weight, f"):
        events.ranking("danger")


def test_modes_share_p_among_them(record, found):
    estimate, modes = record[0].estimate, found.failures.modes
    assert sum(m.events for m in modes) == found.failures.examined == found.failures.events
    assert sum(m.share for m in modes) == pytest.approx(1.0)
    assert sum(m.p for m in modes) == pytest.approx(estimate.p)
    for mode in modes:
        assert mode.share_ci[0] <= mode.share <= mode.share_ci[1]
        assert mode.ci[0] <= mode.p <= mode.ci[1] <= estimate.ci[1]
        assert mode.example.mode == mode.mode
        assert mode.typical
    assert [m.share for m in modes] == sorted((m.share for m in modes), reverse=True)


def test_asking_again_runs_nothing(record, found):
    again = find_failures("run", record[0], NoRerunner(record[0].job), folder=record[1])
    assert again.failures == found.failures


def test_what_else_is_asked_for_changes_no_mode(record, found):
    runner = NoRerunner(record[0].job)
    fewer = find_failures("run", record[0], runner, "f", limit=3, folder=record[1])
    assert [(m.mode, m.share) for m in fewer.failures.modes] == [
        (m.mode, m.share) for m in found.failures.modes
    ]


def test_with_fewer_examined_the_first_rows_stand_for_all(record, found):
    some = find_failures("run", record[0], NoRerunner(record[0].job), most=4, folder=record[1]).failures
    estimate = record[0].estimate
    rows = np.flatnonzero(estimate.f <= 1.5)
    assert some.examined == 4
    assert sum(m.p for m in some.modes) == pytest.approx(4 / rows[4])
    assert "first 4 of" in some.notes[0]


def test_nothing_is_remembered_of_another_job_or_another_value(record):
    job, folder = record[0].job, record[1]
    row = int(events_of(record[0]).rows[0])
    f = float(record[0].estimate.f[row])
    assert Memory(job, folder).get((0, row), f) is not None
    assert Memory(job, folder).get((0, row), np.nextafter(f, 0.0)) is None
    other = make_job(job.scenario, "idm", 1.4, "naive", 1, {"budget": ROLLOUTS})
    assert Memory(other, folder).get((0, row), f) is None
    assert Memory(job, None).get((0, row), f) is None


def test_a_damaged_memory_is_as_good_as_none(record, tmp_path):
    (tmp_path / "failures").mkdir()
    (tmp_path / "failures" / "naive.msgpack").write_bytes(b"\x00 not this")
    assert Memory(record[0].job, tmp_path).get((0, 0), 1.0) is None


def test_a_run_without_dangerous_rollouts_has_no_modes(record):
    job = make_job(record[0].job.scenario, "idm", 1e-9, "naive", 1, {"budget": ROLLOUTS})
    with RunDirectory.open(record[1]) as store:
        nothing = replay(store, job)
    failures = find_failures("run", nothing, NoRerunner(job)).failures
    assert (failures.events, failures.modes, failures.failures) == (0, (), ())
    assert "No rollout" in failures.notes[0]
