"""Marginals that traffic needs beside those of `ce.marginals`: a lognormal's tail, and a normal of two spreads."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ce.errors import FamilyError
from ce.marginals import Marginal, TruncatedNormal

Array = NDArray[np.float64]

# Of the bracket of a quantile, to the last bit.
_HALVINGS = 80


@dataclass(frozen=True)
class TruncatedLogNormal(Marginal):
    """exp(mu + sigma U) given that it lies in (low, high).

    mu: mean of the logarithm before the truncation
    sigma: standard deviation of the logarithm before the truncation, above 0
    low: lower end, at least 0, in the coordinate's own unit
    high: upper end, may be +inf
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.TruncatedLogNormal(low=1.0).from_standard(np.array(0.0))):.4f}"
    '1.9630'
    """

    mu: float = 0.0
    sigma: float = 1.0
    low: float = 0.0
    high: float = math.inf
    shift: float = 0.0

    def _check(self) -> None:
        super()._check()
        if self.low < 0.0:
            raise FamilyError(f"TruncatedLogNormal needs low >= 0, not {self.low}")

    @property
    def _logarithm(self) -> TruncatedNormal:
        low = math.log(self.low) if self.low > 0.0 else -math.inf
        return TruncatedNormal(self.mu, self.sigma, low, math.log(self.high))

    def from_standard(self, u: Array) -> Array:
        """T(u), elementwise."""
        x: Array = np.clip(np.exp(self._logarithm.from_standard(u)), self.low, self.high)
        return x

    def to_standard(self, x: Array) -> Array:
        """The inverse of T; FamilyError outside the support."""
        if not np.all((x > 0.0) & (x >= self.low) & (x <= self.high)):
            raise FamilyError("a value lies outside the support of its TruncatedLogNormal marginal")
        inner = self._logarithm
        return inner.to_standard(np.clip(np.log(x), inner.low, inner.high))

    def _log_pdf(self, x: Array) -> Array:
        return self._logarithm._log_pdf(np.log(x)) - np.log(x)


@dataclass(frozen=True)
class TwoNormals(Marginal):
    """N(0, wide^2) with probability `share`, else N(0, narrow^2), given that it lies in (low, high).

    share: of the wide one, in [0, 1]
    narrow: standard deviation of the one, above 0, in the coordinate's own unit
    wide: standard deviation of the other, at least as large
    low: lower end, finite
    high: upper end, finite
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.TwoNormals(0.2, 0.5, 2.0, 0.0, 5.0).from_standard(np.array(0.0))):.4f}"
    '0.4060'
    """

    share: float
    narrow: float
    wide: float
    low: float
    high: float
    shift: float = 0.0

    def _check(self) -> None:
        super()._check()
        if not 0.0 <= self.share <= 1.0:
            raise FamilyError(f"TwoNormals needs a share from 0 to 1, not {self.share}")
        if not 0.0 < self.narrow <= self.wide:
            raise FamilyError(f"TwoNormals needs 0 < narrow <= wide, not {self.narrow} and {self.wide}")
        if not math.isfinite(self.high - self.low):
            raise FamilyError("TwoNormals needs finite ends")

    def _below(self, x: Array) -> Array:
        p: Array = self.share * ndtr(x / self.wide) + (1.0 - self.share) * ndtr(x / self.narrow)
        return p

    def _mass(self) -> float:
        return float(self._below(np.array(self.high)) - self._below(np.array(self.low)))

    def _between(self, a: Array, b: Array) -> Array:
        """Probability of (a, b), a <= b, untruncated, from the tail in which it is accurate."""
        upper = a > 0.0
        return self._below(np.where(upper, -a, b)) - self._below(np.where(upper, -b, a))

    def _tail(self, x: Array, lower: bool) -> Array:
        x = np.clip(x, self.low, self.high)
        ends = (np.full_like(x, self.low), x) if lower else (x, np.full_like(x, self.high))
        return self._between(*ends) / self._mass()

    def _quantile(self, q: Array, lower: bool) -> Array:
        q = np.asarray(q, dtype=np.float64)
        a, b = np.full_like(q, self.low), np.full_like(q, self.high)
        for _ in range(_HALVINGS):
            middle = 0.5 * (a + b)
            further = (self._tail(middle, lower) < q) == lower
            a, b = np.where(further, middle, a), np.where(further, b, middle)
        return 0.5 * (a + b)

    def _holds(self, x: Array) -> bool:
        return bool(np.all((x >= self.low) & (x <= self.high)))

    def _log_pdf(self, x: Array) -> Array:
        scale = math.sqrt(2.0 * math.pi)
        wide = self.share / (self.wide * scale) * np.exp(-0.5 * (x / self.wide) ** 2)
        narrow = (1.0 - self.share) / (self.narrow * scale) * np.exp(-0.5 * (x / self.narrow) ** 2)
        return np.log(wide + narrow) - math.log(self._mass())
