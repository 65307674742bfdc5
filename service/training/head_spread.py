"""Sigma0 by three estimators, compared by the likelihood of left-out members; see service.training.graphical_lasso.

weights   graphical lasso on the members' weights, each divided by its standard deviation.
whitened  the same in coordinates in which the covariance that resampling is expected to give
          (service.training.ensemble.sampling_covariances) is the identity. Weights whose effects cancel keep doing so.
factors   that expected covariance with the members' own shrunk towards it (service.training.ensemble).

All three end in the same place: mean, covariance (404, 404), positive definite by a floor of FLOOR_SD^2 in the weights'
own units.
"""

from dataclasses import dataclass

import numpy as np

from policies import layout as O
from service.training.ensemble import FLOOR_SD, HeadDistribution, head_distribution
from service.training.graphical_lasso import cross_validated, graphical_lasso

PENALTIES = (0.3, 0.45, 0.6, 0.8)


@dataclass(frozen=True)
class Spread:
    """One estimate: its distribution, scores (mean left-out log likelihood in the weights' coordinates, without
    d log(2 pi) / 2) by penalty or shrinkage, the best of them, and what the solver reported."""

    distribution: HeadDistribution
    scores: dict[float, float]
    report: dict


def spreads(members: np.ndarray, shapes: list[np.ndarray]) -> dict[str, Spread]:
    """The three estimates for members (m, 404).

    shapes: 4 blocks (101, 101) of `sampling_covariances`
    """
    sd = members.std(axis=0, ddof=1)
    floor = np.sqrt(np.diag(sd**2 + FLOOR_SD**2))
    root = np.linalg.cholesky(expected_covariance(members, shapes))
    factors, scores = head_distribution(members, shapes)
    log_det = np.log(np.diag(root)).sum()
    return {
        "weights": lasso_spread(members, floor),
        "whitened": lasso_spread(members, root),
        "factors": Spread(factors, {a: s - log_det for a, s in scores.items()}, {}),
    }


def expected_covariance(members: np.ndarray, shapes: list[np.ndarray]) -> np.ndarray:
    """The covariance that resampling is expected to give, scaled to the members' variance output by output."""
    d = members.shape[1]
    target = np.zeros((d, d))
    variance = members.var(axis=0, ddof=1)
    for output, shape in enumerate(shapes):
        own = slice(output, d, O.OUTPUTS)
        target[own, own] = shape * (variance[own].sum() / np.trace(shape))
    target[np.diag_indices(d)] += FLOOR_SD**2
    return target


def lasso_spread(members: np.ndarray, root: np.ndarray) -> Spread:
    """The graphical lasso of members (m, d) in coordinates root^-1 (members - mean), scaled to variance 1."""
    mean = members.mean(axis=0)
    z = np.linalg.solve(root, (members - mean).T).T
    inverse = np.linalg.inv(root)
    least = FLOOR_SD**2 * inverse @ inverse.T  # weights of units that are off everywhere do not vary at all
    scale = np.sqrt(z.var(axis=0, ddof=1) + np.diag(least))
    z, root, least = z / scale, root * scale, least / np.outer(scale, scale)
    log_det = np.linalg.slogdet(root)[1]
    scores = {p: s - log_det for p, s in cross_validated(z, PENALTIES, least).items()}
    best = max(scores, key=lambda p: scores[p])
    found = graphical_lasso(z.T @ z / (len(z) - 1) + least, best)
    covariance = root @ found.covariance @ root.T
    covariance = 0.5 * (covariance + covariance.T)
    nonzero = float((np.abs(found.precision) > 0.0).mean())
    report = {
        "iterations": found.iterations,
        "converged": found.converged,
        "nonzero_share": round(nonzero, 4),
    }
    return Spread(HeadDistribution(mean, covariance, best, FLOOR_SD), scores, report)
