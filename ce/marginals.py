"""One-dimensional marginals by transform: X = T(U), U ~ N(shift, 1), T = F^{-1}(Phi) with F the named distribution.

shift = 0 is the named distribution itself; proposals move the shift, which makes every one of these a natural
exponential family with Gamma(x) = u, theta = shift, A(theta) = theta^2 / 2 and the named distribution as carrier.
Both tails go through the function that is accurate there (F or 1 - F).
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ce.errors import FamilyError

Array = NDArray[np.float64]

# |u| beyond which Phi(-|u|) is no longer a normal number.
_FARTHEST = 37.0


class Marginal:
    """What the families below, all of them dataclasses, share; not to be used itself."""

    dim = 1
    shift: float

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            try:
                number = float(value)
            except (TypeError, ValueError):
                raise FamilyError(f"{self._name} {field.name} must be one number, not {value!r}") from None
            if math.isnan(number) or (math.isinf(number) and field.name not in ("low", "high")):
                raise FamilyError(f"{self._name} {field.name} must be finite, not {number}")
            object.__setattr__(self, field.name, number)
        self._check()

    @property
    def _name(self) -> str:
        return type(self).__name__

    def _check(self) -> None:
        for name in ("scale", "shape", "rate", "sigma", "deviation"):
            if getattr(self, name, 1.0) <= 0:
                raise FamilyError(f"{self._name} needs {name} > 0, not {getattr(self, name)}")
        if not getattr(self, "low", 0.0) < getattr(self, "high", 1.0):
            raise FamilyError(f"{self._name} needs low < high")

    def shifted(self, shift: float) -> Self:
        """The same family member with that shift."""
        return replace(self, shift=float(shift))  # type: ignore[type-var]

    def from_standard(self, u: Array) -> Array:
        """T(u), elementwise."""
        u = np.clip(u, -_FARTHEST, _FARTHEST)
        tail = ndtr(-np.abs(u))
        return np.where(u < 0, self._quantile(tail, True), self._quantile(tail, False))

    def to_standard(self, x: Array) -> Array:
        """The inverse of T; FamilyError outside the support."""
        below, above = self._tail(x, True), self._tail(x, False)
        if not np.all((below >= 0) & (above >= 0) & (below + above > 0.5)) or not self._holds(x):
            raise FamilyError(f"a value lies outside the support of its {self._name} marginal")
        u: Array = np.clip(np.where(below < above, ndtri(below), -ndtri(above)), -_FARTHEST, _FARTHEST)
        return u

    def log_density(self, x: Array) -> Array:
        """log p(x), elementwise, per unit of x."""
        return self._log_pdf(x) + self.shift * self.to_standard(x) - 0.5 * self.shift**2

    def _holds(self, x: Array) -> bool:
        return True

    def _quantile(self, q: Array, lower: bool) -> Array:
        """Where F(x) = q, or where 1 - F(x) = q for the upper tail."""
        raise NotImplementedError

    def _tail(self, x: Array, lower: bool) -> Array:
        """F(x), or 1 - F(x) for the upper tail."""
        raise NotImplementedError

    def _log_pdf(self, x: Array) -> Array:
        raise NotImplementedError


@dataclass(frozen=True)
class Uniform(Marginal):
    """Uniform on (low, high).

    low: lower end, in the coordinate's own unit
    high: upper end
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> ce.Product([ce.Uniform(0.0, 2.0)]).log_density([[1.0]]).round(4).tolist()
    [-0.6931]
    """

    low: float = 0.0
    high: float = 1.0
    shift: float = 0.0

    def _check(self) -> None:
        if not (self.low < self.high and math.isfinite(self.high - self.low)):
            raise FamilyError(f"Uniform needs finite low < high, not ({self.low}, {self.high})")

    def _quantile(self, q: Array, lower: bool) -> Array:
        width = self.high - self.low
        return self.low + width * q if lower else self.high - width * q

    def _tail(self, x: Array, lower: bool) -> Array:
        return (x - self.low if lower else self.high - x) / (self.high - self.low)

    def _log_pdf(self, x: Array) -> Array:
        return np.full(np.shape(x), -math.log(self.high - self.low))


@dataclass(frozen=True)
class LogNormal(Marginal):
    """exp(mu + sigma U), positive.

    mu: mean of the logarithm
    sigma: standard deviation of the logarithm, above 0
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> float(ce.LogNormal(mu=0.0, sigma=0.5).from_standard(np.array(0.0)))
    1.0
    """

    mu: float = 0.0
    sigma: float = 1.0
    shift: float = 0.0

    def from_standard(self, u: Array) -> Array:
        """T(u), elementwise."""
        return np.exp(self.mu + self.sigma * u)

    def to_standard(self, x: Array) -> Array:
        """The inverse of T; FamilyError outside the support."""
        if not np.all(x > 0):
            raise FamilyError("a value lies outside the support of its LogNormal marginal")
        return (np.log(x) - self.mu) / self.sigma

    def _log_pdf(self, x: Array) -> Array:
        u = self.to_standard(x)
        return -0.5 * u * u - np.log(x) - math.log(self.sigma * math.sqrt(2.0 * math.pi))


class _ByHazard(Marginal):
    """What Weibull and Exponential share: 1 - F(x) = exp(-H(x)) above an origin, H the cumulative hazard."""

    origin: float

    def _hazard(self, x: Array) -> Array:
        raise NotImplementedError

    def _at_hazard(self, h: Array) -> Array:
        raise NotImplementedError

    def _holds(self, x: Array) -> bool:
        return bool(np.all(x >= self.origin))

    def _quantile(self, q: Array, lower: bool) -> Array:
        return self._at_hazard(-np.log1p(-q) if lower else -np.log(q))

    def _tail(self, x: Array, lower: bool) -> Array:
        h = self._hazard(x)
        return -np.expm1(-h) if lower else np.exp(-h)


@dataclass(frozen=True)
class Weibull(_ByHazard):
    """1 - F(x) = exp(-((x - origin) / scale)^shape).

    shape: above 0, dimensionless
    scale: above 0, in the coordinate's own unit
    origin: smallest value
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.Weibull(2.0).from_standard(np.array(0.0))):.4f}"
    '0.8326'
    """

    shape: float
    scale: float = 1.0
    origin: float = 0.0
    shift: float = 0.0

    def _hazard(self, x: Array) -> Array:
        return np.maximum((x - self.origin) / self.scale, 0.0) ** self.shape

    def _at_hazard(self, h: Array) -> Array:
        return self.origin + self.scale * h ** (1.0 / self.shape)

    def _log_pdf(self, x: Array) -> Array:
        ratio = (x - self.origin) / self.scale
        with np.errstate(divide="ignore"):
            return math.log(self.shape / self.scale) + (self.shape - 1.0) * np.log(ratio) - self._hazard(x)


@dataclass(frozen=True)
class Exponential(_ByHazard):
    """1 - F(x) = exp(-rate (x - origin)).

    rate: above 0, per unit of the coordinate
    origin: smallest value
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.Exponential(rate=2.0).from_standard(np.array(0.0))):.4f}"
    '0.3466'
    """

    rate: float = 1.0
    origin: float = 0.0
    shift: float = 0.0

    def _hazard(self, x: Array) -> Array:
        return self.rate * (x - self.origin)

    def _at_hazard(self, h: Array) -> Array:
        return self.origin + h / self.rate

    def _log_pdf(self, x: Array) -> Array:
        return math.log(self.rate) - self._hazard(x)


@dataclass(frozen=True)
class Gumbel(Marginal):
    """Largest values: F(x) = exp(-exp(-(x - location) / scale)).

    location: mode, in the coordinate's own unit
    scale: above 0
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.Gumbel().from_standard(np.array(0.0))):.4f}"
    '0.3665'
    """

    location: float = 0.0
    scale: float = 1.0
    shift: float = 0.0

    def _decay(self, x: Array) -> Array:
        return np.exp(-(x - self.location) / self.scale)

    def _quantile(self, q: Array, lower: bool) -> Array:
        return self.location - self.scale * np.log(-np.log(q) if lower else -np.log1p(-q))

    def _tail(self, x: Array, lower: bool) -> Array:
        return np.exp(-self._decay(x)) if lower else -np.expm1(-self._decay(x))

    def _log_pdf(self, x: Array) -> Array:
        return -(x - self.location) / self.scale - self._decay(x) - math.log(self.scale)


@dataclass(frozen=True)
class TruncatedNormal(Marginal):
    """N(mean, deviation^2) given low < x < high.

    mean: before the truncation, in the coordinate's own unit
    deviation: standard deviation before the truncation, above 0
    low: lower end, may be -inf
    high: upper end, may be +inf
    shift: of U, 0 in a base distribution

    >>> import ce
    >>> f"{float(ce.TruncatedNormal(low=0.0).from_standard(np.array(0.0))):.4f}"
    '0.6745'
    """

    mean: float = 0.0
    deviation: float = 1.0
    low: float = -math.inf
    high: float = math.inf
    shift: float = 0.0

    @property
    def _ends(self) -> tuple[float, float]:
        """The ends in deviations from the mean, mirrored so that the interval begins in the lower half."""
        a, b = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        return (-b, -a) if a > 0 else (a, b)

    @property
    def _sign(self) -> float:
        return -1.0 if self.low > self.mean else 1.0

    @property
    def _mass(self) -> float:
        a, b = self._ends
        return float(ndtr(b) - ndtr(a)) if b < 0 else float(1.0 - ndtr(a) - ndtr(-b))

    def _quantile(self, q: Array, lower: bool) -> Array:
        a, b = self._ends
        if lower == (self._sign > 0):
            z = ndtri(ndtr(a) + q * self._mass)
        else:
            z = -ndtri(ndtr(-b) + q * self._mass) if b > 0 else ndtri(ndtr(b) - q * self._mass)
        x: Array = np.clip(self.mean + self.deviation * self._sign * np.clip(z, a, b), self.low, self.high)
        return x

    def _tail(self, x: Array, lower: bool) -> Array:
        a, b = self._ends
        z = np.clip(self._sign * (x - self.mean) / self.deviation, a, b)
        share: Array
        if lower == (self._sign > 0):
            share = ndtr(z) - ndtr(a)
        else:
            share = ndtr(-z) - ndtr(-b) if b > 0 else ndtr(b) - ndtr(z)
        return share / self._mass

    def _holds(self, x: Array) -> bool:
        return bool(np.all((x >= self.low) & (x <= self.high)))

    def _log_pdf(self, x: Array) -> Array:
        z = (x - self.mean) / self.deviation
        return -0.5 * z * z - math.log(self.deviation * math.sqrt(2.0 * math.pi) * self._mass)
