"""Markov chains in standard-normal space by preconditioned Crank-Nicolson moves.

u' = sqrt(1 - s^2) u + s z with z ~ N(0, I) leaves N(0, I) as it is (Cotter, Roberts, Stuart and White, Statistical
Science 28, 2013); kept only where f(u') <= b, it leaves N(0, I) given f <= b as it is. A rollout's own noise is part of
its state: a move keeps its seed or draws a fresh one, each half of the time.
"""

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Chains(msgspec.Struct, frozen=True, eq=False):
    """The present states of n chains, or a sample of n rows that chains may grow from.

    u: (n, d), points in standard-normal space
    f: (n,), their values
    noise: (n,) uint64, the rollouts' own seeds
    replication: (n,) int64, the number, from 0, of the replication that a row belongs to
    """

    u: Array
    f: Array
    noise: NDArray[np.uint64]
    replication: NDArray[np.int64]

    @classmethod
    def none(cls, dim: int) -> "Chains":
        """No rows, of that dimension."""
        return cls(np.zeros((0, dim)), np.zeros(0), np.zeros(0, dtype=np.uint64), np.zeros(0, dtype=np.int64))

    @property
    def size(self) -> int:
        """Number of rows."""
        return self.f.size

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> "Chains":
        """The rows of that index or mask."""
        return Chains(self.u[rows], self.f[rows], self.noise[rows], self.replication[rows])

    def joined(self, other: "Chains") -> "Chains":
        """These rows, then the other's."""
        return Chains(
            np.concatenate([self.u, other.u]),
            np.concatenate([self.f, other.f]),
            np.concatenate([self.noise, other.noise]),
            np.concatenate([self.replication, other.replication]),
        )

    def proposed(self, source: np.random.Generator, step: Array | float) -> tuple[Array, NDArray[np.uint64]]:
        """u (n, d) and noise (n,) of a move of every chain.

        source: of random numbers
        step: s in (0, 1], one for all or one a coordinate (d,)
        """
        z = source.standard_normal(self.u.shape)
        fresh = source.random(self.size) < 0.5
        noise = np.where(fresh, source.bit_generator.random_raw(self.size), self.noise)
        return np.sqrt(1.0 - step**2) * self.u + step * z, noise

    def moved(self, accepted: NDArray[np.bool_], u: Array, f: Array, noise: NDArray[np.uint64]) -> "Chains":
        """The chains after a move to (u, f, noise) where it was accepted (n,)."""
        return Chains(
            np.where(accepted[:, None], u, self.u),
            np.where(accepted, f, self.f),
            np.where(accepted, noise, self.noise),
            self.replication,
        )
