"""Checks shared by the algorithms: what goes in is refused by name before any rollout is spent."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ce.errors import BudgetError, FamilyError, OptionsError, ResponseError, StateError, ThresholdError
from ce.product import Product
from ce.records import Batch

# Rollouts that a budget may have.
MOST_ROLLOUTS = 10**12


def checked_problem(base: Product, gamma: float) -> tuple[Product, float]:
    """The base as a Product and gamma as a finite float."""
    if not isinstance(base, Product):
        try:
            base = Product(base)
        except TypeError:
            raise FamilyError(f"the base must be a ce.Product, not {type(base).__name__}") from None
    try:
        if isinstance(gamma, str):
            raise TypeError
        gamma = float(gamma)
    except (TypeError, ValueError):
        raise ThresholdError(f"gamma must be a number, not {gamma!r}") from None
    if not math.isfinite(gamma):
        raise ThresholdError(f"gamma must be finite, not {gamma}")
    return base, gamma


def in_range(name: str, value: float, low: float, high: float) -> None:
    """OptionsError unless low < value < high."""
    if not (isinstance(value, int | float) and low < value < high):
        raise OptionsError(f"{name} must lie between {low:g} and {high:g}, not {value!r}")


def at_least(name: str, value: int, least: int) -> None:
    """OptionsError unless value is an integer >= least."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise OptionsError(f"{name} must be an integer of at least {least}, not {value!r}")


def budget_of_at_least(least: int, budget: int, method: str) -> None:
    """BudgetError unless budget is at least that many rollouts, and not absurd; OptionsError unless it is a positive
    integer."""
    budget_is_an_integer(budget)
    if budget < least:
        raise BudgetError(f"method {method} needs a budget of at least {least}, not {budget}")


def budget_is_an_integer(budget: int) -> None:
    """OptionsError unless budget is an integer; BudgetError above MOST_ROLLOUTS."""
    if isinstance(budget, float | np.floating) and float(budget).is_integer():
        raise OptionsError(f"budget must be an integer, not {budget!r}; write {int(budget)}")
    if isinstance(budget, bool) or not isinstance(budget, int | np.integer):
        raise OptionsError(f"budget must be an integer, not {budget!r}")
    if budget > MOST_ROLLOUTS:
        raise BudgetError(
            f"budget must be at most {MOST_ROLLOUTS:,} rollouts, not {budget}: no run of so many ends"
        )


def precision_in_range(rel_error: float | None, confidence: float) -> None:
    """OptionsError unless 0 < confidence < 1 and rel_error, where there is one, is positive and finite."""
    in_range("confidence", confidence, 0, 1)
    if rel_error is not None:
        in_range("rel_error", rel_error, 0, math.inf)


def checked_response(batch: Batch, f: ArrayLike) -> NDArray[np.float64]:
    """f as float64 of shape (n,), NaN allowed (a failed rollout), infinities allowed; else ResponseError."""
    n = batch.x.shape[0]
    if isinstance(f, np.ma.MaskedArray) and np.ma.is_masked(f):
        raise ResponseError(
            "f must give a plain array; write NaN for failed rollouts in place of masked entries"
        )
    try:
        given = np.asarray(f)
        if given.dtype.kind not in "biufO":
            raise TypeError
        values = given.astype(np.float64)
    except (TypeError, ValueError):
        raise ResponseError(f"f must give real numbers, one for each of the {n} rows") from None
    if values.shape != (n,):
        raise ResponseError(f"f must give shape ({n},) for x of shape {batch.x.shape}, not {values.shape}")
    return values.copy()


def checked_turn(batch: Batch, seed: int, phase: str, iteration: int, start: int) -> None:
    """StateError unless the batch is the one that the state proposes next."""
    given = (batch.seed, batch.phase, batch.iteration, batch.start)
    expected = (seed, phase, iteration, start)
    if given != expected:
        raise StateError(
            f"the batch (seed, phase, iteration, start) = {given} does not answer this state, which "
            f"expects {expected}"
        )
