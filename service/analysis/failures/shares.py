"""What part of p a failure mode has, and its own p, with intervals."""

import math
from dataclasses import replace

import numpy as np
from scipy.special import betaincinv, ndtri, stdtrit

import ce


def share_interval(member: np.ndarray, weight: np.ndarray, confidence: float) -> tuple[float, float, float]:
    """Share of the members (n, bool) in the weighted events, with its interval: (share, low, high).

    The share is the ratio estimator sum w 1{member} / sum w. Its interval is Korn and Graubard's (Survey Methodology
    24, 1998): Clopper and Pearson's with the effective number of events, share (1 - share) / variance with the
    linearised variance of the ratio, and never more than Kish's number; exact for equal weights.
    """
    if not weight.size:
        return 0.0, 0.0, 1.0
    w = weight / weight.sum()
    share = float(np.clip(w[member].sum(), 0.0, 1.0))
    variance = float(np.sum((w * (member - share)) ** 2))
    kish = 1.0 / float(np.sum(w**2))
    inside = variance > 0.0 and 0.0 < share < 1.0
    n = min(share * (1.0 - share) / variance if inside else kish, kish)
    return (share, *_korn_graubard(share, n, confidence))


def mean_interval(value: np.ndarray, weight: np.ndarray, confidence: float) -> tuple[float, float, float]:
    """Weighted mean of values (n,) between 0 and 1, with its interval: (mean, low, high).

    Student's, with the linearised variance of the ratio and Kish's effective number of events; from 0 to 1 where that
    is below 2. Where the values are all but equal, so is the interval.
    """
    if not weight.size:
        return 0.0, 0.0, 1.0
    w = weight / weight.sum()
    mean = float(np.clip(np.sum(w * value), 0.0, 1.0))
    n = 1.0 / float(np.sum(w**2))
    if n < 2.0:
        return mean, 0.0, 1.0
    deviation = math.sqrt(float(np.sum((w * (value - mean)) ** 2)) * n / (n - 1.0))
    half = float(stdtrit(n - 1.0, 0.5 + 0.5 * confidence)) * deviation
    return mean, max(mean - half, 0.0), min(mean + half, 1.0)


def replicated_share(
    member: np.ndarray,
    share: np.ndarray,
    replication: np.ndarray,
    replicated: np.ndarray,
    confidence: float,
) -> tuple[float, float, float]:
    """The same where events come from independent replications, within which they depend on each other.

    member, share, replication: of n events, as `Events` has them
    replicated: p of each replication

    The share is the members' part of p summed over replications, over the sum of p; its variance is that of this
    ratio over the replications, with Student's quantile for as many, and not less than with half a replication more
    that has met both evenly: few replications of which none has met much of a rare mode would agree too well. Where
    all replications agree, as when no event or every event is a member, they count as so many independent events.
    """
    if not member.size or replicated.sum() <= 0.0:
        return 0.0, 0.0, 1.0
    parts = replicated_parts(member, share, replication, replicated)
    total, runs = float(replicated.sum()), replicated.size
    found = float(np.clip(parts.sum() / total, 0.0, 1.0))
    if runs < 2:
        return found, 0.0, 1.0
    variance = max(_ratio_variance(parts, replicated), _ratio_variance(*_doubted(parts, replicated)))
    n = total**2 / float(np.sum(replicated**2))  # replications of equal weight
    if variance > 0.0 and 0.0 < found < 1.0:
        student = float(ndtri(0.5 + 0.5 * confidence) / stdtrit(runs - 1, 0.5 + 0.5 * confidence))
        n = min(found * (1.0 - found) / variance * student**2, 1.0 / float(np.sum(share**2)))
    return (found, *_korn_graubard(found, max(n, 1.0), confidence))


def _ratio_variance(parts: np.ndarray, replicated: np.ndarray) -> float:
    """Linearised, of the ratio of their sums over independent replications."""
    runs, total = replicated.size, float(replicated.sum())
    left = parts - float(parts.sum()) / total * replicated
    return float(np.sum(left**2)) * runs / (runs - 1.0) / total**2


def _doubted(parts: np.ndarray, replicated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """With half a replication more, of the mean p, half of which are members'."""
    more = 0.5 * float(replicated.mean())
    return np.append(parts, 0.5 * more), np.append(replicated, more)


def replicated_parts(
    member: np.ndarray, share: np.ndarray, replication: np.ndarray, replicated: np.ndarray
) -> np.ndarray:
    """The members' part of p in each replication, from events that may be a sample of all: a replication of which none
    is in the sample has them as all others together do."""
    runs = replicated.size
    mine = np.bincount(replication[member], share[member], minlength=runs)
    return _parts(mine, float(share[member].sum()), share, replication, replicated)


def replicated_means(
    value: np.ndarray, share: np.ndarray, replication: np.ndarray, replicated: np.ndarray
) -> np.ndarray:
    """The same of values (n,) between 0 and 1 in place of members: their mean times p, in each replication."""
    mine = np.bincount(replication, share * value, minlength=replicated.size)
    return _parts(mine, float(np.sum(share * value)), share, replication, replicated)


def _parts(
    mine: np.ndarray, sum_of_all: float, share: np.ndarray, replication: np.ndarray, replicated: np.ndarray
) -> np.ndarray:
    all_of = np.bincount(replication, share, minlength=replicated.size)
    pooled = float(sum_of_all / share.sum())
    return replicated * np.where(all_of > 0.0, mine / np.where(all_of > 0.0, all_of, 1.0), pooled)


def replicated_p(parts: np.ndarray, confidence: float) -> tuple[float, tuple[float, float]] | None:
    """p of a smaller event from its p in each replication, with the interval of `ce.ReplicatedEstimate`: Student's, on
    the logarithm. None where no replication has it."""
    runs, p = parts.size, float(parts.mean())
    if runs < 2 or p <= 0.0:
        return None
    relative = float(parts.std(ddof=1)) / math.sqrt(runs) / p
    factor = math.exp(min(float(stdtrit(runs - 1, 0.5 + 0.5 * confidence)) * relative, 700.0))
    return p, (p / factor, min(p * factor, 1.0))


def _korn_graubard(share: float, n: float, confidence: float) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share of n effective events."""
    tail, k = 0.5 * (1.0 - confidence), share * n
    low = float(betaincinv(k, n - k + 1.0, tail)) if k > 0.0 else 0.0
    high = float(betaincinv(k + 1.0, n - k, 1.0 - tail)) if share < 1.0 else 1.0
    return low, high


def mean_estimate(estimate: ce.Estimate, rows: np.ndarray, values: np.ndarray, stop: int) -> ce.Estimate:
    """The estimate of the mean of a value between 0 and 1 (a risk given what happened), from the first `stop` rollouts.

    rows: of the rollouts that have a value above 0, all below `stop`
    values: theirs

    An event of probability `value` given the rollout weighs that much less; a failed rollout counts with 1 in the upper
    end.
    """
    part = mode_estimate(estimate, rows, stop)
    log_weights = np.zeros(stop) if part.log_weights is None else part.log_weights.copy()
    log_weights[rows] += np.log(values)
    return replace(part, log_weights=log_weights, base_f=np.zeros(0))


def mode_estimate(estimate: ce.Estimate, rows: np.ndarray, stop: int) -> ce.Estimate:
    """The estimate of a smaller event: {f <= gamma} in one mode, from the first `stop` rollouts.

    rows: of the mode's rollouts, all below `stop`. The first `stop` rollouts are as good a sample as all of them.
    """
    f = np.where(estimate.f[:stop] <= estimate.gamma, np.inf, estimate.f[:stop])
    f[rows] = estimate.f[rows]
    log_weights = None if estimate.log_weights is None else estimate.log_weights[:stop]
    return replace(estimate, f=f, log_weights=log_weights)
