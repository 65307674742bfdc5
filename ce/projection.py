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
from ce.product import Product

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Projection:
    """Theta around a base: Beta parameters within beta_bounds (widened per parameter to hold the base's
    own), Normal means within mean_box of the base's (None: free), shifts of other
    marginals free, Normal covariances the base's unless
    learn_covariance."""

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
        """Parameters of P_theta_{k+1} (see Product.parameters) from the elite rows x (n, d), their
        normalised weights (n,), the current proposal and the step alpha in (0, 1]."""
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
    return np.sum(weights[:, None] * values, axis=0)


def _covariance(block, x: Array, weights: Array, step: float, mean: Array) -> Array:
    """Covariance of the mixture step Q + (1 - step) P_theta: second moments about its mean."""
    deviation = x - mean
    shift = block.mean - mean
    spread = (weights[:, None] * deviation).T @ deviation
    cov = step * spread + (1.0 - step) * (block.cov + np.outer(shift, shift))
    return 0.5 * (cov + cov.T)
