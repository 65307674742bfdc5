import numpy as np
import pytest

import ce
from ce.streams import CHUNK

BASE = ce.Product([ce.Beta(2, 2), ce.Normal([0.0, 1.0], [[1.0, 0.3], [0.3, 2.0]]), ce.Beta(3, 1.5, -1, 1)])
PINNED_X = ["0x1.bb0d33992bf76p-1", "-0x1.cbe9d4dd19e00p-5", "0x1.4afcc38d7df53p+0", "0x1.2f7d51e26ebe4p-2"]
PINNED_NOISE = 9861798695868765530


def test_rows_do_not_depend_on_the_range_asked_for():
    x, noise = ce.draw(BASE, 7, "train", 3, 0, 3 * CHUNK + 17)
    rng = np.random.default_rng(0)
    for _ in range(20):
        start, stop = sorted(rng.integers(0, 3 * CHUNK + 18, 2))
        part, part_noise = ce.draw(BASE, 7, "train", 3, int(start), int(stop))
        np.testing.assert_array_equal(part, x[start:stop])
        np.testing.assert_array_equal(part_noise, noise[start:stop])


def test_a_stream_gives_the_rows_of_draw_in_whatever_order_they_are_asked_for():
    base = ce.Product([*BASE.blocks, ce.Uniform(0.0, 1.0)])
    x, noise = ce.draw(base, 7, "train", 3, 0, 2 * CHUNK)
    stream = ce.Stream(base, 7, "train", 3)
    chosen = np.array([3, 999, 1000, 1500])
    np.testing.assert_array_equal(stream.rows(chosen), x[chosen])
    for start, stop in ((5, 9), (9, 20), (990, 1010), (1500, 1501), (3, 4), (5, 5), (0, 2 * CHUNK)):
        part, part_noise = stream.draw(start, stop)
        np.testing.assert_array_equal(part, x[start:stop])
        np.testing.assert_array_equal(part_noise, noise[start:stop])


def test_streams_differ_by_seed_phase_iteration_and_chunk():
    drawn = [
        ce.draw(BASE, *key, 0, 2 * CHUNK)
        for key in ((0, "train", 0), (1, "train", 0), (0, "estimate", 0), (0, "train", 1))
    ]
    rows = np.concatenate([x for x, _ in drawn])
    assert len(np.unique(rows[:, 0])) == len(rows)
    assert len(np.unique(np.concatenate([noise for _, noise in drawn]))) == len(rows)


def test_noise_seeds_do_not_depend_on_the_proposal():
    other = BASE.with_parameters(BASE.parameters() + 0.1)
    np.testing.assert_array_equal(
        ce.draw(BASE, 0, "train", 0, 5, 9)[1], ce.draw(other, 0, "train", 0, 5, 9)[1]
    )


def test_first_values_are_pinned():
    """A change here means that runs made before can no longer be replayed to the same bits."""
    x, noise = ce.draw(BASE, 2026, "estimate", 0, 1000, 1001)
    assert noise.dtype == np.uint64
    assert [float(v).hex() for v in x[0]] == PINNED_X
    assert int(noise[0]) == PINNED_NOISE


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, True, None])
def test_seeds_outside_64_bits_are_refused(seed):
    with pytest.raises(ce.OptionsError, match="seed"):
        ce.draw(BASE, seed, "train", 0, 0, 1)


def test_wrong_phase_and_rows_are_refused():
    with pytest.raises(ce.OptionsError, match="phase"):
        ce.draw(BASE, 0, "warm-up", 0, 0, 1)
    with pytest.raises(ce.OptionsError, match="rows"):
        ce.draw(BASE, 0, "train", 0, 3, 2)
