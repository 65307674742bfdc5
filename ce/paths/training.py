"""Training a committor: Poisson loss on unbiased descendant hit fractions, with the same bits on every processor."""

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.paths import exactly, keys
from ce.paths.network import (
    ACTIVATION_BITS,
    FEATURE_BITS,
    LARGEST_FEATURE,
    LARGEST_WEIGHT,
    LEAST,
    MOST,
    WEIGHT_BITS,
    Net,
    NetworkCommittor,
    activation,
    slope,
)
from ce.paths.tree import Recorded

Array = NDArray[np.float64]

HIDDEN, NETS = 24, 2
# Labels are cut there; so is what one row may add to a gradient.
LARGEST_LABEL, LARGEST_GRADIENT = 2.0, 0.2
LARGEST_FEATURE_BITS = int(np.log2(LARGEST_FEATURE))
BATCH = 256
# Passes through all lessons in one training, at most: more of them learn the noise of few.
PASSES = 20
DECAY = 0.03
# Rows without a hit that a round leaves to learn from, and levels that each row is labelled at.
MOST_ROWS, LEVELS_A_ROW = 6000, 3


class Lessons(msgspec.Struct, frozen=True, eq=False):
    """What one round of paths teaches.

    features: (n, m, F)
    levels: (n, k), in the unit of the measure
    labels: (n, k), weight of a state's descendants that come to the level, over its own
    weights: (n, k), of the rows in the loss; 0 where a path had already been at the level
    """

    features: NDArray[np.float32]
    levels: Array
    labels: Array
    weights: Array


def lessons(record: Sequence[Recorded], levels: Array, seed: int) -> Lessons:
    """What to learn from recorded paths: all states with a hit or at the start, the others thinned and weighted.

    record: one a checkpoint
    levels: (L,), at which hits are looked for, in the unit of the measure
    seed: of the thinning and of the levels that a row is labelled at
    """
    source = np.random.Generator(np.random.Philox(key=np.array([seed, 0x6C65736E], dtype=np.uint64)))
    hits = _hits(record, levels)
    features = np.concatenate([r.features for r in record])
    before = np.concatenate([r.before for r in record])
    labels = np.concatenate([h / r.weight[:, None] for h, r in zip(hits, record, strict=True)])
    valid = ~(before[:, None] <= levels) & ~np.isnan(before)[:, None]
    first = np.arange(features.shape[0]) < record[0].weight.size
    sure = first | (labels.max(axis=1) > 0.0)
    share = np.where(sure, 1.0, min(1.0, MOST_ROWS / max(int(np.count_nonzero(~sure)), 1)))
    rows = np.flatnonzero((source.random(share.size) < share) & valid.any(axis=1))
    chosen = source.integers(levels.size, size=(rows.size, LEVELS_A_ROW))
    return Lessons(
        features[rows],
        levels[chosen],
        np.minimum(np.take_along_axis(labels[rows], chosen, 1), LARGEST_LABEL),
        np.take_along_axis(valid[rows], chosen, 1) / share[rows, None],
    )


def _hits(record: Sequence[Recorded], levels: Array) -> list[Array]:
    """Weight (n, L) of the descendants of each state, itself included, that come to each level after it."""
    out: list[Array] = []
    for k in range(len(record) - 1, -1, -1):
        r = record[k]
        own = np.zeros((r.weight.size, levels.size))
        if out:
            np.add.at(own, record[k + 1].parent, out[-1])
        hit = (r.after[:, None] <= levels) & ~(r.before[:, None] <= levels)
        out.append(np.where(hit, r.weight[:, None], own))
    return out[::-1]


def untrained(features: NDArray[np.float32], gamma: float, first: float, seed: int) -> NetworkCommittor:
    """Networks before any training, for features like these (n, m, F).

    gamma: the lowest level that will be asked for
    first: the highest
    seed: of the first weights
    """
    flat = features.reshape(-1, features.shape[-1]).astype(np.float64)
    ones = np.ones((1, flat.shape[0]))
    center = exactly.product(ones, flat)[0] / flat.shape[0]
    spread = np.sqrt(exactly.product(ones, (flat - center) ** 2)[0] / flat.shape[0])
    nets = []
    for k in range(NETS):
        key = np.array([seed, 0x6E657430 + k], dtype=np.uint64)
        source = np.random.Generator(np.random.Philox(key=key))
        width = center.size + 1
        nets.append(
            Net(
                w1=source.standard_normal((width, HIDDEN)) / np.sqrt(width),
                b1=np.zeros(HIDDEN),
                w2=source.standard_normal((HIDDEN, HIDDEN)) / np.sqrt(HIDDEN),
                b2=np.zeros(HIDDEN),
                w3=0.1 * source.standard_normal((HIDDEN, 1)) / np.sqrt(HIDDEN),
                b3=np.full(1, -4.0),
            )
        )
    top = first if first > gamma else gamma + max(abs(gamma), 1.0)
    return NetworkCommittor(center, np.where(spread > 1e-9, spread, 1.0), gamma, top, tuple(nets))


def trained(
    committor: NetworkCommittor, taught: Sequence[Lessons], steps: int, rate: float, seed: int
) -> NetworkCommittor:
    """The committor after some steps of Adam, its rate falling to nothing as a cosine, on all lessons so far.

    steps: of BATCH rows each, in passes through all lessons; fewer where that were more than PASSES
    rate: of the first step
    seed: of the order of the rows
    """
    features = np.concatenate([t.features for t in taught])
    row = np.repeat(np.arange(features.shape[0]), taught[0].levels.shape[1])
    levels, labels, weights = (
        np.concatenate([getattr(t, name) for t in taught]).ravel() for name in ("levels", "labels", "weights")
    )
    used = np.flatnonzero(weights > 0.0)
    row, levels, labels, weights = row[used], committor.encoded(levels[used]), labels[used], weights[used]
    weights = weights * (weights.size / float(np.add.reduce(weights)))
    steps = min(steps, PASSES * max(row.size // BATCH, 1))
    x = committor.standardised(features)
    nets = []
    for k, net in enumerate(committor.nets):
        number = int(keys.mixed(np.array([seed], dtype=np.uint64), k)[0])
        nets.append(_fitted(net, x, row, levels, labels, weights, steps, rate, number))
    return msgspec.structs.replace(committor, nets=tuple(nets))


def _fitted(
    net: Net,
    x: Array,
    row: NDArray[np.int64],
    levels: Array,
    labels: Array,
    weights: Array,
    steps: int,
    rate: float,
    seed: int,
) -> Net:
    source = np.random.Generator(np.random.Philox(key=np.array([seed, 0x6F726472], dtype=np.uint64)))
    batch = min(BATCH, max(row.size, 1))
    numbers, arrays = _as_one(net.arrays())
    decay = np.concatenate([np.full(a.size, DECAY if a.ndim == 2 else 0.0) for a in arrays])
    mean, square = np.zeros_like(numbers), np.zeros_like(numbers)
    kept_mean = kept_square = 1.0
    a_pass = row.size // batch
    for done in range(steps):
        if done % a_pass == 0:
            order = source.permutation(row.size)
        q = done % a_pass
        at = order[q * batch : (q + 1) * batch]
        g = np.concatenate(
            [a.ravel() for a in _gradient(arrays, x[row[at]], levels[at], labels[at], weights[at])]
        )
        kept_mean, kept_square = kept_mean * 0.9, kept_square * 0.99
        mean = 0.9 * mean + 0.1 * g
        square = 0.99 * square + 0.01 * g * g
        move = mean / (1.0 - kept_mean) / (np.sqrt(square / (1.0 - kept_square)) + 1e-7)
        numbers -= rate * _falling((done + 1) / steps) * (move + decay * numbers)
    return Net(*(a.copy() for a in arrays))


def _as_one(arrays: Sequence[Array]) -> tuple[Array, list[Array]]:
    """All numbers in one vector, and arrays of the same shapes that look into it."""
    numbers = np.concatenate([a.ravel() for a in arrays])
    ends = np.cumsum([a.size for a in arrays])
    return numbers, [numbers[e - a.size : e].reshape(a.shape) for a, e in zip(arrays, ends, strict=True)]


def _falling(share: float) -> float:
    """From 1 to 0 like half a cosine, by a polynomial: the same bits everywhere."""
    return 1.0 - share * share * (3.0 - 2.0 * share)


def _gradient(arrays: list[Array], x: Array, levels: Array, labels: Array, weights: Array) -> list[Array]:
    """Of the mean of weight (hazard - label log hazard) over rows with standardised features x (n, m, F).

    Features, activations and weights are rounded as `NetworkCommittor.log_hazard` rounds them; what is carried back
    is rounded to as many bits as leave the sums over all rows exact.
    """
    w1, w2, w3 = (
        exactly.rounded(np.clip(w, -LARGEST_WEIGHT, LARGEST_WEIGHT), WEIGHT_BITS) for w in arrays[::2]
    )
    b1, b2, b3 = arrays[1::2]
    n, m, width = x.shape
    flat = np.empty((n * m, width + 1))
    flat[:, :-1] = x.reshape(n * m, width)
    flat[:, -1] = np.repeat(levels, m)
    bits = 52 - int(np.ceil(np.log2(n * m)))
    hidden1, slope1 = _layer(flat @ w1, b1)
    hidden2, slope2 = _layer(hidden1 @ w2, b2)
    each = exactly.exp(np.clip((hidden2 @ w3)[:, 0] + b3, LEAST, MOST)).reshape(n, m)
    hazard = exactly.added(each.T)
    out = (weights * (1.0 - labels / np.maximum(hazard, 1e-7)) / n)[:, None] * each
    out = exactly.scaled(
        np.clip(out, -LARGEST_GRADIENT, LARGEST_GRADIENT).reshape(-1, 1), bits - ACTIVATION_BITS
    )
    back2 = exactly.scaled(out * w3[:, 0] * slope2, bits - ACTIVATION_BITS)
    back1 = exactly.scaled(back2 @ w2.T * slope1, bits - FEATURE_BITS - LARGEST_FEATURE_BITS)
    return [
        flat.T @ back1,
        np.add.reduce(back1, axis=0),
        hidden1.T @ back2,
        np.add.reduce(back2, axis=0),
        hidden2.T @ out,
        np.add.reduce(out, axis=0),
    ]


def _layer(before: Array, bias: Array) -> tuple[Array, Array]:
    """Activations of a layer, rounded, and their slopes; `before` is written over."""
    before += bias
    steep = slope(before)
    return exactly.rounded(activation(before, out=before), ACTIVATION_BITS, out=before), steep
