"""A block of many independent standard normals: what a Normal with the identity for its covariance is, without the
matrices, which for a thousand coordinates would cost more than the rollouts.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from ce.errors import FamilyError
from ce.normal import Normal

Array = NDArray[np.float64]


class StandardNormal(Normal):
    """Block of d coordinates, N(mean, I); N(0, I) in a base distribution. Not to be changed after construction.

    dim: number of coordinates, at least 1; FamilyError otherwise

    >>> import ce
    >>> ce.Product([ce.Beta(2, 2), ce.StandardNormal(1000)]).dim
    1001
    """

    def __init__(self, dim: int) -> None:
        if isinstance(dim, bool) or not isinstance(dim, int | np.integer) or dim < 1:
            raise FamilyError(f"StandardNormal needs a number of coordinates of at least 1, not {dim!r}")
        self._set_mean(np.zeros(int(dim)))

    def _set_mean(self, mean: Array) -> None:
        mean.setflags(write=False)
        self.mean = mean

    def with_mean(self, mean: Array) -> "StandardNormal":
        """N(mean, I)."""
        if mean.shape != self.mean.shape or not np.all(np.isfinite(mean)):
            raise FamilyError(f"mean must be {self.mean.shape} finite numbers")
        other = object.__new__(StandardNormal)
        other._set_mean(np.array(mean))
        return other

    @functools.cached_property
    def cov(self) -> Array:  # type: ignore[override]
        """I, (d, d), made only where it is asked for."""
        return np.eye(self.dim)

    @property
    def factor(self) -> Array:  # type: ignore[override]
        """I, (d, d)."""
        return self.cov

    def correlator(self, z: Array) -> Array:  # type: ignore[override]
        """z itself."""
        return z

    def coloured(self, u: Array) -> Array:
        """u itself."""
        return u

    def whitened(self, centred: Array) -> Array:
        """x - mean itself."""
        return centred

    @property
    def precision_mean(self) -> Array:
        """theta = mu, (d,)."""
        return self.mean

    def log_density(self, x: Array) -> Array:
        """log p, (n,), of x (n, d)."""
        log_p: Array = -0.5 * np.sum((x - self.mean) ** 2, axis=1) - 0.5 * self.dim * np.log(2 * np.pi)
        return log_p

    def log_ratio(self, other: Normal, x: Array) -> Array:
        """log p_self(x) - log p_other(x), (n,)."""
        if isinstance(other, StandardNormal):
            ratio: Array = np.sum((x - 0.5 * (self.mean + other.mean)) * (self.mean - other.mean), axis=1)
            return ratio
        return self.log_density(x) - other.log_density(x)

    def kl(self, other: Normal) -> float:
        """KL(self || other), nats."""
        if isinstance(other, StandardNormal):
            return 0.5 * float(np.sum((self.mean - other.mean) ** 2))
        return super().kl(other)
