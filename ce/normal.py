"""Multivariate Normal block, as a natural exponential family.

With the covariance fixed, as in the paper: Gamma(x) = x, theta = Sigma^{-1} mu, A(theta) = theta^T Sigma
theta / 2, carrier N(0, Sigma). With the covariance free: Gamma(x) = (x, x x^T), theta = (Sigma^{-1} mu,
-Sigma^{-1} / 2).
"""

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular

from ce.errors import FamilyError
from ce.linear import Correlator, cholesky, solve

Array = NDArray[np.float64]


class Normal:
    """Block of d coordinates, N(mean, cov); FamilyError for wrong parameters. Not to be changed after construction.

    The factor of the covariance is computed once and shared by every Normal made with `with_mean`.

    mean: (d,), in the coordinates' own units
    cov: (d, d), symmetric positive definite

    >>> import ce
    >>> ce.Normal([0.0, 1.0], [[1.0, 0.3], [0.3, 2.0]]).dim
    2
    >>> ce.Normal([0.0, 1.0], [[1.0, 2.0], [2.0, 1.0]])  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ce.errors.FamilyError: the covariance is not positive definite: pivot 1 is -3; give ...
    """

    def __init__(self, mean: ArrayLike, cov: ArrayLike) -> None:
        mean_ = np.atleast_1d(np.array(mean, dtype=np.float64))
        cov_ = np.array(cov, dtype=np.float64)
        if mean_.ndim != 1 or mean_.size == 0:
            raise FamilyError(f"Normal mean must have shape (d,), not {mean_.shape}")
        if cov_.ndim == 0:
            cov_ = cov_.reshape(1, 1)
        if cov_.shape != (mean_.size, mean_.size):
            raise FamilyError(f"Normal cov must have shape {(mean_.size, mean_.size)}, not {cov_.shape}")
        if not (np.all(np.isfinite(mean_)) and np.all(np.isfinite(cov_))):
            raise FamilyError("Normal mean and cov must be finite")
        scale = float(np.abs(cov_).max())
        if np.abs(cov_ - cov_.T).max() > 1e-9 * scale:
            raise FamilyError(
                "Normal cov must be symmetric; give (cov + cov.T) / 2 if the difference is rounding"
            )
        cov_ = 0.5 * (cov_ + cov_.T)
        self._set(mean_, cov_, cholesky(cov_))

    def _set(self, mean: Array, cov: Array, factor: Array) -> None:
        for array in (mean, cov, factor):
            array.setflags(write=False)
        self.mean, self.cov, self.factor = mean, cov, factor

    @property
    def dim(self) -> int:
        """Number of coordinates."""
        return self.mean.size

    def with_mean(self, mean: Array) -> "Normal":
        """N(mean, the same covariance)."""
        if mean.shape != self.mean.shape or not np.all(np.isfinite(mean)):
            raise FamilyError(f"mean must be {self.mean.shape} finite numbers")
        other = object.__new__(Normal)
        other._set(np.array(mean), self.cov, self.factor)
        other.__dict__["correlator"] = self.correlator  # it depends on the covariance alone
        return other

    @functools.cached_property
    def correlator(self) -> Correlator:
        """z -> z L^T, the same bits everywhere."""
        return Correlator(self.factor)

    def coloured(self, u: Array) -> Array:
        """u L^T, (n, d), of standard normal u (n, d)."""
        return u * np.diagonal(self.factor) if self.independent else u @ self.factor.T

    def whitened(self, centred: Array) -> Array:
        """The inverse of `coloured`, of x - mean (n, d)."""
        u: Array = solve_triangular(self.factor, centred.T, lower=True)
        return u.T

    @functools.cached_property
    def independent(self) -> bool:
        """No two coordinates are correlated: the factor is diagonal."""
        return bool(np.count_nonzero(self.factor) == self.dim)

    @functools.cached_property
    def precision_mean(self) -> Array:
        """theta = Sigma^{-1} mu, (d,)."""
        return solve(self.factor, self.mean)

    def log_partition(self) -> float:
        """A(theta) = mu^T Sigma^{-1} mu / 2 of the family with fixed covariance."""
        return 0.5 * float(np.sum(self.mean * self.precision_mean))

    def log_density(self, x: Array) -> Array:
        """log p, (n,), of x (n, d)."""
        whitened = solve_triangular(self.factor, (x - self.mean).T, lower=True)
        constant = 0.5 * self.dim * np.log(2 * np.pi) + np.sum(np.log(np.diagonal(self.factor)))
        log_p: Array = -0.5 * np.sum(whitened**2, axis=0) - constant
        return log_p

    def log_ratio(self, other: "Normal", x: Array) -> Array:
        """log p_self(x) - log p_other(x), (n,); (x - (mu + mu') / 2)^T Sigma^{-1} (mu - mu') with one covariance."""
        if self.factor is other.factor:
            direction = solve(self.factor, self.mean - other.mean)
            ratio: Array = np.sum((x - 0.5 * (self.mean + other.mean)) * direction, axis=1)
            return ratio
        return self.log_density(x) - other.log_density(x)

    def kl(self, other: "Normal") -> float:
        """KL(self || other), nats."""
        shift = self.mean - other.mean
        distance = float(np.sum(shift * solve(other.factor, shift)))
        if self.factor is other.factor:
            return 0.5 * distance
        relative = solve_triangular(other.factor, self.factor, lower=True)
        log_det = np.sum(np.log(np.diagonal(other.factor))) - np.sum(np.log(np.diagonal(self.factor)))
        return 0.5 * (float(np.sum(relative**2)) - self.dim + distance) + float(log_det)
