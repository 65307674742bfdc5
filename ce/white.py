"""A block of many independent standard normals: what a Normal with the identity for its covariance is, without the
matrices, which for a thousand coordinates would cost more than the rollouts.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from ce.errors import FamilyError
from ce.normal import Normal

Array = NDArray[np.float64]


class White(Normal):
    """Block of d coordinates, N(mean, I); N(0, I) in a base distribution. Not to be changed after construction."""

    def __init__(self, dim: int) -> None:
        if isinstance(dim, bool) or not isinstance(dim, int | np.integer) or dim < 1:
            raise FamilyError(f"White needs a number of coordinates of at least 1, not {dim!r}")
        self._set_mean(np.zeros(int(dim)))

    def _set_mean(self, mean: Array) -> None:
        mean.setflags(write=False)
        self.mean = mean

    def with_mean(self, mean: Array) -> "White":
        """N(mean, I)."""
        if mean.shape != self.mean.shape or not np.all(np.isfinite(mean)):
            raise FamilyError(f"mean must be {self.mean.shape} finite numbers")
        other = object.__new__(White)
        other._set_mean(np.array(mean))
        return other

    @functools.cached_property
    def cov(self) -> Array:  # type: ignore[override]
        return np.eye(self.dim)

    @property
    def factor(self) -> Array:  # type: ignore[override]
        return self.cov

    def correlator(self, z: Array) -> Array:  # type: ignore[override]
        """z itself."""
        return z

    def coloured(self, u: Array) -> Array:
        return u

    def whitened(self, centred: Array) -> Array:
        return centred

    @property
    def precision_mean(self) -> Array:  # type: ignore[override]
        """theta = mu."""
        return self.mean

    def log_density(self, x: Array) -> Array:
        return -0.5 * np.sum((x - self.mean) ** 2, axis=1) - 0.5 * self.dim * np.log(2 * np.pi)

    def log_ratio(self, other: Normal, x: Array) -> Array:
        if isinstance(other, White):
            return np.sum((x - 0.5 * (self.mean + other.mean)) * (self.mean - other.mean), axis=1)
        return self.log_density(x) - other.log_density(x)

    def kl(self, other: Normal) -> float:
        if isinstance(other, White):
            return 0.5 * float(np.sum((self.mean - other.mean) ** 2))
        return super().kl(other)
