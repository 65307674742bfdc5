"""`ce.algorithm` picks an algorithm by name; `ce.estimate` runs one against a function f in this process."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.cross_entropy import LEAST_BUDGET, CrossEntropy, CrossEntropyOptions
from ce.errors import OptionsError
from ce.mixture import MixtureOptions, MixtureSampling
from ce.naive import Naive, NaiveOptions
from ce.product import Product
from ce.protocol import Algorithm
from ce.results import Estimate
from ce.splitting import Splitting, SplittingOptions
from ce.streams import checked_seed

KINDS: dict[str, tuple[Any, type]] = {
    "naive": (Naive, NaiveOptions),
    "ce": (CrossEntropy, CrossEntropyOptions),
    "mixture": (MixtureSampling, MixtureOptions),
    "splitting": (Splitting, SplittingOptions),
}
METHODS = tuple(KINDS)
OPTIONS: dict[str, type] = {name: kind for name, (_, kind) in KINDS.items()}
PILOT = 5000  # rollouts at most
COMMON = 0.01  # share of events in the pilot from which naive Monte Carlo is taken
Options = NaiveOptions | CrossEntropyOptions | MixtureOptions | SplittingOptions


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

    f: (n, d) -> (n,), low is dangerous, NaN = the rollout failed. method: "naive", "ce" or "auto". rel_error:
    relative half-width of the interval at which to stop early. seed: 0 <= seed < 2^64; same seed, same
    bits. options: replaces budget, rel_error and confidence by the method's own options. Raises CeError for
    wrong use; what f raises passes through.
    """
    if method == "auto":
        if options is not None:
            raise OptionsError('method "auto" picks its own options; give them with "naive" or "ce"')
        return _auto(f, base, gamma, budget, rel_error, confidence, seed)
    if options is None and method == "naive":
        options = NaiveOptions(budget=budget, rel_error=rel_error, confidence=confidence)
    elif options is None and method == "ce":
        options = general_options(budget, rel_error, confidence)
    elif options is None and method in OPTIONS:
        options = OPTIONS[method](budget=budget, rel_error=rel_error, confidence=confidence)
    return _run(f, algorithm(method, base, gamma, options), seed)


def _run(f, chosen: Algorithm, seed: int) -> Estimate:
    state = chosen.init(seed)
    while (batch := chosen.propose(state)) is not None:
        state, _ = chosen.update(state, batch, f(batch.x))
    return chosen.estimate(state)


def _auto(f, base, gamma, budget, rel_error, confidence, seed) -> Estimate:
    """ "naive" where a pilot of naive rollouts finds the event common, or the rest is too little for a
    search; else "ce".

    The pilot is a tenth of the budget, at most PILOT. It only chooses; its rollouts are counted as training.
    """
    pilot = min(PILOT, NaiveOptions(budget=budget).budget // 10)
    rest = budget - pilot
    events = 0
    if pilot:
        # Its own seed, so that the estimate's rollouts are not the pilot's.
        events = _run(
            f, Naive(base, gamma, NaiveOptions(budget=pilot)), (checked_seed(seed) + 2**63) % 2**64
        ).events
    if rest < LEAST_BUDGET or events >= COMMON * pilot:
        est = _run(f, Naive(base, gamma, NaiveOptions(rest, rel_error, confidence)), seed)
    else:
        est = _run(f, CrossEntropy(base, gamma, general_options(rest, rel_error, confidence)), seed)
    return replace(est, rollouts=est.rollouts + pilot, training_rollouts=est.training_rollouts + pilot)
