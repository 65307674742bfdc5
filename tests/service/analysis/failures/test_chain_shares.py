"""Shares of failure modes where Markov chains met the failures: what each carries, and intervals over replications."""

import numpy as np
import pytest
from scipy.special import ndtri

import ce
from service.analysis.failures.events import chain_shares
from service.analysis.failures.shares import replicated_p, replicated_parts, replicated_share
from tests.reference.two_ways import met_by_splitting


def replicated(f, log_weights, replication) -> ce.ReplicatedEstimate:
    return ce.ReplicatedEstimate(
        gamma=0.0,
        method="splitting",
        confidence=0.95,
        rollouts=len(f),
        training_rollouts=0,
        f=np.array(f),
        log_weights=np.array(log_weights),
        proposal=ce.Product([ce.Uniform(0.0, 1.0)]),
        finished=True,
        replication=np.array(replication),
    )


def test_a_rollout_carries_all_its_entries_and_one_outside_the_estimate_nothing():
    estimate = replicated([-1.0, -1.0, -2.0, 3.0], np.log([0.1, 0.1, 0.3, 0.5]), [0, 0, 1, 1])
    share, replication, p = chain_shares(estimate, np.array([-2.0, -1.0, -5.0]))
    assert share == pytest.approx([0.6, 0.4, 0.0])
    assert replication[:2].tolist() == [1, 0]
    assert p == pytest.approx([0.2, 0.3])


def test_equal_values_share_their_part():
    estimate = replicated([-1.0, -1.0], np.log([0.1, 0.1]), [0, 0])
    share, _, _ = chain_shares(estimate, np.array([-1.0, -1.0]))
    assert share.tolist() == [0.5, 0.5]


def test_the_share_is_that_of_p():
    member = np.array([True, False, True, False])
    share, replication, p = np.array([0.4, 0.1, 0.2, 0.3]), np.array([0, 0, 1, 1]), np.array([0.5, 0.5])
    found, low, high = replicated_share(member, share, replication, p, 0.95)
    assert found == pytest.approx(0.6)
    assert low < found < high
    parts = replicated_parts(member, share, replication, p)
    assert parts == pytest.approx([0.4, 0.2])
    assert replicated_p(parts, 0.95)[0] == pytest.approx(0.3)
    assert replicated_p(np.zeros(4), 0.95) is None


def test_where_all_replications_agree_they_count_as_so_many_events():
    n = 300
    share, replication = np.full(n, 1.0 / n), np.arange(n) % 10
    found, low, high = replicated_share(np.ones(n, bool), share, replication, np.full(10, 1e-4), 0.95)
    assert (found, high) == (1.0, 1.0)
    assert low == pytest.approx(0.025**0.1)  # Clopper and Pearson's of 10 of 10


def test_a_replication_outside_the_sample_has_the_mode_as_the_others():
    parts = replicated_parts(
        np.array([True, False]), np.array([0.25, 0.75]), np.array([0, 0]), np.array([0.2, 0.4])
    )
    assert parts == pytest.approx([0.05, 0.1])


def test_intervals_hold_the_share_of_two_ways_to_one_event():
    """40 runs of multilevel splitting, two ways with 0.7 of the event and the rest: 95% intervals hold in 35 at least
    (which 95% intervals miss once in 70 such tests)."""
    a, b = float(-ndtri(0.7e-3)), float(-ndtri(0.3e-3))
    held = 0
    for seed in range(40):
        estimate, met, member = met_by_splitting(a, b, 4, 4000, seed)
        share, replication, p = chain_shares(estimate, met)
        inside = share > 0.0
        assert p.mean() == pytest.approx(estimate.p)
        _, low, high = replicated_share(member[inside], share[inside], replication[inside], p, 0.95)
        held += low <= 0.7 <= high
    assert held >= 35
