"""When to stop where a relative half-width was asked for: in two phases, never by watching.

Stopping at the first moment when the interval looks narrow enough favours runs whose variance happens to be
underestimated. Here the first rollouts of the fresh sample are a trial: from its variance the number n of rollouts
that the target needs is computed, with a margin (Stein, Annals of Mathematical Statistics 16, 1945). Then n fresh
rollouts are made and the trial is left out, so that given the trial n is fixed and the interval is one at a fixed
number of rollouts, as honest as without a target. Where the target is missed all the same, more rollouts are planned;
each look has a share of the error of its own, alpha spending (Lan and DeMets, Biometrika 70, 1983), so that the
intervals at all looks hold together by the union bound.
"""

import math
from dataclasses import dataclass

from scipy.special import ndtri

from ce.results import FEW_EVENTS, Estimate

MARGIN, DOUBT = (
    1.1,
    1.3,
)  # planned rollouts are multiplied by MARGIN + DOUBT / sqrt(effective events of the trial)
LEAST_TRIAL = 500
TRIAL_SHARE = 0.05  # of what the fresh sample may have
SPENDING = (
    0.75,
    0.2,
    0.03,
    0.01,
    0.01,
)  # shares of 1 - confidence that the looks have, the last one again and again


@dataclass(frozen=True)
class Plan:
    """look_at: rollouts of the fresh sample, trial included, at which to look next; trial: how many of them are
    left out; looks: made so far at what counts."""

    look_at: int
    trial: int
    looks: int
    done: bool


def first_look(rel_error: float | None, limit: int, batch_size: int) -> int:
    """Rollouts of the fresh sample at which to look first: all without a target, otherwise the trial's."""
    if rel_error is None:
        return limit
    return min(batch_size, max(int(TRIAL_SHARE * limit), LEAST_TRIAL), limit)


def counted(n: int, look_at: int, trial: int) -> int:
    """How many rollouts at the beginning are left out of the estimate after n: the trial, once what follows it is
    complete; before that all of them count, for the unfinished estimate."""
    return trial if n >= look_at and n > trial else 0


def spending(looks: int, done: bool) -> float:
    """Share of 1 - confidence of the look that an estimate is shown at, `looks` having been made, this one among them
    if done."""
    return SPENDING[min(looks - (1 if done else 0), len(SPENDING) - 1)]


def next_look(est: Estimate, n: int, limit: int, trial: int, looks: int) -> Plan:
    """The plan after a look at n rollouts (trial included) of at most `limit`; est: of those that count."""
    made = looks + (1 if trial else 0)
    if est.rel_error is None or n >= limit or (trial and est.converged):
        return Plan(n, trial, made, True)
    if est.ess < FEW_EVENTS:
        if not trial:
            return Plan(min(limit, 2 * n), 0, 0, False)  # a longer trial
        needed = 2 * est.f.size
    else:
        share = est.sampling_share * spending(made, False)
        z = float(ndtri(1.0 - 0.5 * (1.0 - est.confidence) * share))
        margin = MARGIN + DOUBT / math.sqrt(est.ess)
        needed = math.ceil(margin * est.f.size * (z * est.std_error / est.p / est.rel_error) ** 2)
        needed = max(needed, math.ceil(1.5 * FEW_EVENTS * est.f.size / est.ess))
    if not trial:
        return Plan(min(limit, n + needed), n, 0, False)
    return Plan(min(limit, max(trial + needed, n + 1)), trial, made, False)
