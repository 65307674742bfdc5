"""When a conflict begins: the moment from which a reference driver is at the wheel."""

import math

import msgspec
import numpy as np

from service.analysis.trace import Trace
from service.world.safety.boxes import time_until_touch

TTC_S = 4.0  # what human drivers of `service.world.sim.human` take for a conflict ahead, too (decision 102)
BRIDGED_S = 1.0  # a stretch of conflict goes on over gaps of up to this


class Onset(msgspec.Struct, frozen=True, kw_only=True):
    """The beginning of the conflict that led to the smallest value of the measure.

    step, time_s: of the state in which it begins
    before_s: from there to the moment of the smallest value
    ttc_s: time to collision of the boxes there; None where nobody closed in
    other: row of the vehicle; None for background traffic
    """

    step: int
    time_s: float
    before_s: float
    ttc_s: float | None
    other: int | None


def onset_of(trace: Trace, other: int | None, ttc_s: float = TTC_S) -> Onset:
    """The first state of the last stretch, up to the moment of the smallest value, in which the boxes of the ego and of
    vehicle `other` would touch within `ttc_s` if both kept velocity and heading.

    Gaps of up to BRIDGED_S do not end a stretch: velocities are noisy. Where there is no such state the conflict begins
    one state before the moment. An infinite `ttc_s` means the start of the rollout.

    other: None for background traffic, which the trace does not hold: the ego's time to collision by rays stands in
    """
    worst = int(np.argmin(np.where(np.isnan(trace.measured), np.inf, trace.measured)))
    times = trace.ttc_s[: worst + 1] if other is None else _times(trace, other, worst)
    if math.isinf(ttc_s):
        first = 0
    else:
        first = _first(times, trace.time_s, ttc_s, worst)
    value = float(times[first])
    return Onset(
        step=first,
        time_s=float(trace.time_s[first]),
        before_s=float(trace.time_s[worst] - trace.time_s[first]),
        ttc_s=value if math.isfinite(value) else None,
        other=other,
    )


def _times(trace: Trace, other: int, worst: int) -> np.ndarray:
    pair = np.ascontiguousarray(trace.agents[: worst + 1, [trace.ego, other]])
    return np.array([time_until_touch(state[0], state[1]) for state in pair])


def _first(times: np.ndarray, time_s: np.ndarray, ttc_s: float, worst: int) -> int:
    first = None
    last_seen = float(time_s[worst])
    for k in range(worst, -1, -1):
        if times[k] <= ttc_s:
            first, last_seen = k, float(time_s[k])
        elif last_seen - float(time_s[k]) > BRIDGED_S + 1e-9:
            break
    return max(worst - 1, 0) if first is None else first
