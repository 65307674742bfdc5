"""`ce.algorithm` picks an algorithm by name; `ce.estimate` runs one against a function f in this process."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.auto import Auto, AutoOptions
from ce.cross_entropy import CrossEntropy, CrossEntropyOptions
from ce.errors import OptionsError
from ce.mixture import MixtureOptions, MixtureSampling
from ce.naive import Naive, NaiveOptions
from ce.product import Product
from ce.protocol import Algorithm
from ce.results import Estimate
from ce.splitting import Splitting, SplittingOptions

KINDS: dict[str, tuple[Any, type]] = {
    "naive": (Naive, NaiveOptions),
    "ce": (CrossEntropy, CrossEntropyOptions),
    "mixture": (MixtureSampling, MixtureOptions),
    "splitting": (Splitting, SplittingOptions),
    "auto": (Auto, AutoOptions),
}
METHODS = tuple(KINDS)
OPTIONS: dict[str, type] = {name: kind for name, (_, kind) in KINDS.items()}
Options = NaiveOptions | CrossEntropyOptions | MixtureOptions | SplittingOptions | AutoOptions


def algorithm(name: str, base: Product, gamma: float, options: Options | None = None) -> Algorithm:
    """The algorithm of that name (METHODS) for p = P0(f(X) <= gamma). options: of its own kind, None = defaults."""
    if name not in KINDS:
        raise OptionsError(f"method must be one of {', '.join(METHODS)}, not {name!r}")
    make, options_kind = KINDS[name]
    if options is None:
        options = options_kind()
    if not isinstance(options, options_kind):
        raise OptionsError(f"method {name!r} takes {options_kind.__name__}, not {type(options).__name__}")
    return make(base, gamma, options)


def general_options(
    budget: int = 100_000, rel_error: float | None = None, confidence: float = 0.95
) -> CrossEntropyOptions:
    """Cross-entropy options where nothing is known of the problem: wide bounds, means free, KL limited.

    The paper's constraint set (the defaults of CrossEntropyOptions) is made for its driver model's weights.
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
) -> Estimate:
    """Estimate p = P0(f(X) <= gamma) by calling f at most `budget` times.

    f: (n, d) -> (n,), low is dangerous, NaN = the rollout failed. method: one of METHODS. rel_error:
    relative half-width of the interval at which to stop early. seed: 0 <= seed < 2^64; same seed, same
    bits. options: replaces budget, rel_error and confidence by the method's own options. Raises CeError for
    wrong use; what f raises passes through.
    """
    if options is None:
        options = options_for(method, budget, rel_error, confidence)
    return _run(f, algorithm(method, base, gamma, options), seed)


def options_for(method: str, budget: int, rel_error: float | None, confidence: float) -> Options:
    """A method's options where nothing else is known."""
    if method == "ce":
        return general_options(budget, rel_error, confidence)
    if method not in OPTIONS:
        raise OptionsError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    return OPTIONS[method](budget=budget, rel_error=rel_error, confidence=confidence)


def _run(f, chosen: Algorithm, seed: int) -> Estimate:
    state = chosen.init(seed)
    while (batch := chosen.propose(state)) is not None:
        state, _ = chosen.update(state, batch, f(batch.x))
    return chosen.estimate(state)
