"""`ce.algorithm` picks an algorithm by name; `ce.estimate` runs one against a function f in this process."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.auto import Auto, AutoOptions
from ce.cross_entropy import CrossEntropy, CrossEntropyOptions
from ce.errors import OptionsError
from ce.former_names import with_present_names
from ce.level import levelled
from ce.mixture import MixtureOptions, MixtureSampling
from ce.mixture_options import FORMER_NAMES
from ce.naive import Naive, NaiveOptions
from ce.product import Product
from ce.protocol import Algorithm
from ce.results import Estimate
from ce.splitting import Splitting, SplittingOptions

Options = NaiveOptions | CrossEntropyOptions | MixtureOptions | SplittingOptions | AutoOptions
KINDS: dict[str, tuple[Callable[..., Algorithm[Any]], type[Options]]] = {
    "naive": (Naive, NaiveOptions),
    "ce": (CrossEntropy, CrossEntropyOptions),
    "mixture": (MixtureSampling, MixtureOptions),
    "splitting": (Splitting, SplittingOptions),
    "auto": (Auto, AutoOptions),
}
METHODS = tuple(KINDS)
OPTIONS: dict[str, type[Options]] = {name: kind for name, (_, kind) in KINDS.items()}


def algorithm(name: str, base: Product, gamma: float, options: Options | None = None) -> Algorithm[Any]:
    """The algorithm of that name for p = P0(f(X) <= gamma), as ask and tell; OptionsError for a wrong name or
    options.

    name: one of METHODS
    base: distribution P0 of X
    gamma: threshold of the event, in the unit of f
    options: of the algorithm's own kind, OPTIONS[name]; None for its defaults

    >>> import ce
    >>> ce.algorithm("splitting", ce.Product([ce.Beta(2, 2)]), 0.1).total_rollouts
    100000
    """
    make, options_type = _kind(name)
    if options is None:
        options = options_type()
    if not isinstance(options, options_type):
        raise OptionsError(f"method {name!r} takes {options_type.__name__}, not {type(options).__name__}")
    return make(base, gamma, options)


def general_options(
    budget: int = 100_000, rel_error: float | None = None, confidence: float = 0.95
) -> CrossEntropyOptions:
    """Cross-entropy options where nothing is known of the problem: wide bounds, means free, KL limited.

    The paper's constraint set (the defaults of CrossEntropyOptions) is made for its driver model's weights.

    budget: rollouts at most
    rel_error: relative half-width of the interval to stop at, None for none
    confidence: of the interval, in (0, 1)

    >>> import ce
    >>> ce.general_options(budget=20_000).max_kl
    8.0
    """
    return CrossEntropyOptions(
        budget=budget,
        rel_error=rel_error,
        confidence=confidence,
        rho=0.1,
        beta_bounds=(0.2, 50.0),
        mean_box=None,
        max_kl=8.0,
    )


def estimate(
    f: Callable[[NDArray[np.float64]], ArrayLike],
    base: Product,
    gamma: float,
    method: str = "auto",
    budget: int = 100_000,
    rel_error: float | None = None,
    confidence: float = 0.95,
    seed: int = 0,
    options: Options | None = None,
    level: Callable[[NDArray[np.float64]], ArrayLike] | None = None,
) -> Estimate:
    """Estimate p = P0(f(X) <= gamma) by calling f for at most `budget` rows; CeError for wrong use.

    f: (n, d) -> (n,), low is dangerous, NaN = the rollout failed; what it raises passes through
    base: distribution P0 of X
    gamma: threshold of the event, in the unit of f
    method: one of METHODS
    budget: rows of f, at most
    rel_error: relative half-width of the interval at which to stop early, None to spend the budget
    confidence: of the interval, in (0, 1)
    seed: 0 <= seed < 2^64; same seed, same bits
    options: the method's own, in place of budget, rel_error and confidence
    level: (n, d) -> (n,), what the search climbs down in place of f (`ce.levelled`); f alone decides the event. The
        curve
        then holds at and below gamma only.

    >>> import ce
    >>> base = ce.Product([ce.Normal([0.0, 0.0], [[1.0, 0.0], [0.0, 1.0]])])
    >>> est = ce.estimate(lambda x: 4.0 - x[:, 0] - x[:, 1], base, gamma=0.0, budget=10_000)
    >>> print(est.method, est.rollouts, est.converged)
    mixture 10000 True
    >>> low, high = est.ci
    >>> print(low < 0.0023389 < high, abs(est.p / 0.0023389 - 1.0) < 0.05)
    True True
    """
    if options is None:
        options = options_for(method, budget, rel_error, confidence)
    chosen = algorithm(method, base, gamma, options)
    if level is None:
        return _run(f, chosen, seed)
    climbed = level
    return _run(lambda x: levelled(f(x), climbed(x), chosen.gamma), chosen, seed)


def options_for(method: str, budget: int, rel_error: float | None, confidence: float) -> Options:
    """A method's options where nothing else is known."""
    if method == "ce":
        return general_options(budget, rel_error, confidence)
    _, options_type = _kind(method)
    return options_type(budget=budget, rel_error=rel_error, confidence=confidence)


def present_options(method: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """A method's options by name, former names (with a DeprecationWarning) replaced by those of today.

    >>> import ce
    >>> ce.present_options("mixture", {"mode_search_share": 0.0})
    {'mode_search_share': 0.0}
    """
    return with_present_names(FORMER_NAMES if method == "mixture" else {}, given)


def _kind(method: str) -> tuple[Callable[..., Algorithm[Any]], type[Options]]:
    if method not in KINDS:
        raise OptionsError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    return KINDS[method]


def _run(f: Callable[[NDArray[np.float64]], ArrayLike], chosen: Algorithm[Any], seed: int) -> Estimate:
    state = chosen.init(seed)
    while (batch := chosen.propose(state)) is not None:
        state, _ = chosen.update(state, batch, f(batch.x))
    return chosen.estimate(state)
