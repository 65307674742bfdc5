"""When to stop: a planned number of looks at the precision, never a look after every batch.

Stopping at the first moment when the interval looks narrow enough favours runs whose variance happens to be
underestimated. Here the first look comes after one batch; it plans, from the variance so far and with a
margin, how many rollouts the target needs, and the next look comes there. The run stops at a look at which
the target is met with at least FEW_EVENTS effective events. Two or three looks are usual; the interval is
not corrected for them (README, "Stopping").
"""

import math

from ce.results import FEW_EVENTS, Estimate

MARGIN = 1.1  # of the planned number of rollouts, for the variance being estimated


def next_look(est: Estimate, n: int, limit: int, batch_size: int) -> tuple[int, bool]:
    """(rollout count of the next look, done) for an estimate from n rollouts of at most `limit`."""
    if n >= limit:
        return limit, True
    if est.rel_error is None:
        return limit, False
    if est.converged:
        return n, True
    if est.ess < FEW_EVENTS:
        planned = 2 * n
    else:
        planned = math.ceil(MARGIN * n * (est.relative_half_width / est.rel_error) ** 2)
    return min(limit, max(planned, n + batch_size)), False
