"""A process from four functions in NumPy: how paths start, how they step, what is measured, what a committor may
know."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ce.checks import at_least
from ce.errors import OptionsError, ResponseError
from ce.paths.keys import normals
from ce.product import Product

Array = NDArray[np.float64]

# Equal parts that a horizon is divided into where no checkpoints are given.
PARTS = 20


@dataclass(frozen=True)
class PathStates:
    """n paths of a `Simulator`.

    state: (n, ...), the user's own
    smallest: (n,), smallest measure so far, NaN where a step failed
    step: (n,) int64, of each path
    driven: (n,) int64, steps of the last `advance`
    """

    state: Array
    smallest: Array
    step: NDArray[np.int64]
    driven: NDArray[np.int64]


class Simulator:
    """Paths of an own simulator: a function for a step, and three that say how paths start and what states are like.

    base: distribution of X, which is all that is drawn at the start
    start: x (n, d) -> state (n, ...), at step 0
    step: (state, z (n, noise), number of the step from 0) -> state (n, ...); z are standard normals of its own
    measure: state -> (n,), low is dangerous, NaN = the path failed
    features: state -> (n, F) or (n, m, F), what tells how dangerous it is; None for the state itself, flattened
    horizon: steps of a path
    noise: standard normals of a step
    checkpoints: steps at which paths are split, 0 first, the horizon last; None for twenty equal parts
    stop: measure at or below which a path ends

    >>> import ce, numpy as np
    >>> walk = ce.Simulator(
    ...     base=ce.Product([ce.Normal([0.0], [[1.0]])]),
    ...     start=lambda x: x,
    ...     step=lambda s, z, k: s + 0.1 * z,
    ...     measure=lambda s: 3.0 - s[:, 0],
    ...     horizon=100,
    ... )
    >>> states = walk.begin(np.zeros((2, 1)), np.arange(2, dtype=np.uint64))
    >>> walk.measure(walk.advance(states, np.arange(2, dtype=np.uint64), 100)).shape
    (2,)
    """

    def __init__(
        self,
        base: Product,
        start: Callable[[Array], Array],
        step: Callable[[Array, Array, int], Array],
        measure: Callable[[Array], Array],
        horizon: int,
        features: Callable[[Array], Array] | None = None,
        noise: int = 1,
        checkpoints: Sequence[int] | None = None,
        stop: float = -np.inf,
    ) -> None:
        at_least("horizon", horizon, 1)
        at_least("noise", noise, 0)
        parts = min(PARTS, horizon)
        every = [round(horizon * k / parts) for k in range(parts + 1)]
        self.base = base
        self.checkpoints = checked_checkpoints(every if checkpoints is None else checkpoints)
        if self.checkpoints[-1] != horizon:
            raise OptionsError(
                f"the last checkpoint must be the horizon {horizon}, not {self.checkpoints[-1]}"
            )
        self._start, self._step, self._measure_of, self._features_of = start, step, measure, features
        self._noise, self._stop = noise, stop

    def begin(self, x: Array, seeds: NDArray[np.uint64]) -> PathStates:
        """The paths at step 0, for x (n, d)."""
        n = x.shape[0]
        state = np.asarray(self._start(x))
        if state.shape[:1] != (n,):
            raise ResponseError(f"start must give {n} states, one for each row of x, not shape {state.shape}")
        zero = np.zeros(n, dtype=np.int64)
        return PathStates(state, self._measured(state), zero, zero)

    def measure(self, states: PathStates) -> Array:
        """Smallest value of the measure so far (n,)."""
        return states.smallest

    def alive(self, states: PathStates) -> NDArray[np.bool_]:
        """Whether each path goes on (n,)."""
        return (states.step < self.checkpoints[-1]) & (states.smallest > self._stop)

    def steps(self, states: PathStates) -> NDArray[np.int64]:
        """Steps (n,) of the last `advance`."""
        return states.driven

    def features(self, states: PathStates) -> NDArray[np.float32]:
        """What a committor may know (n, m, F): the state's features and the share of the horizon that has passed."""
        n = states.step.size
        state = states.state
        own = state.reshape(n, -1) if self._features_of is None else np.asarray(self._features_of(state))
        if own.shape[:1] != (n,) or own.ndim not in (2, 3):
            raise ResponseError(
                f"features must give shape ({n}, F) or ({n}, m, F) for {n} states, not {own.shape}"
            )
        own = own[:, None, :] if own.ndim == 2 else own
        passed = np.broadcast_to((states.step / self.checkpoints[-1])[:, None, None], (*own.shape[:2], 1))
        return np.concatenate([own, passed], axis=2).astype(np.float32)

    def take(self, states: PathStates, rows: NDArray[np.intp]) -> PathStates:
        """Copies of these paths."""
        return PathStates(states.state[rows], states.smallest[rows], states.step[rows], states.driven[rows])

    def advance(self, states: PathStates, keys: NDArray[np.uint64], until: int) -> PathStates:
        """The paths at step `until`, or where they ended before."""
        state, smallest, step = states.state.copy(), states.smallest.copy(), states.step.copy()
        first = step.copy()
        while (rows := np.flatnonzero((step < until) & (smallest > self._stop))).size:
            now = int(step[rows].min())
            rows = rows[step[rows] == now]
            z = normals(keys[rows], self._noise, (now - first[rows]) * self._noise)
            state[rows] = self._step(state[rows], z, now)
            smallest[rows] = np.minimum(smallest[rows], self._measured(state[rows]))
            step[rows] += 1
        return PathStates(state, smallest, step, step - first)

    def _measured(self, state: Array) -> Array:
        value = np.asarray(self._measure_of(state), dtype=np.float64)
        if value.shape != state.shape[:1]:
            raise ResponseError(
                f"measure must give shape {state.shape[:1]}, one number for each state, not {value.shape}"
            )
        return value


def checked_checkpoints(given: Sequence[int]) -> tuple[int, ...]:
    """Checkpoints as integers that begin with 0 and rise; OptionsError otherwise."""
    steps = tuple(int(k) for k in given)
    if len(steps) < 2 or steps[0] != 0 or any(b <= a for a, b in pairwise(steps)):
        raise OptionsError(f"checkpoints must begin with 0 and rise to the horizon, not {list(given)}")
    return steps
