"""Product of independent blocks: the base distribution P0 and every proposal P_theta."""

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaln, xlog1py, xlogy

from ce.beta import Beta, BetaColumns
from ce.errors import FamilyError
from ce.marginals import Marginal
from ce.normal import Normal

Array = NDArray[np.float64]
Block = Beta | Normal | Marginal


class Product:
    """Independent blocks side by side; x has shape (n, d), d = the sum of the blocks' dimensions.

    Scalar Betas are handled together as arrays. Not to be changed after construction.

    blocks: Beta and the marginals of `ce.marginals` (one coordinate each), Normal (any number)
    names: one label a coordinate, for people only

    >>> import ce
    >>> base = ce.Product([ce.Beta(2, 2, low=80, high=120), ce.Normal([0.0, 0.0], [[1.0, 0.5], [0.5, 1.0]])])
    >>> base.dim
    3
    >>> base.log_density([[100.0, 0.0, 0.0]]).round(4).tolist()
    [-4.9775]
    """

    def __init__(self, blocks: Sequence[Block], names: Sequence[str] | None = None) -> None:
        if isinstance(blocks, Beta | Normal | Marginal):
            blocks = [blocks]
        self.blocks: tuple[Block, ...] = tuple(blocks)
        if not self.blocks:
            raise FamilyError("Product needs at least one block")
        for block in self.blocks:
            if not isinstance(block, Beta | Normal | Marginal):
                raise FamilyError(
                    f"Product takes blocks (ce.Beta, ce.Normal, ce.Uniform, ...), not {type(block).__name__}"
                )
        starts = np.cumsum([0] + [block.dim for block in self.blocks])
        self.dim = int(starts[-1])
        self.starts: tuple[int, ...] = tuple(int(s) for s in starts[:-1])
        self.beta_columns = np.array(
            [s for s, b in zip(self.starts, self.blocks, strict=True) if isinstance(b, Beta)], dtype=np.intp
        )
        self.betas = BetaColumns.of([b for b in self.blocks if isinstance(b, Beta)])
        self.normals: tuple[tuple[int, Normal], ...] = tuple(
            (s, b) for s, b in zip(self.starts, self.blocks, strict=True) if isinstance(b, Normal)
        )
        self.marginals: tuple[tuple[int, Marginal], ...] = tuple(
            (s, b) for s, b in zip(self.starts, self.blocks, strict=True) if isinstance(b, Marginal)
        )
        self.names = None if names is None else tuple(str(name) for name in names)
        if self.names is not None and len(self.names) != self.dim:
            raise FamilyError(f"names must label all {self.dim} coordinates, not {len(self.names)}")

    def checked(self, x: ArrayLike) -> Array:
        """x as finite float64 of shape (n, dim), or FamilyError."""
        array = np.asarray(x, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != self.dim:
            raise FamilyError(f"x must have shape (n, {self.dim}), not {array.shape}")
        if not np.all(np.isfinite(array)):
            raise FamilyError("x must be finite")
        return array

    # -- natural exponential family -------------------------------------------------------------------------

    def statistics(self, x: ArrayLike) -> Array:
        """Gamma(x), (n, s), of x (n, d).

        In this order: log u of each Beta, log(1 - u) of each Beta, each Normal's x, each other marginal's value in
        standard-normal space.
        """
        x = self.checked(x)
        parts = [*self.betas.statistics(x[:, self.beta_columns])]
        parts += [x[:, s : s + b.dim] for s, b in self.normals]
        parts += [b.to_standard(x[:, s : s + 1]) for s, b in self.marginals]
        return np.concatenate(parts, axis=1)

    def natural(self) -> Array:
        """theta, (s,), in the order of `statistics`: alphas, betas, then Sigma^{-1} mu of each Normal, then shifts."""
        return np.concatenate(
            [self.betas.alpha, self.betas.beta, *(b.precision_mean for _, b in self.normals), self.shifts]
        )

    @property
    def shifts(self) -> Array:
        """Of the marginals in standard-normal space, (k,)."""
        return np.array([b.shift for _, b in self.marginals])

    def log_partition(self) -> float:
        """A(theta), nats (covariances fixed)."""
        normals = sum(b.log_partition() for _, b in self.normals)
        return float(np.sum(self.betas.log_partition())) + normals + 0.5 * float(np.sum(self.shifts**2))

    def mean_statistics(self) -> Array:
        """Gradient of A = E_theta[Gamma(X)], (s,)."""
        means = (b.mean for _, b in self.normals)
        return np.concatenate([*self.betas.mean_statistics(), *means, self.shifts])

    # -- densities ------------------------------------------------------------------------------------------

    def log_density(self, x: ArrayLike) -> Array:
        """log p_theta(x) with respect to Lebesgue measure, (n,)."""
        x = self.checked(x)
        total = self.betas.log_density(x[:, self.beta_columns])
        for start, block in self.normals:
            total = total + block.log_density(x[:, start : start + block.dim])
        for column, marginal in self.marginals:
            total = total + marginal.log_density(x[:, column])
        return total

    def log_ratio(self, other: "Product", x: ArrayLike) -> Array:
        """log p_self(x) - log p_other(x), (n,): joint over all blocks, computed without the parts that cancel."""
        x = self.checked(x)
        log_u, log_v = self.betas.statistics(x[:, self.beta_columns])
        mine, theirs = self.betas, other.betas
        terms = (mine.alpha - theirs.alpha) * log_u + (mine.beta - theirs.beta) * log_v
        total: Array = (terms - (mine.log_partition() - theirs.log_partition())).sum(axis=1)
        for (start, block), (_, other_block) in zip(self.normals, other.normals, strict=True):
            total = total + block.log_ratio(other_block, x[:, start : start + block.dim])
        for (column, marginal), shift in zip(self.marginals, other.shifts, strict=True):
            if marginal.shift != shift:
                middle = 0.5 * (marginal.shift + shift)
                total = total + (marginal.shift - shift) * (marginal.to_standard(x[:, column]) - middle)
        return total

    def kl(self, other: "Product") -> float:
        """KL(self || other), nats."""
        normals = zip(self.normals, other.normals, strict=True)
        blocks = self.betas.kl(other.betas) + sum(mine.kl(theirs) for (_, mine), (_, theirs) in normals)
        return blocks + 0.5 * float(np.sum((self.shifts - other.shifts) ** 2))

    # -- parameters as a vector ------------------------------------------------------------------------------

    def parameters(self, covariances: bool = False) -> Array:
        """Alphas, betas, each Normal's mean and each other marginal's shift as a flat vector (s,).

        If `covariances`, the Normals' covariances follow row by row. This is what is stored and sent: together with the
        base it gives the proposal back to the bit.
        """
        parts = [self.betas.alpha, self.betas.beta, *(b.mean for _, b in self.normals), self.shifts]
        if covariances:
            parts += [b.cov.ravel() for _, b in self.normals]
        return np.concatenate(parts)

    def with_parameters(self, parameters: ArrayLike) -> "Product":
        """The member of this product's family with those parameters; intervals and names are kept.

        Covariances are this product's own unless the vector carries them.
        """
        vector = np.asarray(parameters, dtype=np.float64)
        m = self.beta_columns.size
        short = 2 * m + sum(b.dim for _, b in self.normals) + len(self.marginals)
        full = short + sum(b.dim**2 for _, b in self.normals)
        if vector.shape not in ((short,), (full,)):
            raise FamilyError(f"parameters must have shape ({short},) or ({full},), not {vector.shape}")
        betas = iter(zip(vector[:m], vector[m : 2 * m], strict=True))
        at, cov_at = 2 * m, short
        shifts = iter(vector[short - len(self.marginals) : short])
        blocks: list[Block] = []
        for block in self.blocks:
            if isinstance(block, Beta):
                alpha, beta = next(betas)
                blocks.append(Beta(float(alpha), float(beta), block.low, block.high))
                continue
            if isinstance(block, Marginal):
                blocks.append(block.shifted(float(next(shifts))))
                continue
            mean = vector[at : at + block.dim]
            at += block.dim
            if vector.size == short:
                blocks.append(block.with_mean(mean))
            else:
                cov = vector[cov_at : cov_at + block.dim**2].reshape(block.dim, block.dim)
                cov_at += block.dim**2
                blocks.append(block.with_mean(mean) if np.array_equal(cov, block.cov) else Normal(mean, cov))
        return Product(blocks, self.names)

    # -- for plots -------------------------------------------------------------------------------------------

    def marginal_pdf(self, i: int, grid: ArrayLike) -> Array:
        """Density of coordinate i (0 <= i < dim) on a grid, per unit of x."""
        block, j = self._locate(i)
        grid = np.asarray(grid, dtype=np.float64)
        if isinstance(block, Beta):
            width = block.high - block.low
            u = np.clip((grid - block.low) / width, 0.0, 1.0)
            log_pdf = (
                xlogy(block.alpha - 1, u) + xlog1py(block.beta - 1, -u) - betaln(block.alpha, block.beta)
            )
            inside = (grid >= block.low) & (grid <= block.high)
            return np.where(inside, np.exp(log_pdf) / width, 0.0)
        if isinstance(block, Marginal):
            low, high = (float(block.from_standard(np.array(u))) for u in (-8.0, 8.0))
            inside = (grid > low) & (grid < high)
            density = np.exp(block.log_density(np.clip(grid, low, high)))
            return np.where(inside, density, 0.0)
        deviation = np.sqrt(block.cov[j, j])
        pdf: Array = np.exp(-0.5 * ((grid - block.mean[j]) / deviation) ** 2) / (
            deviation * np.sqrt(2 * np.pi)
        )
        return pdf

    def marginal_range(self, i: int) -> tuple[float, float]:
        """Where coordinate i is worth plotting: the interval of a Beta, mean +- 4 deviations of a Normal."""
        block, j = self._locate(i)
        if isinstance(block, Beta):
            return block.low, block.high
        if isinstance(block, Marginal):
            return float(block.from_standard(np.array(-3.0))), float(block.from_standard(np.array(3.0)))
        half = 4.0 * float(np.sqrt(block.cov[j, j]))
        return float(block.mean[j]) - half, float(block.mean[j]) + half

    def _locate(self, i: int) -> tuple[Block, int]:
        if not 0 <= i < self.dim:
            raise FamilyError(f"coordinate must be from 0 to {self.dim - 1}, not {i}")
        which = int(np.searchsorted(self.starts, i, side="right")) - 1
        return self.blocks[which], i - self.starts[which]

    @functools.cached_property
    def name_or_index(self) -> tuple[str, ...]:
        """`names`, or x0, x1, ... where none were given."""
        return self.names or tuple(f"x{i}" for i in range(self.dim))
