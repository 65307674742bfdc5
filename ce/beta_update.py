"""The Beta part of the update: argmax of theta^T m - A(theta) over a box of (alpha, beta), for many
marginals at once.

A = log B is convex but not DCP, so no modelling language takes it; the problems have two variables each.
Projected Newton (Bertsekas, SIAM J. Control Optim. 20, 1982): coordinates held at a bound by the gradient
are fixed, the rest take a Newton step, halved until the objective falls enough. Vectorised over the
marginals.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, digamma, polygamma

Array = NDArray[np.float64]

_STEPS = 200
_HALVINGS = 40
# On the projected gradient, in nats.
_TOLERANCE = 1e-12


def update(start: Array, target: Array, low: Array, high: Array) -> Array:
    """theta (2, m), in [low, high] exactly, that minimises A(theta) - theta^T target for each of m marginals.

    start: (2, m), within the box
    target: (2, m), mean statistics E[log u], E[log(1 - u)]
    low: (2, m), above 0
    high: (2, m)
    """
    theta = np.clip(start, low, high)
    value = _objective(theta, target)
    for _ in range(_STEPS):
        gradient, h00, h01, h11 = _derivatives(theta, target)
        held = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
        free_gradient = np.where(held, 0.0, gradient)
        moving = np.abs(theta - np.clip(theta - gradient, low, high)).max(axis=0) > _TOLERANCE
        if not moving.any():
            break
        step = _newton_step(free_gradient, h00, h01, h11, held)
        size = np.where(moving, 1.0, 0.0)
        accepted = ~moving
        best, best_value = theta.copy(), value.copy()
        for _ in range(_HALVINGS):
            trial = np.clip(theta + size * step, low, high)
            trial_value = _objective(trial, target)
            # A decrease smaller than rounding counts as one: Newton's last steps are of that size.
            enough = trial_value <= value + 1e-4 * np.sum(
                gradient * (trial - theta), axis=0
            ) + 1e-15 * np.abs(value)
            now = enough & ~accepted
            best[:, now], best_value[now] = trial[:, now], trial_value[now]
            accepted |= now
            if accepted.all():
                break
            size = np.where(accepted, size, 0.5 * size)
        if np.array_equal(best, theta):
            break
        theta, value = best, best_value
    return theta


def _objective(theta: Array, target: Array) -> Array:
    value: Array = betaln(theta[0], theta[1]) - np.sum(theta * target, axis=0)
    return value


def _derivatives(theta: Array, target: Array) -> tuple[Array, Array, Array, Array]:
    """Gradient (2, m) and the Hessian's entries (m,) of A(theta) - theta^T target."""
    both, both1 = digamma(theta.sum(axis=0)), polygamma(1, theta.sum(axis=0))
    gradient = digamma(theta) - both - target
    return gradient, polygamma(1, theta[0]) - both1, -both1, polygamma(1, theta[1]) - both1


def _newton_step(gradient: Array, h00: Array, h01: Array, h11: Array, held: NDArray[np.bool_]) -> Array:
    """-H^{-1} g in the coordinates not held, 0 in those held; all (2, m)."""
    coupled = ~held.any(axis=0)
    off = np.where(coupled, h01, 0.0)
    determinant = h00 * h11 - off * off
    adjugate = np.stack([h11 * gradient[0] - off * gradient[1], h00 * gradient[1] - off * gradient[0]])
    step: Array = -adjugate / determinant
    return step
