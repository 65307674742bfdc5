"""The Normal part of the update, covariance fixed: the mean nearest to m in the metric of Sigma0^{-1},
within a box.

argmax of theta^T m - A(theta), theta = Sigma0^{-1} mu, over |mu - mu0|_inf <= box is the quadratic programme

    minimise (mu - m)^T Sigma0^{-1} (mu - m)   subject to |mu - mu0|_inf <= box.

cvxpy with OSQP (built once, only the linear term is a parameter, always started cold so that the result
does not depend on earlier calls) finds which bounds bind; an active-set polish then solves the optimality
conditions directly, and the result is clipped, so it is feasible exactly and optimal to rounding.
"""

import functools
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ce.normal import Normal
from ce.standard_normal import StandardNormal

if TYPE_CHECKING:
    import cvxpy as cp

Array = NDArray[np.float64]

_POLISH_STEPS = 30


class BoxedMean:
    """The programme for one Normal block.

    base: the block
    box: half-width of the box around its mean, above 0, in the coordinates' own units
    """

    def __init__(self, base: Normal, box: float) -> None:
        self._base, self._box = base, box

    @functools.cached_property
    def _precision(self) -> Array:
        identity = np.eye(self._base.dim)
        inverse = np.linalg.solve(self._base.factor, identity)
        return inverse.T @ inverse

    @functools.cached_property
    def _programme(self) -> tuple["cp.Problem", "cp.Variable", "cp.Parameter", float]:
        # Imported here because it takes a second, and workers, which only draw, never come here.
        import cvxpy as cp

        # In s = (mu - mu0) / box the bounds are +-1; the scale brings the objective's curvature to order 1.
        scale = 1.0 / float(np.mean(np.diagonal(self._precision)))
        s, linear = cp.Variable(self._base.dim), cp.Parameter(self._base.dim)
        precision = cp.psd_wrap(self._precision * scale)
        objective = 0.5 * cp.quad_form(s, precision) - linear @ s
        return cp.Problem(cp.Minimize(objective), [s >= -1, s <= 1]), s, linear, scale

    def update(self, target: Array) -> Array:
        """The constrained mean (d,) for the unconstrained one, target (d,)."""
        base = self._base
        wanted = (target - base.mean) / self._box
        if isinstance(base, StandardNormal) or np.all(np.abs(wanted) <= 1.0):
            return self._clipped(wanted)
        problem, s, linear, scale = self._programme
        linear.value = scale * (self._precision @ wanted)
        problem.solve(  # type: ignore[no-untyped-call]
            solver="OSQP",
            warm_start=False,
            eps_abs=1e-6,
            eps_rel=1e-6,
            max_iter=20_000,
            adaptive_rho_interval=50,  # counted in iterations: the default rule looks at the clock
            polishing=False,
        )
        found = s.value if s.value is not None else np.clip(wanted, -1, 1)
        return self._clipped(self._polished(np.clip(found, -1.0, 1.0), wanted))

    def _polished(self, s: Array, wanted: Array) -> Array:
        """Primal-dual active set (Hintermueller, Ito and Kunisch, SIAM J. Optim. 13, 2002) from OSQP's
        solution.

        Returns the exact solution when the active set settles, else the better of what it has and OSQP's.
        """
        precision = self._precision
        pull = precision @ wanted
        multiplier = pull - precision @ s
        upper, lower = (
            s + multiplier / np.diagonal(precision) > 1,
            s + multiplier / np.diagonal(precision) < -1,
        )
        for _ in range(_POLISH_STEPS):
            trial = np.where(upper, 1.0, np.where(lower, -1.0, 0.0))
            free = ~(upper | lower)
            if free.any():
                right = pull[free] - precision[np.ix_(free, ~free)] @ trial[~free]
                trial[free] = np.linalg.solve(precision[np.ix_(free, free)], right)
            multiplier = np.where(free, 0.0, pull - precision @ trial)
            now_upper = trial + multiplier / np.diagonal(precision) > 1
            now_lower = trial + multiplier / np.diagonal(precision) < -1
            if np.array_equal(now_upper, upper) and np.array_equal(now_lower, lower):
                return trial
            upper, lower = now_upper, now_lower

        def objective(v: Array) -> float:
            return float(0.5 * v @ precision @ v - pull @ v)

        trial = np.clip(trial, -1.0, 1.0)
        return trial if objective(trial) < objective(s) else s

    def _clipped(self, s: Array) -> Array:
        """mu0 + box s, with |mu - mu0| <= box as computed in floating point."""
        base, box = self._base, self._box
        mean = base.mean + box * np.clip(s, -1.0, 1.0)
        for _ in range(4):
            outside = np.abs(mean - base.mean) > box
            mean = np.where(outside, np.nextafter(mean, base.mean), mean)
        return mean
