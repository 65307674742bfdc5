"""What the method asks of a simulator: paths that can be begun, driven on from where they stand, and copied."""

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ce.product import Product

States = TypeVar("States")

Array = NDArray[np.float64]


class Process(Protocol[States]):
    """A random path whose event is that the smallest value of its measure comes to gamma or below.

    Two methods more are used where a process has them. `level(states)`: smallest so far (n,) of what a pilot climbs in
    place of the measure, where the measure itself leads nowhere: equal to it at and below 0, above 0 in any order; it
    is used where gamma <= 0. `start_features(x, seeds)`: a short cut to the features of starts.

    States are opaque values that stand for n paths. `ce.paths.Simulator` makes a process of four functions.
    """

    @property
    def base(self) -> Product:
        """Distribution of X, which is all that is drawn at the start."""

    @property
    def checkpoints(self) -> tuple[int, ...]:
        """Steps at which paths are looked at: 0 first, rising, the horizon last."""

    def begin(self, x: Array, seeds: NDArray[np.uint64]) -> States:
        """The paths at step 0, for x (n, d) and a seed (n,) each."""

    def measure(self, states: States) -> Array:
        """Smallest value of the measure so far (n,); NaN for a path that failed."""

    def alive(self, states: States) -> NDArray[np.bool_]:
        """Whether each path goes on (n,): False once it has ended by itself, has failed or is at the horizon."""

    def steps(self, states: States) -> NDArray[np.int64]:
        """Steps (n,) that the last `advance` simulated, those of a prefix driven again included; 0 after `begin`."""

    def features(self, states: States) -> NDArray[np.float32]:
        """What a committor may know of a state (n, m, F): F numbers on each of m others (m = 1 where there are
        none)."""

    def take(self, states: States, rows: NDArray[np.intp]) -> States:
        """Copies of these paths, each as often as its row (k,) occurs."""

    def advance(self, states: States, keys: NDArray[np.uint64], until: int) -> States:
        """The paths at step `until`, or where they ended before; the noise of the way is a function of each key
        (n,)."""
