"""Cells of a parameter against f; whole jobs are in `test_learned`."""

import numpy as np

from service.analysis.learned.scatter import axis_of, f_edges


def test_what_lies_above_the_axis_is_in_its_last_cell_and_a_shift_is_in_standard_deviations():
    edges = f_edges("s", 0.5, np.array([0.1, np.nan]))
    values, f = np.array([0.0, 2.0, 1.0, 1.0]), np.array([0.1, 0.2, np.inf, np.nan])
    assert 0.0 < edges[0] < 0.1
    assert edges[-1] == 1.0
    axis = axis_of("a", "speed", "m/s", values, f, np.array([3.0, np.nan]), np.array([0.5, 0.5]), edges)
    counts = np.array(axis.counts)
    assert (axis.low, axis.high) == (0.0, 3.0)
    assert counts.sum() == 3  # the failed one has no f
    assert counts[-1].sum() == 1
    assert axis.shift_sd == np.float64(2.0 / np.std([0.0, 2.0, 1.0])).round(5)
