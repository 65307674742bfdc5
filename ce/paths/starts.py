"""Starts: many are drawn, few are driven, each kept by its importance and weighted by the inverse of its chance."""

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ce.errors import ResponseError
from ce.paths import keys
from ce.paths.plan import Committor, Plan
from ce.paths.process import Process
from ce.streams import CHUNK, Stream, draw

Array = NDArray[np.float64]


class Roots(msgspec.Struct, frozen=True, eq=False):
    """Starts to be driven; any part of them may be driven elsewhere.

    x: (n, d), in the coordinates' own units
    seeds: (n,) uint64, of the paths
    weights: (n,), inverse of the chance that each was kept
    rows: (n,) int64, the number of each among the starts drawn
    floored: (n,) bool, whether it was kept by the floor of the importance alone
    """

    x: Array
    seeds: NDArray[np.uint64]
    weights: Array
    rows: NDArray[np.int64]
    floored: NDArray[np.bool_]

    @property
    def size(self) -> int:
        """Number of roots."""
        return self.seeds.size

    def part(self, start: int, stop: int) -> "Roots":
        """Roots [start, stop)."""
        return Roots(*(getattr(self, name)[start:stop] for name in self.__struct_fields__))


def features_of_starts(process: Process[Any], x: Array, seeds: NDArray[np.uint64]) -> NDArray[np.float32]:
    """Features (n, m, F) of starts, by the process' own short cut `start_features(x, seeds)` where it has one."""
    short_cut = getattr(process, "start_features", None)
    return process.features(process.begin(x, seeds)) if short_cut is None else short_cut(x, seeds)


def all_starts(process: Process[Any], seed: int, phase: str, iteration: int, count: int) -> Roots:
    """Starts [0, count) of a batch, each of weight 1."""
    x, seeds = draw(process.base, seed, phase, iteration, 0, count)
    return Roots(x, seeds, np.ones(count), np.arange(count), np.zeros(count, dtype=np.bool_))


def kept_starts(
    process: Process[Any],
    committor: Committor,
    plan: Plan,
    seed: int,
    phase: str,
    iteration: int,
    count: int,
) -> Roots:
    """Those of `count` starts that are kept, each by a number of its own seed.

    ResponseError where the short cut to the features of a start is not to the bit what the state itself has.
    """
    stream = Stream(process.base, seed, phase, iteration)
    parts = [
        _kept_of(process, committor, plan, stream, at, min(at + CHUNK, count))
        for at in range(0, count, CHUNK)
    ]
    return Roots(*(np.concatenate([getattr(p, name) for p in parts]) for name in Roots.__struct_fields__))


def _kept_of(
    process: Process[Any], committor: Committor, plan: Plan, stream: Stream, start: int, stop: int
) -> Roots:
    """Those that are kept of starts [start, stop) of a batch."""
    lean = bool(getattr(process, "starts_without_normals", False))
    x, seeds = stream.draw(start, stop, correlated=not lean)
    features = features_of_starts(process, x, seeds)
    chance, floored = plan.kept(plan.log_importance(committor, features))
    rows = np.flatnonzero(keys.start_uniform(seeds) < chance)
    whole = stream.rows(start + rows) if lean else x[rows]
    if lean or getattr(process, "start_features", None) is not None:
        own = process.features(process.begin(whole, seeds[rows]))
        if not np.array_equal(own, features[rows]):
            raise ResponseError(
                "what is known of a start beforehand (start_features(x, seeds), or features without the Normals of X) "
                "must be features(begin(x, seeds)) to the bit; "
                f"the largest difference is {np.max(np.abs(own - features[rows])):.3g}; correct or remove it"
            )
    return Roots(whole, seeds[rows], 1.0 / chance[rows], start + rows.astype(np.int64), floored[rows])


def reference_features(process: Process[Any], seed: int, iteration: int, count: int) -> NDArray[np.float32]:
    """Features (n, m, F) of starts [0, count) of a stream of the pilot's."""
    lean = bool(getattr(process, "starts_without_normals", False))
    stream = Stream(process.base, seed, "train", iteration)
    found = []
    for at in range(0, count, CHUNK):
        x, seeds = stream.draw(at, min(at + CHUNK, count), correlated=not lean)
        found.append(features_of_starts(process, x, seeds))
    return np.concatenate(found)
