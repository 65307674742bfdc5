"""Robustness of signal temporal logic formulas over the states of a rollout (Donze and Maler 2010, discrete time).

At state k of n, with the window of an interval [a:b] being the states k + a to k + b that there are:

    phi >= c             phi - c;  phi <= c: c - phi
    not, and, or         -phi, min, max;  phi implies psi: max(-phi, psi)
    always, eventually   min, max of phi over the window;  historically, once: over the states before
    phi until psi        max over k' in the window of min(psi at k', the least phi from k up to but without k')
    phi since psi        the same backwards

A rollout ends, and beyond its end nothing is demanded and nothing happens: over a window that lies wholly beyond it,
`always` is FAR and `eventually` and `until` are -FAR. Only sums, products, roots, min and max are used, which IEEE 754
fixes to the bit.
"""

from collections.abc import Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from service.errors import InputError
from service.world.safety.formula_language import Instruction, Program

FAR = 1000.0  # what a signal that is infinite counts as (no vehicle closing in, no vehicle at all)
MIRRORED = {"historically": "always", "once": "eventually", "since": "until"}


def robustness(program: Program, signals: Mapping[str, np.ndarray]) -> np.ndarray:
    """The robustness at each state, (states,); InputError where the formula has no value.

    signals: (states,) by name
    """
    states = len(next(iter(signals.values())))
    stack: list[np.ndarray] = []
    for step in program.instructions:
        if step.operator == "signal":
            stack.append(signals[step.name])
        elif step.operator == "number":
            stack.append(np.full(states, step.number))
        elif step.operator in ("negative", "not"):
            stack.append(-stack.pop())
        elif step.operator == "abs":
            stack.append(np.abs(stack.pop()))
        elif step.operator == "sqrt":
            stack.append(_root(stack.pop()))
        elif step.operator in ("always", "eventually", "historically", "once"):
            stack.append(_over_time(step, stack.pop()))
        else:
            right = stack.pop()
            stack.append(_joined(step, stack.pop(), right))
    value = stack.pop() + 0.0  # so that 0 has one sign
    if not np.all(np.isfinite(value)):
        raise InputError("the formula's value is not a number: its products are too large")
    return value


def _root(value: np.ndarray) -> np.ndarray:
    if np.any(value < 0.0):
        raise InputError(f"the formula takes the root of {value.min():g}; use abs(...) within sqrt(...)")
    return np.sqrt(value)


def _joined(step: Instruction, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):  # the sum of it is looked at, once, at the end
        match step.operator:
            case "+":
                return left + right
            case "-" | ">=" | ">":
                return left - right
            case "<=" | "<":
                return right - left
            case "*":
                return left * right
    match step.operator:
        case "and":
            return np.minimum(left, right)
        case "or":
            return np.maximum(left, right)
        case "implies":
            return np.maximum(-left, right)
        case "since":
            return _until(left[::-1], right[::-1], step.window)[::-1]
    return _until(left, right, step.window)


def _over_time(step: Instruction, value: np.ndarray) -> np.ndarray:
    if step.operator in MIRRORED:
        return _ahead(MIRRORED[step.operator], value[::-1], step.window)[::-1]
    return _ahead(step.operator, value, step.window)


def _ahead(operator: str, value: np.ndarray, window: tuple[int, int] | None) -> np.ndarray:
    """The least (`always`) or greatest value of the states ahead, (states,)."""
    extreme, nothing = (np.minimum, FAR) if operator == "always" else (np.maximum, -FAR)
    states = len(value)
    if window is None:
        return extreme.accumulate(value[::-1])[::-1]
    low, high = window[0], min(window[1], states - 1)
    if low > high:
        return np.full(states, nothing)
    # what pads a window that the rollout's end cuts must not count in it, however large the values are
    ahead = np.concatenate([value[low:], np.full(high, np.inf if operator == "always" else -np.inf)])
    found = extreme.reduce(sliding_window_view(ahead, high - low + 1)[:states], axis=1)
    found[states - low :] = nothing
    return found


def _until(left: np.ndarray, right: np.ndarray, window: tuple[int, int] | None) -> np.ndarray:
    """The robustness of `left until right` at each state, (states,)."""
    states = len(left)
    low, high = (0, states - 1) if window is None else (window[0], min(window[1], states - 1))
    found = np.full(states, -FAR)
    found[: states - low] = -np.inf  # these have a window
    held = np.full(states, np.inf)  # the least of `left` from each state on, as far as the offset
    for offset in range(high + 1):
        here = states - offset
        if offset:
            held[:here] = np.minimum(held[:here], left[offset - 1 : offset - 1 + here])
        if offset >= low:
            found[:here] = np.maximum(found[:here], np.minimum(held[:here], right[offset:]))
    return found
