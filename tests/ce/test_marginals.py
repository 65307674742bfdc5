import math

import numpy as np
import pytest
import scipy.stats as stats
from hypothesis import given, settings
from hypothesis import strategies as st

import ce

FAMILIES = [
    (ce.Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    (ce.LogNormal(0.5, 0.8), stats.lognorm(0.8, scale=math.exp(0.5))),
    (ce.Exponential(2.0, 1.0), stats.expon(1.0, 0.5)),
    (ce.Weibull(1.7, 2.0), stats.weibull_min(1.7, scale=2.0)),
    (ce.Gumbel(1.0, 0.5), stats.gumbel_r(1.0, 0.5)),
    (ce.TruncatedNormal(1.0, 2.0, 0.0, 4.0), stats.truncnorm(-0.5, 1.5, 1.0, 2.0)),
    (ce.TruncatedNormal(0.0, 1.0, 3.0), stats.truncnorm(3.0, np.inf)),
    (ce.TruncatedNormal(0.0, 1.0, high=-3.0), stats.truncnorm(-np.inf, -3.0)),
    (ce.TruncatedLogNormal(0.5, 0.8), stats.lognorm(0.8, scale=math.exp(0.5))),
    (ce.TwoNormals(0.3, 0.7, 0.7, -1.0, 2.0), stats.truncnorm(-1 / 0.7, 2 / 0.7, 0.0, 0.7)),
]
IDS = [f"{type(ours).__name__}-{i}" for i, (ours, _) in enumerate(FAMILIES)]


@pytest.mark.parametrize(("ours", "theirs"), FAMILIES, ids=IDS)
def test_transform_and_density_are_the_distributions(ours, theirs):
    u = np.linspace(-6.0, 6.0, 49)
    x = ours.from_standard(u)
    np.testing.assert_allclose(
        np.where(u < 0, theirs.cdf(x), theirs.sf(x)), stats.norm.sf(np.abs(u)), rtol=1e-6
    )
    np.testing.assert_allclose(ours.log_density(x), theirs.logpdf(x), rtol=1e-9, atol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.sampled_from([ours for ours, _ in FAMILIES]), st.floats(-4.0, 4.0), st.floats(-2.5, 2.5))
def test_families_invert_and_normalise(ours, u, shift):
    there = float(ours.to_standard(ours.from_standard(np.array([u])))[0])
    assert there == pytest.approx(u, abs=1e-6)
    moved = ours.shifted(shift)

    v = np.linspace(shift - 4.5, shift + 4.5, 601)  # in standard-normal space, where every family is smooth
    x = moved.from_standard(v)
    density = np.exp(moved.log_density(x) - ours.log_density(x) - 0.5 * v * v) / math.sqrt(2 * math.pi)
    assert np.trapezoid(density, v) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("method", ["ce", "mixture", "splitting"])
def test_every_method_works_on_every_family(method):
    """The sum of independent values in standard-normal space is below -3.5: P = Phi(-3.5)."""
    base = ce.Product([ours for ours, _ in FAMILIES])
    k = len(FAMILIES)

    def f(x):
        return sum(b.to_standard(x[:, i]) for i, (b, _) in enumerate(FAMILIES)) / math.sqrt(k)

    est = ce.estimate(f, base, -3.5, method, budget=20_000, seed=4)
    p = 0.5 * math.erfc(3.5 / math.sqrt(2))
    assert est.p == pytest.approx(p, abs=4.5 * est.std_error)
    assert est.efficiency > 3


def test_draws_and_ratios_of_shifted_marginals():
    base = ce.Product([ours for ours, _ in FAMILIES])
    moved = base.with_parameters(np.linspace(-0.8, 0.8, len(FAMILIES)))
    x, _ = ce.draw(moved, 1, "train", 0, 0, 20_000)
    np.testing.assert_allclose(
        base.log_ratio(moved, x), base.log_density(x) - moved.log_density(x), atol=1e-8
    )
    np.testing.assert_allclose(moved.statistics(x).mean(axis=0), moved.mean_statistics(), atol=0.04)
    assert moved.kl(base) == pytest.approx(-float(np.mean(base.log_ratio(moved, x))), abs=0.1)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ce.Uniform(1.0, 1.0),
        lambda: ce.LogNormal(0.0, 0.0),
        lambda: ce.Exponential(-1.0),
        lambda: ce.Weibull(0.0),
        lambda: ce.Gumbel(0.0, np.nan),
        lambda: ce.TruncatedNormal(0.0, 1.0, 2.0, 1.0),
        lambda: ce.Exponential("fast"),
    ],
)
def test_parameters_that_make_no_distribution_are_refused(make):
    with pytest.raises(ce.FamilyError):
        make()


def test_values_outside_the_support_are_refused():
    for block in (ce.Uniform(0.0, 1.0), ce.Exponential(), ce.LogNormal(), ce.TruncatedNormal(0, 1, -1, 0.5)):
        with pytest.raises(ce.FamilyError, match="support"):
            ce.Product([block]).log_density([[-1.5]])


def test_a_lognormal_tail_is_the_distribution_given_that():
    tail = ce.TruncatedLogNormal(-0.3, 0.65, 1.5, 4.0)
    x = np.linspace(1.5, 4.0, 21)[1:-1]
    whole = stats.lognorm(0.65, scale=math.exp(-0.3))
    below = (whole.cdf(x) - whole.cdf(1.5)) / (whole.cdf(4.0) - whole.cdf(1.5))
    np.testing.assert_allclose(stats.norm.cdf(tail.to_standard(x)), below, rtol=1e-9)
    np.testing.assert_allclose(tail.from_standard(tail.to_standard(x)), x, rtol=1e-9)


def test_two_normals_mix():
    mixed = ce.TwoNormals(0.1, 0.1, 0.5, -2.0, 2.0)
    u = np.linspace(-4.0, 4.0, 33)
    x = mixed.from_standard(u)
    whole = 0.1 * stats.norm.cdf(x / 0.5) + 0.9 * stats.norm.cdf(x / 0.1)
    np.testing.assert_allclose(whole, stats.norm.cdf(u), atol=1e-4)
    np.testing.assert_allclose(mixed.from_standard(-u), -x, atol=1e-12)


@pytest.mark.parametrize(
    "make",
    [
        lambda: ce.TruncatedLogNormal(0.0, 1.0, -1.0, 2.0),
        lambda: ce.TwoNormals(1.2, 0.1, 0.5, -1.0, 1.0),
        lambda: ce.TwoNormals(0.2, 0.5, 0.1, -1.0, 1.0),
        lambda: ce.TwoNormals(0.2, 0.1, 0.5, -math.inf, 1.0),
    ],
)
def test_wrong_parameters_of_these_are_refused(make):
    with pytest.raises(ce.FamilyError):
        make()
