"""The last layer trained again on resampled trajectories, and the Normal distribution of its weights.

Every member starts from the common head and minimises, on its own resample of whole trajectories,

    mean negative log likelihood + ridge / 2 |head - common head|^2,

by Fisher scoring: for a Gaussian whose mean and log standard deviation are linear in the features h, the expected
information is sum h h^T / std^2 for the mean's weights and 2 sum h h^T for those of the log standard deviation. The
ridge only decides directions that the data leave open: there, members stay at the common head.
"""

from dataclasses import dataclass

import numpy as np

from policies import layout as O

LOG_STD_RANGE = (-2.3, 0.5)


def refit_head(
    features: np.ndarray,
    action: np.ndarray,
    weight: np.ndarray,
    common: np.ndarray,
    ridge: float,
    rounds: int = 6,
) -> np.ndarray:
    """Head (404,) for features (n, 100), scaled actions (n, 2) and row weights (n,), from `common` (404,)."""
    h = np.column_stack([features, np.ones(len(features))]).astype(np.float32)
    weight = (weight / weight.sum()).astype(np.float32)
    start = common.reshape(-1, O.OUTPUTS).astype(np.float64)
    head = start.copy()
    plain = (h * weight[:, None]).T @ h
    eye = np.eye(h.shape[1])
    for _ in range(rounds):
        outputs = h @ head.astype(np.float32)
        for action_index in range(2):
            log_std = np.clip(outputs[:, 2 + action_index], *LOG_STD_RANGE)
            precision = (weight * np.exp(-2.0 * log_std)).astype(np.float32)
            error = (action[:, action_index] - outputs[:, action_index]).astype(np.float32)
            gradient = h.T @ (precision * error) - ridge * (head - start)[:, action_index]
            information = (h * precision[:, None]).T @ h + ridge * eye
            head[:, action_index] += np.linalg.solve(information, gradient)
            surprise = weight * (error**2 * np.exp(-2.0 * log_std) - 1.0)
            gradient = (
                h.T @ np.clip(surprise, None, 50.0 * weight) - ridge * (head - start)[:, 2 + action_index]
            )
            head[:, 2 + action_index] += np.linalg.solve(2.0 * plain + ridge * eye, gradient)
    return head.reshape(-1)


def sampling_covariances(
    features: np.ndarray, weight: np.ndarray, common: np.ndarray, ridge: float
) -> list[np.ndarray]:
    """Shape (4 blocks of (101, 101)) of the covariance that resampling gives the head, up to a factor.

    A penalised estimate varies as (F + r I)^-1 F (F + r I)^-1 when the gradient's covariance is proportional to the
    information F: directions that the data fix well vary little, those left to the ridge r not at all.
    """
    h = np.column_stack([features, np.ones(len(features))])
    weight = weight / weight.sum()
    outputs = h @ common.reshape(-1, O.OUTPUTS)
    blocks = []
    for output in range(O.OUTPUTS):
        if output < 2:
            information = (
                h * (weight * np.exp(-2.0 * np.clip(outputs[:, 2 + output], *LOG_STD_RANGE)))[:, None]
            ).T @ h
        else:
            information = 2.0 * (h * weight[:, None]).T @ h
        values, vectors = np.linalg.eigh(information)
        values = np.maximum(values, 0.0)
        blocks.append((vectors * (values / (values + ridge) ** 2)) @ vectors.T)
    return blocks


@dataclass(frozen=True)
class HeadDistribution:
    """N(mean (404,), covariance (404, 404)).

    shrinkage: the share of the target in the covariance
    """

    mean: np.ndarray
    covariance: np.ndarray
    shrinkage: float
    floor_sd: float


SHRINKAGES = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
FLOOR_SD = 0.002  # weights that the data leave alone still vary a little: Sigma0 has to be invertible


def head_distribution(
    members: np.ndarray, shapes: list[np.ndarray]
) -> tuple[HeadDistribution, dict[float, float]]:
    """Mean and covariance of `members` (m, 404), and the cross-validated log likelihood of each shrinkage tried.

    With m < 404 the sample covariance is singular and has to be shrunk towards a target. A diagonal target (what
    a graphical lasso with a strong penalty comes to) would destroy the correlations between weights whose effects
    cancel: drivers drawn from it would differ several times more than the members do. The target here keeps them:
    `shapes` of `sampling_covariances`, each scaled to the members' total variance, plus FLOOR_SD^2. In coordinates in
    which the target is the identity, Sigma = (1 - a) R + a I with a by leave-one-out likelihood.
    """
    m, d = members.shape
    mean = members.mean(axis=0)
    variance = members.var(axis=0, ddof=1)
    target = np.zeros((d, d))
    for output, shape in enumerate(shapes):
        own = slice(output, d, O.OUTPUTS)
        target[own, own] = shape * (variance[own].sum() / np.trace(shape))
    target[np.diag_indices(d)] += FLOOR_SD**2
    root = np.linalg.cholesky(target)
    z = np.linalg.solve(root, (members - mean).T).T
    scores = {a: _left_out(z, a) for a in SHRINKAGES}
    best = max(scores, key=lambda a: scores[a])
    inner = (1.0 - best) * (z.T @ z) / (m - 1) + best * np.eye(d)
    covariance = root @ inner @ root.T
    return HeadDistribution(mean, 0.5 * (covariance + covariance.T), best, FLOOR_SD), scores


def _left_out(z: np.ndarray, a: float) -> float:
    """Mean log likelihood of each left-out row of z (m, d) under (1 - a) R + a I of the others."""
    m, d = z.shape
    total = 0.0
    for i in range(m):
        rest = np.delete(z, i, axis=0)
        centre = rest.mean(axis=0)
        low = (rest - centre) * np.sqrt((1.0 - a) / (m - 2))  # (m - 1, d); covariance = a I + low^T low
        x = z[i] - centre
        small = np.eye(m - 1) + low @ low.T / a
        solved = np.linalg.solve(small, low @ x)
        quadratic = (x @ x - (low @ x) @ solved / a) / a
        total += -0.5 * (quadratic + d * np.log(a) + np.linalg.slogdet(small)[1])
    return total / m


def describe(found: HeadDistribution) -> dict:
    """Scale and conditioning of the covariance, for the card."""
    eigenvalues = np.linalg.eigvalsh(found.covariance)
    sd = np.quantile(np.sqrt(np.diag(found.covariance)), [0.05, 0.25, 0.5, 0.75, 0.95])
    return {
        "shrinkage": found.shrinkage,
        "weight_sd_quantiles_5_25_50_75_95": [round(float(q), 5) for q in sd],
        "eigenvalue_min": float(eigenvalues[0]),
        "eigenvalue_max": float(eigenvalues[-1]),
        "condition_number": float(eigenvalues[-1] / eigenvalues[0]),
        "sd_floor": found.floor_sd,
    }
