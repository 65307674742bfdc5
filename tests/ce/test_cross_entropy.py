import math
import time

import numpy as np
import pytest

import ce
from tests.reference.problems import BETAS, CORRELATED, LINEAR_2, LINEAR_404

PAPER = ce.CrossEntropyOptions(
    iterations=4, samples_per_iteration=500, estimation_rollouts=1200, batch_size=500
)


def run(algorithm, f, seed=0, through_bytes=False):
    state, records = algorithm.init(seed), []
    while (batch := algorithm.propose(state)) is not None:
        if through_bytes:
            state = algorithm.from_bytes(ce.to_bytes(state))
        state, record = algorithm.update(state, batch, f(batch.x))
        records.append(record)
    return state, records


def free(budget, **more):
    return ce.CrossEntropyOptions(**{"budget": budget, "mean_box": None, **more})


@pytest.mark.parametrize(
    ("problem", "options", "seeds"),
    [
        (LINEAR_2, free(20_000), 20),
        (CORRELATED, free(20_000), 20),
        (CORRELATED, free(20_000, learn_covariance=True, rho=0.05), 10),
        (BETAS, free(20_000, beta_bounds=(0.2, 50.0), rho=0.05), 20),
        (BETAS, ce.CrossEntropyOptions(budget=40_000), 10),
        (LINEAR_404, free(30_000, iterations=4, rho=0.1, max_kl=6.0, estimation_rollouts=10_000), 4),
    ],
    ids=["linear", "correlated", "learned covariance", "betas", "betas in the paper's bounds", "d=404"],
)
def test_known_probabilities_are_found(problem, options, seeds):
    """|z| < 4 at each seed and a mean z that is zero within its own error, but for the skewness of weights."""
    estimates = [
        ce.estimate(problem.f, problem.base, problem.gamma, "ce", options=options, seed=s)
        for s in range(seeds)
    ]
    z = np.array([(e.p - problem.p) / e.std_error for e in estimates])
    assert np.abs(z).max() < 4
    assert abs(z.mean()) < 4 / math.sqrt(seeds)
    assert all(e.efficiency > 5 for e in estimates)
    assert all(e.rollouts == options.resolved().budget for e in estimates)
    relative = np.array([e.p / problem.p - 1 for e in estimates])
    assert abs(relative.mean()) < 4 * relative.std(ddof=1) / math.sqrt(seeds)


def test_search_keeps_to_the_papers_constraints_exactly():
    rng = np.random.default_rng(0)
    mean = rng.normal(size=30)
    base = ce.Product([*(ce.Beta(2, 2) for _ in range(4)), ce.Normal(mean, 0.02**2 * np.eye(30))])
    algorithm = ce.algorithm(
        "ce",
        base,
        -1.0,
        ce.CrossEntropyOptions(iterations=6, samples_per_iteration=500, estimation_rollouts=10),
    )
    state = algorithm.init(0)
    moved = False
    while state.phase == "train":
        batch = algorithm.propose(state)
        f = batch.x[:, :4].sum(axis=1) + 50 * (batch.x[:, 4:8] - mean[:4]).sum(axis=1)
        state, _ = algorithm.update(state, batch, f)
        proposal = algorithm.proposal(state)
        assert np.all((proposal.betas.alpha >= 1.5) & (proposal.betas.alpha <= 7.0))
        assert np.all((proposal.betas.beta >= 1.5) & (proposal.betas.beta <= 7.0))
        shift = np.abs(proposal.normals[0][1].mean - mean)
        assert np.all(shift <= 0.01)
        moved |= bool(shift.max() > 0.009)
        np.testing.assert_array_equal(proposal.normals[0][1].cov, base.normals[0][1].cov)
    assert moved


def test_threshold_never_falls_below_gamma_and_the_lowest_quantile_is_chosen():
    algorithm = ce.algorithm("ce", BETAS.base, BETAS.gamma, PAPER)
    state, sampled = algorithm.init(3), []
    while state.phase == "train":
        batch = algorithm.propose(state)
        sampled.append(state.parameters)
        f = BETAS.f(batch.x)
        state, record = algorithm.update(state, batch, f)
        assert record.quantile == np.sort(f)[4]  # ceil(0.01 * 500) = 5th smallest
        assert record.gamma_k == max(BETAS.gamma, record.quantile)
        assert record.elites == np.count_nonzero(f <= record.gamma_k)
    assert len(state.records) == 4
    lowest = int(np.argmin([r.quantile for r in state.records]))
    np.testing.assert_array_equal(algorithm.propose(state).parameters, sampled[lowest])


def test_one_step_is_algorithm_1_written_out():
    base, o = LINEAR_2.base, free(None, iterations=3, samples_per_iteration=1000, estimation_rollouts=10)
    algorithm = ce.algorithm("ce", base, LINEAR_2.gamma, o)
    state = algorithm.init(1)
    state, _ = algorithm.update(state, b := algorithm.propose(state), LINEAR_2.f(b.x))
    mu = state.parameters
    batch = algorithm.propose(state)
    f = LINEAR_2.f(batch.x)
    gamma_k = max(0.0, np.sort(f)[9])
    w = np.exp(-batch.x @ mu + 0.5 * mu @ mu) * (f <= gamma_k)
    expected = 0.8 * (w[:, None] * batch.x).sum(axis=0) / w.sum() + 0.2 * mu
    after, record = algorithm.update(state, batch, f)
    np.testing.assert_allclose(after.parameters, expected, rtol=1e-12)
    assert record.ess == pytest.approx(w.sum() ** 2 / (w**2).sum())
    assert record.kl == pytest.approx(0.5 * mu @ mu)


def test_resuming_at_every_step_gives_the_same_bits():
    for options in (PAPER, ce.CrossEntropyOptions(**{**vars(PAPER), "rel_error": 0.3})):
        algorithm = ce.algorithm("ce", BETAS.base, BETAS.gamma, options)
        straight, records = run(algorithm, BETAS.f)
        again = ce.algorithm("ce", BETAS.base, BETAS.gamma, options)
        resumed, resumed_records = run(again, BETAS.f, through_bytes=True)
        assert ce.to_bytes(straight) == ce.to_bytes(resumed)
        assert records == resumed_records
        assert str(algorithm.estimate(straight)) == str(again.estimate(resumed))


def test_batches_can_be_drawn_again_by_a_worker():
    algorithm = ce.algorithm(
        "ce",
        CORRELATED.base,
        CORRELATED.gamma,
        free(None, iterations=2, samples_per_iteration=1500, estimation_rollouts=2500, batch_size=1100),
    )
    state = algorithm.init(9)
    while (b := algorithm.propose(state)) is not None:
        middle = (b.start + b.stop) // 2
        proposal = CORRELATED.base.with_parameters(b.parameters)
        x, noise = ce.draw(proposal, b.seed, b.phase, b.iteration, middle, b.stop)
        np.testing.assert_array_equal(x, b.x[middle - b.start :])
        np.testing.assert_array_equal(noise, b.noise[middle - b.start :])
        state, _ = algorithm.update(state, b, CORRELATED.f(b.x))


def test_functions_are_pure():
    algorithm = ce.algorithm("ce", BETAS.base, BETAS.gamma, PAPER)
    state = algorithm.init(0)
    before = ce.to_bytes(state)
    batch = algorithm.propose(state)
    first, _ = algorithm.update(state, batch, BETAS.f(batch.x))
    second, _ = algorithm.update(state, algorithm.propose(state), BETAS.f(batch.x))
    assert ce.to_bytes(first) == ce.to_bytes(second)
    assert ce.to_bytes(state) == before


def test_state_keeps_sixteen_bytes_a_rollout():
    algorithm = ce.algorithm(
        "ce",
        LINEAR_404.base,
        0.0,
        free(None, iterations=1, samples_per_iteration=100, estimation_rollouts=5000),
    )
    state, _ = run(algorithm, LINEAR_404.f)
    assert len(ce.to_bytes(state)) < 5000 * 16 + 404 * 8 * 2 + 100 * 8 + 3000


def test_failed_rollouts_are_left_out_of_the_search_and_bound_in_the_estimate():
    def f(x):
        values = BETAS.f(x)
        return np.where(np.arange(len(x)) % 50 == 3, np.nan, values)

    algorithm = ce.algorithm("ce", BETAS.base, BETAS.gamma, PAPER)
    state, records = run(algorithm, f)
    est = algorithm.estimate(state)
    assert [r.failed for r in records if r.phase == "train"] == [10] * 4
    assert est.failed == 64
    failures = est.failed_rollouts
    assert failures[0] == ce.FailedRollout("train", 0, 3)
    assert failures[-1] == ce.FailedRollout("estimate", 0, 1153)
    assert "failed-rollouts" in [w.name for w in est.warnings]
    w = np.exp(est.log_weights)
    event = np.nan_to_num(est.f, nan=math.inf) <= BETAS.gamma
    assert est.p == pytest.approx(np.sum(w * event) / 1200)
    with_failures = np.sum(w * (event | np.isnan(est.f))) / 1200
    assert est.ci[1] > with_failures
    assert not est.converged


def test_a_search_in_which_everything_fails_ends():
    est = ce.estimate(lambda x: np.full(len(x), np.nan), BETAS.base, 0.2, "ce", options=PAPER)
    assert est.p == 0
    assert est.ci[1] == 1.0
    assert est.failed == est.rollouts == 3200
    assert {"no-events", "failed-rollouts", "threshold-not-reached"} <= {w.name for w in est.warnings}


def test_infinite_values_shorten_the_step_and_are_reported():
    def f(x):
        worst = x.max(axis=1)
        return np.where(worst < 0.5, worst, math.inf)  # P0 about 0.03, but few of 200 rollouts

    options = ce.CrossEntropyOptions(
        iterations=8, samples_per_iteration=200, estimation_rollouts=4000, rho=0.1
    )
    algorithm = ce.algorithm("ce", BETAS.base, 0.2, options)
    state, records = run(algorithm, f, seed=1)
    first = records[0]
    assert first.quantile == math.inf
    assert first.gamma_k < 0.5
    assert first.elites == 200 - first.infinite
    assert first.step == pytest.approx(0.8 * first.elites / 20)
    est = algorithm.estimate(state)
    assert "quantile-infinite" in [w.name for w in est.warnings]
    assert abs(est.p - BETAS.p) < 4 * est.std_error


def test_no_finite_value_at_all_leaves_the_proposal_at_the_base():
    est = ce.estimate(lambda x: np.full(len(x), np.inf), BETAS.base, 0.2, "ce", options=PAPER)
    np.testing.assert_array_equal(est.proposal.parameters(), BETAS.base.parameters())
    assert est.p == 0
    assert 0 < est.ci[1] < 0.02


def test_stopping_the_search_when_gamma_is_reached_saves_rollouts():
    options = ce.CrossEntropyOptions(**{**vars(PAPER), "iterations": 30, "stop_when_reached": True})
    est = ce.estimate(BETAS.f, BETAS.base, BETAS.gamma, "ce", options=options)
    assert est.training_rollouts < 10 * 500
    assert "threshold-not-reached" not in [w.name for w in est.warnings]


def test_unreached_threshold_is_said():
    options = ce.CrossEntropyOptions(iterations=1, samples_per_iteration=200, estimation_rollouts=500)
    est = ce.estimate(BETAS.f, BETAS.base, 0.05, "ce", options=options)
    assert {"threshold-not-reached", "no-events"} <= {w.name for w in est.warnings}
    assert 0 < est.ci[1] < 0.05
    assert not est.converged


def test_collapsed_weights_are_said_and_the_interval_falls_back():
    """Without limits, in d = 404 with few samples, Algorithm 1 ends in a proposal whose weights mean
    nothing.
    """
    est = ce.estimate(LINEAR_404.f, LINEAR_404.base, 0.0, "ce", options=free(20_000))
    assert {"few-events", "dominant-weight"} & {w.name for w in est.warnings}
    assert est.ci[0] <= LINEAR_404.p <= est.ci[1]


def test_kl_limit_holds():
    options = free(20_000, max_kl=2.0)
    algorithm = ce.algorithm("ce", LINEAR_2.base, 0.0, options)
    _, records = run(algorithm, LINEAR_2.f)
    kls = [r.kl for r in records if r.phase == "train"]
    assert max(kls) <= 2.0
    assert max(kls) > 1.9


def test_target_precision_stops_early_or_is_said_to_be_missed():
    options = free(200_000, rel_error=0.05)
    est = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "ce", options=options)
    assert est.converged
    assert est.relative_half_width <= 0.05
    assert est.rollouts < 200_000
    missed = ce.estimate(LINEAR_2.f, LINEAR_2.base, 0.0, "ce", options=free(5000, rel_error=0.001))
    assert not missed.converged
    assert missed.rollouts == 5000
    assert "precision-not-reached" in [w.name for w in missed.warnings]


def test_estimate_while_searching_is_unknown_but_not_an_error():
    algorithm = ce.algorithm("ce", BETAS.base, BETAS.gamma, PAPER)
    state = algorithm.init(0)
    batch = algorithm.propose(state)
    state, _ = algorithm.update(state, batch, BETAS.f(batch.x))
    est = algorithm.estimate(state)
    assert math.isnan(est.p)
    assert est.ci == (0.0, 1.0)
    assert est.rollouts == est.training_rollouts == 500
    assert [w.name for w in est.warnings] == ["no-rollouts"]
    assert est.trace().p.size == 0


def test_budget_is_split_and_never_exceeded():
    for budget in (1000, 9999, 10_000, 123_457):
        o = ce.CrossEntropyOptions(budget=budget).resolved()
        assert o.iterations * o.samples_per_iteration + o.estimation_rollouts == budget
    partly = ce.CrossEntropyOptions(budget=10_000, iterations=3, estimation_rollouts=4000).resolved()
    assert partly.samples_per_iteration == 2000


@pytest.mark.parametrize(
    "wrong",
    [
        {"budget": 999},
        {"budget": 2000, "estimation_rollouts": 2000},
        {"budget": 2000, "iterations": 10, "samples_per_iteration": 300},
    ],
)
def test_budget_too_small_is_refused(wrong):
    with pytest.raises(ce.BudgetError):
        ce.CrossEntropyOptions(**wrong).resolved()


@pytest.mark.parametrize(
    "wrong",
    [
        {"rho": 0}, {"rho": 1.0}, {"rho": math.nan}, {"step": 0}, {"step": 1.1}, {"confidence": 1},
        {"iterations": 0}, {"samples_per_iteration": 3}, {"estimation_rollouts": 2.5}, {"batch_size": 0},
        {"mean_box": -1}, {"max_kl": 0}, {"rel_error": 0}, {"learn_covariance": True},
        {"beta_bounds": (2, 1)}, {"beta_bounds": 3}, {"beta_bounds": (0, 5)},
    ],
)  # fmt: skip
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(ce.OptionsError):
        ce.CrossEntropyOptions(**wrong)


def test_update_of_428_dimensions_from_5000_samples_takes_at_most_half_a_second():
    rng = np.random.default_rng(0)
    g = rng.normal(size=(404, 20))
    normal = ce.Normal(rng.normal(size=404), 0.02**2 * (0.5 * np.eye(404) + g @ g.T / 20))
    base = ce.Product([*(ce.Beta(2, 2, -0.25, 0.25) for _ in range(24)), normal])
    algorithm = ce.algorithm(
        "ce",
        base,
        -1e9,
        ce.CrossEntropyOptions(iterations=3, samples_per_iteration=5000, estimation_rollouts=10, rho=0.1),
    )
    state = algorithm.init(0)
    took = []
    for _ in range(3):
        batch = algorithm.propose(state)
        f = batch.x[:, :24].sum(axis=1) - 3 * (batch.x[:, 24:] - normal.mean).sum(axis=1)
        start = time.thread_time()  # not the clock: other processes' work does not count
        state, _ = algorithm.update(state, batch, f)
        took.append(time.thread_time() - start)
    assert min(took) <= 0.5
