"""When to stop where a relative half-width was asked for: in two phases, never by watching.

Stopping at the first moment when the interval looks narrow enough favours runs whose variance happens to be
underestimated. Here the first rollouts of the fresh sample are a trial: from its variance the number n of rollouts
that the target needs is computed, with a margin (Stein, Annals of Mathematical Statistics 16, 1945). Then n fresh
rollouts are made and the trial is left out, so that given the trial n is fixed and the interval is one at a fixed
number of rollouts, as honest as without a target. Where the target is missed all the same, more rollouts are planned;
each interim look has a share of the error of its own, alpha spending (Lan and DeMets, Biometrika 70, 1983), so that
the intervals at all looks hold together by the union bound.
"""

import math
from dataclasses import dataclass

from scipy.special import ndtri

from ce.estimate_warnings import FEW_EVENTS
from ce.results import Estimate

# Planned rollouts are multiplied by MARGIN + MARGIN_OF_TRIAL / sqrt(effective events of the trial).
MARGIN, MARGIN_OF_TRIAL = 1.1, 1.3
LEAST_TRIAL = 500
# Of what the fresh sample may have.
TRIAL_SHARE = 0.05
# Shares of 1 - confidence that the interim looks have, the last one again and again.
SPENDING = (0.75, 0.2, 0.03, 0.01, 0.01)


@dataclass(frozen=True)
class Plan:
    """What is to be done after an interim look.

    interim_at: rollouts of the fresh sample, trial included, at the next interim look
    trial: how many of them are left out of the estimate
    interim_looks: made so far at the rollouts that count
    done: whether the run is over
    """

    interim_at: int
    trial: int
    interim_looks: int
    done: bool


def first_interim(rel_error: float | None, limit: int, batch_size: int) -> int:
    """Rollouts of the fresh sample at the first interim look: all without a target, otherwise the trial's."""
    if rel_error is None:
        return limit
    return min(batch_size, max(int(TRIAL_SHARE * limit), LEAST_TRIAL), limit)


def left_out(n: int, interim_at: int, trial: int) -> int:
    """How many rollouts at the beginning are left out of the estimate after n.

    It is the trial, once what follows is complete; before that all of them count, for the unfinished estimate.
    """
    return trial if n >= interim_at and n > trial else 0


def spending(interim_looks: int, done: bool) -> float:
    """Share of 1 - confidence of the interim look that an estimate is shown at.

    interim_looks: made so far, this one among them if done
    done: whether the run is over
    """
    return SPENDING[min(interim_looks - (1 if done else 0), len(SPENDING) - 1)]


def next_interim(est: Estimate, n: int, limit: int, trial: int, interim_looks: int) -> Plan:
    """The plan after an interim look.

    est: of the rollouts that count
    n: rollouts so far, trial included
    limit: rollouts at most
    trial: of the last plan
    interim_looks: of the last plan
    """
    made = interim_looks + (1 if trial else 0)
    if est.rel_error is None or n >= limit or (trial and est.converged):
        return Plan(n, trial, made, True)
    if est.ess < FEW_EVENTS:
        if not trial:
            return Plan(min(limit, 2 * n), 0, 0, False)  # a longer trial
        needed = 2 * est.f.size
    else:
        share = est.sampling_share * spending(made, False)
        z = float(ndtri(1.0 - 0.5 * (1.0 - est.confidence) * share))
        margin = MARGIN + MARGIN_OF_TRIAL / math.sqrt(est.ess)
        needed = math.ceil(margin * est.f.size * (z * est.std_error / est.p / est.rel_error) ** 2)
        needed = max(needed, math.ceil(1.5 * FEW_EVENTS * est.f.size / est.ess))
    if not trial:
        return Plan(min(limit, n + needed), n, 0, False)
    return Plan(min(limit, max(trial + needed, n + 1)), trial, made, False)
