"""What part of p a failure mode has, and its own p, with intervals."""

from dataclasses import replace

import numpy as np
from scipy.special import betaincinv

import ce


def share_interval(
    member: np.ndarray, weight: np.ndarray, confidence: float, worth: float | None = None
) -> tuple[float, float, float]:
    """Share of the members (n, bool) in the weighted events, with its interval: (share, low, high).

    The share is the ratio estimator sum w 1{member} / sum w. Its interval is Korn and Graubard's (Survey Methodology
    24, 1998): Clopper and Pearson's with the effective number of events, share (1 - share) / variance with the
    linearised variance of the ratio, and never more than Kish's number; exact for equal weights. worth: at most so many
    independent events, where they are worth fewer than their weights say.
    """
    if not weight.size:
        return 0.0, 0.0, 1.0
    w = weight / weight.sum()
    share = float(np.clip(w[member].sum(), 0.0, 1.0))
    variance = float(np.sum((w * (member - share)) ** 2))
    kish = 1.0 / float(np.sum(w**2))
    inside = variance > 0.0 and 0.0 < share < 1.0
    n = min(share * (1.0 - share) / variance if inside else kish, kish)
    if worth is not None:
        n = min(n, max(worth, 1.0))
    tail, k = 0.5 * (1.0 - confidence), share * n
    low = float(betaincinv(k, n - k + 1.0, tail)) if k > 0.0 else 0.0
    high = float(betaincinv(k + 1.0, n - k, 1.0 - tail)) if share < 1.0 else 1.0
    return share, low, high


def mode_estimate(estimate: ce.Estimate, rows: np.ndarray, stop: int) -> ce.Estimate:
    """The estimate of a smaller event: {f <= gamma} in one mode, from the first `stop` rollouts.

    rows: of the mode's rollouts, all below `stop`. The first `stop` rollouts are as good a sample as all of them.
    """
    f = np.where(estimate.f[:stop] <= estimate.gamma, np.inf, estimate.f[:stop])
    f[rows] = estimate.f[rows]
    log_weights = None if estimate.log_weights is None else estimate.log_weights[:stop]
    return replace(estimate, f=f, log_weights=log_weights)
