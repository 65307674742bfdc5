"""The update of Algorithm 1, line 6: the Kullback-Leibler projection onto the constrained family.

theta_{k+1} = argmax over Theta of alpha theta^T D_{k+1} + (1 - alpha) theta^T grad A(theta_k) - A(theta).
The blocks of a Product separate: Betas are solved in their box, each Normal's mean in its own.
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ce import beta_update
from ce.mean_update import BoxedMean
from ce.normal import Normal
from ce.product import Product

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Projection:
    """The constrained family Theta around a base; shifts of marginals that are neither Beta nor Normal are free.

    base: the distribution P0
    beta_bounds: of alpha and beta of every Beta, widened where the base's own lie outside
    mean_box: largest |mu - mu0| of every Normal, in its own units (None: free)
    learn_covariance: whether Normals' covariances are free, too
    """

    base: Product
    beta_bounds: tuple[float, float]
    mean_box: float | None
    learn_covariance: bool = False

    @functools.cached_property
    def _beta_box(self) -> tuple[Array, Array]:
        own = np.stack([self.base.betas.alpha, self.base.betas.beta])
        return np.minimum(own, self.beta_bounds[0]), np.maximum(own, self.beta_bounds[1])

    @functools.cached_property
    def _boxed_means(self) -> tuple[BoxedMean, ...]:
        if self.mean_box is None:
            return ()
        return tuple(BoxedMean(block, self.mean_box) for _, block in self.base.normals)

    def update(self, current: Product, x: Array, weights: Array, step: float) -> Array:
        """Parameters (s,) of P_theta_{k+1}, as `Product.parameters` has them.

        current: the proposal P_theta_k
        x: (n, d), elite rows
        weights: (n,), of each, summing to one
        step: alpha, in (0, 1]
        """
        m = self.base.beta_columns.size
        sample_mean = _weighted_mean(weights, self.base.statistics(x))  # D_{k+1}, equation (3)
        target = step * sample_mean + (1.0 - step) * current.mean_statistics()
        betas = np.stack([current.betas.alpha, current.betas.beta])
        betas = beta_update.update(betas, target[: 2 * m].reshape(2, m), *self._beta_box)
        parts, covariances = [betas[0], betas[1]], []
        at = 2 * m
        for i, (start, block) in enumerate(current.normals):
            mean = target[at : at + block.dim]
            at += block.dim
            parts.append(self._boxed_means[i].update(mean) if self._boxed_means else mean)
            if self.learn_covariance:
                covariances.append(
                    _covariance(block, x[:, start : start + block.dim], weights, step, mean).ravel()
                )
        return np.concatenate([*parts, target[at:], *covariances])


def _weighted_mean(weights: Array, values: Array) -> Array:
    mean: Array = np.sum(weights[:, None] * values, axis=0)
    return mean


def _covariance(block: Normal, x: Array, weights: Array, step: float, mean: Array) -> Array:
    """Covariance of the mixture step Q + (1 - step) P_theta: second moments about its mean."""
    deviation = x - mean
    shift = block.mean - mean
    spread = (weights[:, None] * deviation).T @ deviation
    cov = step * spread + (1.0 - step) * (block.cov + np.outer(shift, shift))
    symmetric: Array = 0.5 * (cov + cov.T)
    return symmetric
