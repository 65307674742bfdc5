"""What a search learned, from made-up values of f and a stand-in for running rollouts again."""

import dataclasses
import json

import msgspec
import numpy as np
import pytest

import ce
from service.analysis.failures.driving import Driving
from service.analysis.failures.rerun import Rerun, Rerunner
from service.analysis.learned.behaviours import KINDS, Driven, behaviours_of, rate_of
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned, Rate
from service.analysis.learned.parameters import names_of
from service.analysis.learned.scatter import F_CELLS, MOST_DANGEROUS, X_CELLS, scatter_of
from service.analysis.learned.scatter_objects import Scatter
from service.analysis.learned.spreads import sample_spread, spread_of
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Problem, make_job
from service.evaluation.record import replay
from service.evaluation.store import Chunk, RunDirectory
from tests.service.analysis.failures.test_methods import OPTIONS, made_up_f

GAMMA = 0.9
LANE_CHANGES = KINDS[0]


class Hurried(Rerunner):
    """Drivers change lanes twice a km where the ego is fast, else never."""

    def run(self, drawn, traced=(), on_done=lambda count: None):
        return [
            Rerun(
                1.0,
                "horizon",
                None,
                driving=Driving(km=1.0, lane_changes=2 * int(x[3] > 17.0), states=500, speed_mps=500 * x[3]),
            )
            for x, _ in drawn
        ]


@pytest.fixture(scope="module", params=OPTIONS)
def record(request, make_scenario, tmp_path_factory):
    """Runs in which f is low where the ego is fast and its neighbour in lane 2 starts close."""
    job = make_job(make_scenario(), "idm", GAMMA, request.param, 1, OPTIONS[request.param])
    problem = Problem(job)
    with RunDirectory.create(tmp_path_factory.mktemp("learned") / "run", (job,)) as store:

        def run_batch(batch: ce.Batch) -> np.ndarray:
            f, n = made_up_f(batch.x), len(batch.x)
            codes, steps = np.zeros(n, np.uint8), np.full(n, 100, np.int32)
            store.append(
                job.id, batch.phase, batch.iteration, Chunk(batch.start, batch.stop, f, codes, steps, {}, 0.1)
            )
            return f

        evaluate(problem.algorithm, problem.stream_seed, run_batch)
        return replay(store, job)


@pytest.fixture(scope="module")
def learned(record) -> Learned:
    return learned_of("run", record, Hurried(record.job), 150)


def test_the_fast_ego_is_told_and_chance_is_not(record, learned):
    told = {p.name: p.sentence for p in learned.parameters if p.sentence}
    assert "the ego starts" in told["ego.speed_mps"]
    assert "% faster" in told["ego.speed_mps"]
    assert not set(told) - {"ego.speed_mps", "ego.station_m", "env2.station_m"}  # all that f depends on
    assert learned.summary[0] == told["ego.speed_mps"]
    assert learned.source == ("proposal" if record.job.method == "ce" else "dangerous rollouts")


def test_every_parameter_stands_beside_its_base(record, learned):
    assert len(learned.parameters) == 4 * len(record.job.scenario.vehicles)
    speed = next(p for p in learned.parameters if p.name == "ego.speed_mps")
    assert (speed.vehicle, speed.kind, speed.unit) == ("ego", "speed", "m/s")
    assert speed.base.mean == pytest.approx(15.0)
    assert speed.base.sd == pytest.approx(10.0 * 0.05**0.5)  # of 10 Beta(2, 2) + 10
    assert speed.proposal is not None
    assert speed.proposal.mean > 17.0
    assert speed.shift_sd == pytest.approx((speed.proposal.mean - 15.0) / speed.base.sd)
    assert speed.shift_sd_ci[0] < speed.shift_sd < speed.shift_sd_ci[1]
    assert (
        speed.proposal.q05 < speed.proposal.q25 < speed.proposal.q50 < speed.proposal.q75 < speed.proposal.q95
    )


def test_behaviours_come_from_rollouts_run_again(learned):
    changes, speed = learned.behaviours[0], learned.behaviours[-1]
    assert changes.base.low < changes.base.value < changes.base.high < changes.proposal.low
    assert changes.sentence.startswith("the drivers change lanes more often")
    assert speed.proposal.value > speed.base.value
    headway = next(b for b in learned.behaviours if b.name == "headway")
    assert headway.base == Rate(value=None, low=None, high=None)  # nobody followed anybody
    assert headway.sentence == ""
    assert changes.sentence in learned.summary


def test_it_is_what_its_schema_says(learned):
    assert msgspec.convert(json.loads(msgspec.json.encode(learned)), Learned) == learned


def test_nothing_is_claimed_without_events(record):
    nothing = learned_of("run", without_events(record), Hurried(record.job), 0)
    assert nothing.source == "none"
    assert all(p.proposal is None and p.sentence == "" for p in nothing.parameters)
    assert nothing.behaviours == nothing.summary == ()
    assert "nothing is known beyond P0" in nothing.notes[0]


def without_events(record):
    """The same record with the threshold below everything, as of naive Monte Carlo that met no event."""
    estimate = dataclasses.replace(record.estimate, gamma=-1.0)
    job = msgspec.structs.replace(record.job, method="naive")
    return dataclasses.replace(
        record,
        job=job,
        training=(),
        estimate=estimate,
        event_rows=np.zeros(0, np.int64),
        event_log_likelihood=np.zeros(0),
    )


def test_spreads_of_distributions_are_exact():
    uniform = spread_of(ce.Uniform(2.0, 4.0))
    assert (uniform.mean, uniform.sd) == pytest.approx((3.0, 2.0 / 12**0.5), rel=1e-4)
    assert (uniform.q05, uniform.q50) == pytest.approx((2.1, 3.0))
    beta = spread_of(ce.Beta(2.0, 2.0, 10.0, 20.0))
    assert (beta.mean, beta.sd, beta.q50) == pytest.approx((15.0, 5**0.5, 15.0))


def test_spreads_of_weighted_draws():
    rng = np.random.default_rng(1)
    x = rng.random(20_000)
    weighted = sample_spread(x, 2.0 * x)  # density 2 x: mean 2/3, median 1/sqrt(2)
    assert (weighted.mean, weighted.q50) == pytest.approx((2 / 3, 0.5**0.5), abs=0.01)
    assert sample_spread(np.array([1.0, 2.0, 3.0]), np.ones(3)).q50 == 2.0


def driven(counts, km=1.0) -> Driven:
    n = len(counts)
    return Driven([Driving(km=km, lane_changes=int(c)) for c in counts], np.full(n, 1.0 / n), float(n))


def test_a_rate_of_no_event_has_an_upper_end():
    rate = rate_of(LANE_CHANGES, driven([0] * 50), 0.95)
    assert (rate.value, rate.low) == (0.0, 0.0)
    assert rate.high == pytest.approx(-np.log(0.025) / 50)  # exact: of a Poisson count of none


def test_intervals_of_rates_hold_the_rate():
    """400 samples of 40 drives of 1 km with 0.1 lane changes a km: 95% intervals hold it in 93% at least."""
    rng = np.random.default_rng(5)
    rates = [rate_of(LANE_CHANGES, driven(rng.poisson(0.1, 40)), 0.95) for _ in range(400)]
    assert np.mean([r.low <= 0.1 <= r.high for r in rates]) >= 0.93


@pytest.mark.parametrize(("ess", "told"), [(4.6, False), (40.0, True)])
def test_a_behaviour_is_told_only_of_enough_rollouts(ess, told):
    """Ten times the lane changes: a sentence from 40 rollouts of equal weight, none from 4.6, however far apart."""
    before, after = driven([1] * 200), dataclasses.replace(driven([10] * 200), ess=ess)
    found = next(b for b in behaviours_of(before, after, 0.95) if b.name == "lane_changes")
    assert found.sentence.startswith("the drivers change lanes more often") == told
    assert bool(found.sentence) == told


# -- parameters against f ---------------------------------------------------------------------------------------


def test_every_rollout_of_the_sample_lies_in_a_cell_and_every_dangerous_one_is_told(record):
    found = scatter_of("r", record, Hurried(record.job), 7)
    names = names_of(record.job.scenario)
    assert [axis.name for axis in found.axes[: len(names)]] == [f"{v or 'weather'}.{k}" for v, k in names]
    assert found.recorded >= found.sampled == len(record.starts_f) > 0
    for axis in found.axes[: len(names)]:
        counts = np.array(axis.counts)
        assert counts.shape == (F_CELLS, X_CELLS)
        assert counts.sum() == np.isfinite(record.starts_f).sum()
    assert len(found.dangerous) == min(found.events, MOST_DANGEROUS) > 0
    assert all(one.f is not None and one.f <= GAMMA for one in found.dangerous)
    assert [one.f for one in found.dangerous[:5]] == sorted(one.f for one in found.dangerous)[:5]
    assert all(len(one.values) == len(found.axes) for one in found.dangerous)
    assert (
        sum(one.values[-1] is not None for one in found.dangerous) == found.run_again == min(7, found.events)
    )
    assert {axis.kind for axis in found.axes[len(names) :]} == {"behaviour"}
    assert msgspec.json.decode(msgspec.json.encode(found), type=Scatter) == found


def test_values_told_of_a_dangerous_rollout_are_those_it_was_drawn_with(record):
    found = scatter_of("r", record, Hurried(record.job), 0)
    one = found.dangerous[0]
    x, _ = record.redraw(one.phase, one.iteration, one.row)
    np.testing.assert_allclose(one.values, x[: len(one.values)], rtol=1e-5)
    assert made_up_f(x[None])[0] == one.f
    assert found.run_again == 0
