"""Beta marginals on an interval, as a natural exponential family.

With u = (x - low) / (high - low):  log p(x) = alpha log u + beta log(1 - u) - log B(alpha, beta)
- log(u (1 - u) (high - low)); so Gamma(x) = (log u, log(1 - u)), theta = (alpha, beta), A(theta) = log
B(alpha, beta) and the carrier measure is dx / (u (1 - u) (high - low)).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, digamma

from ce.errors import FamilyError

Array = NDArray[np.float64]

# u is kept this far from 0 and 1, where its logarithms would be infinite: a sample rounded to an end of its
# interval is taken to lie one rounding error inside.
_U_LEAST = 1e-300
_U_GREATEST = 1.0 - 2.0**-53


@dataclass(frozen=True)
class Beta:
    """One coordinate, Beta(alpha, beta) stretched to (low, high); FamilyError for wrong parameters.

    alpha: above 0, dimensionless
    beta: above 0, dimensionless
    low: lower end, in the coordinate's own unit
    high: upper end, above low

    >>> import ce
    >>> ce.Beta(2, 2, low=80, high=120)
    Beta(alpha=2.0, beta=2.0, low=80.0, high=120.0)
    >>> ce.Beta(0, 2)
    Traceback (most recent call last):
    ce.errors.FamilyError: Beta needs alpha > 0 and beta > 0, not (0.0, 2.0)
    """

    alpha: float
    beta: float
    low: float = 0.0
    high: float = 1.0

    def __post_init__(self) -> None:
        for name in ("alpha", "beta", "low", "high"):
            try:
                value = float(getattr(self, name))
            except (TypeError, ValueError):
                raise FamilyError(f"Beta {name} must be one number, not {getattr(self, name)!r}") from None
            if not math.isfinite(value):
                raise FamilyError(f"Beta {name} must be finite, not {value}")
            object.__setattr__(self, name, value)
        if self.alpha <= 0 or self.beta <= 0:
            raise FamilyError(f"Beta needs alpha > 0 and beta > 0, not ({self.alpha}, {self.beta})")
        if not self.low < self.high:
            raise FamilyError(f"Beta needs low < high, not ({self.low}, {self.high})")

    dim = 1


class BetaColumns:
    """Independent Beta marginals as arrays, which is what `Product` works with.

    alpha: (m,)
    beta: (m,)
    low: (m,), in each coordinate's own unit
    high: (m,), in each coordinate's own unit
    """

    def __init__(self, alpha: Array, beta: Array, low: Array, high: Array) -> None:
        self.alpha, self.beta, self.low, self.high = alpha, beta, low, high
        self.width = high - low

    @classmethod
    def of(cls, blocks: list[Beta]) -> "BetaColumns":
        """The columns of those marginals."""
        table = np.array([(b.alpha, b.beta, b.low, b.high) for b in blocks], dtype=np.float64).reshape(-1, 4)
        return cls(*np.ascontiguousarray(table.T))

    def unit(self, x: Array) -> Array:
        """u (n, m) in (0, 1) of x (n, m); raises FamilyError outside [low, high]."""
        if not np.all((x >= self.low) & (x <= self.high)):
            raise FamilyError(
                "a value lies outside the interval of its Beta marginal; give x within [low, high]"
            )
        return np.clip((x - self.low) / self.width, _U_LEAST, _U_GREATEST)

    def statistics(self, x: Array) -> tuple[Array, Array]:
        """log u and log(1 - u), each (n, m)."""
        u = self.unit(x)
        return np.log(u), np.log1p(-u)

    def log_partition(self) -> Array:
        """A(theta) = log B(alpha, beta), (m,)."""
        a: Array = betaln(self.alpha, self.beta)
        return a

    def mean_statistics(self) -> tuple[Array, Array]:
        """Gradient of A: (psi(alpha) - psi(alpha + beta), psi(beta) - psi(alpha + beta)), each (m,)."""
        both = digamma(self.alpha + self.beta)
        return digamma(self.alpha) - both, digamma(self.beta) - both

    def log_density(self, x: Array) -> Array:
        """Sum over the marginals of log p, (n,), per unit of x."""
        log_u, log_v = self.statistics(x)
        terms = (self.alpha - 1) * log_u + (self.beta - 1) * log_v - self.log_partition() - np.log(self.width)
        log_p: Array = terms.sum(axis=1)
        return log_p

    def sample(self, generator: np.random.Generator, n: int) -> Array:
        """(n, m) draws."""
        u = generator.beta(self.alpha, self.beta, size=(n, self.alpha.size))
        return np.clip(self.low + self.width * u, self.low, self.high)

    def kl(self, other: "BetaColumns") -> float:
        """KL(self || other), nats, summed over the marginals: Bregman divergence of A."""
        m1, m2 = self.mean_statistics()
        terms = (self.alpha - other.alpha) * m1 + (self.beta - other.beta) * m2
        return float(np.sum(terms - self.log_partition() + other.log_partition()))
