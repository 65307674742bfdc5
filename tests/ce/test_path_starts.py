"""Starts whose features need no Normals are drawn with them only where they are kept, to the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import ce
from ce.paths import kept_starts, schedule
from ce.paths.starts import reference_features

BASE = ce.Product([ce.Beta(2, 2), ce.Normal([0.0, 1.0], [[1.0, 0.3], [0.3, 1.0]]), ce.Uniform(0.0, 1.0)])


class Downhill:
    """The lower the first feature, the more is to be expected."""

    def log_hazard(self, features, levels):
        return np.repeat(-3.0 * features[:, :1, 0].astype(np.float64), levels.size, axis=1)


def process(of_start, lean: bool) -> ce.Simulator:
    made = ce.Simulator(
        base=BASE, start=of_start, step=lambda s, z, k: s + 0.1 * z, measure=lambda s: s[:, 0], horizon=10
    )
    made.starts_without_normals = lean
    return made


def kept(one: ce.Simulator):
    levels, committor = np.array([0.0]), Downhill()
    hazard = committor.log_hazard(reference_features(one, 3, 7, 2000), levels)
    plan = schedule(0.0, levels, hazard, one.checkpoints, 2500, 100.0)
    return kept_starts(one, committor, plan, 3, "estimate", 2, 2500)


def test_the_same_starts_are_kept_with_the_same_draws():
    whole, lean = (kept(process(lambda x: x[:, [0, 3]], lean)) for lean in (False, True))
    assert 20 < whole.size < 1000
    for name in ("x", "seeds", "weights", "rows", "floored"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(lean, name))
    x, _ = ce.draw(BASE, 3, "estimate", 2, 0, 2500)
    np.testing.assert_array_equal(x[lean.rows], lean.x)


def test_a_process_whose_features_do_need_them_is_refused():
    with pytest.raises(ce.ResponseError, match="to the bit"):
        kept(process(lambda x: x[:, [1, 3]], True))
