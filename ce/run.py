"""`ce.algorithm` picks an algorithm by name; `ce.estimate` runs one against a function f in this process."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.cross_entropy import CrossEntropy, CrossEntropyOptions
from ce.errors import OptionsError
from ce.naive import Naive, NaiveOptions
from ce.product import Product
from ce.results import Estimate

METHODS = ("naive", "ce")
Options = NaiveOptions | CrossEntropyOptions


def algorithm(name: str, base: Product, gamma: float, options: Options | None = None) -> Naive | CrossEntropy:
    """The algorithm "naive" or "ce" for p = P0(f(X) <= gamma), with its own kind of options (None: the
    defaults).
    """
    kinds = {"naive": (Naive, NaiveOptions), "ce": (CrossEntropy, CrossEntropyOptions)}
    if name not in kinds:
        raise OptionsError(f"method must be one of {', '.join(METHODS)}, not {name!r}")
    make, options_kind = kinds[name]
    if options is None:
        options = options_kind()
    if not isinstance(options, options_kind):
        raise OptionsError(f"method {name!r} takes {options_kind.__name__}, not {type(options).__name__}")
    return make(base, gamma, options)


def general_options(budget: int = 100_000, rel_error: float | None = None, confidence: float = 0.95):
    """Cross-entropy options for a problem of which nothing is known: no box on the means, wide bounds on
    the Betas.

    The paper's constraint set (the defaults of CrossEntropyOptions) is made for its driver model's weights.
    """
    return CrossEntropyOptions(
        budget=budget, rel_error=rel_error, confidence=confidence, beta_bounds=(0.2, 50.0), mean_box=None
    )


def estimate(
    f: Callable[[NDArray[np.float64]], ArrayLike],
    base: Product,
    gamma: float,
    method: str = "ce",
    budget: int = 100_000,
    rel_error: float | None = None,
    confidence: float = 0.95,
    seed: int = 0,
    options: Options | None = None,
) -> Estimate:
    """Estimate p = P0(f(X) <= gamma) by calling f at most `budget` times.

    f: (n, d) -> (n,), low is dangerous, NaN = the rollout failed. method: "naive" or "ce". rel_error:
    relative half-width of the interval at which to stop early. seed: 0 <= seed < 2^64; same seed, same
    bits. options: replaces budget, rel_error and confidence by the method's own options. Raises CeError for
    wrong use; what f raises passes through.
    """
    if options is None and method == "naive":
        options = NaiveOptions(budget=budget, rel_error=rel_error, confidence=confidence)
    elif options is None and method == "ce":
        options = general_options(budget, rel_error, confidence)
    chosen = algorithm(method, base, gamma, options)
    state = chosen.init(seed)
    while (batch := chosen.propose(state)) is not None:
        state, _ = chosen.update(state, batch, f(batch.x))
    return chosen.estimate(state)
