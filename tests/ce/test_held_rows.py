"""What a run holds in memory stays within what its options say beforehand."""

import numpy as np
import pytest

import ce

DIM, BUDGET = 60, 6000
BASE = ce.Product([ce.StandardNormal(DIM)])
SMALL = 100_000  # bytes of parameters and records
OPTIONS = {
    "naive": ce.NaiveOptions(BUDGET, batch_size=2500),
    "ce": ce.CrossEntropyOptions(budget=BUDGET, iterations=3, rho=0.1, mean_box=None),
    "mixture": ce.MixtureOptions(BUDGET),
    "splitting": ce.SplittingOptions(BUDGET),
    "auto": ce.AutoOptions(BUDGET),
}


@pytest.mark.parametrize("gamma", [-0.5, -4.0])
@pytest.mark.parametrize("method", ce.METHODS)
def test_state_and_batch_hold_no_more_rows_than_foretold(method, gamma):
    options = OPTIONS[method]
    algorithm = ce.algorithm(method, BASE, gamma, options)
    most = options.held_rows(DIM) * (8 * DIM + 40) + 24 * BUDGET + SMALL
    state, held = algorithm.init(3), 0
    while (batch := algorithm.propose(state)) is not None:
        held = max(held, batch.x.nbytes + len(algorithm.to_bytes(state)))
        state, _ = algorithm.update(state, batch, batch.x[:, :DIM].sum(axis=1) / np.sqrt(DIM))
    assert 0.05 * most < held <= most
