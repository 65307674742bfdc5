"""Measures of criticality over a rollout, from its trace."""

import math
from dataclasses import dataclass

import numpy as np

from service.analysis.criticality.pair import (
    brake_threat_number,
    time_to_brake,
    time_to_react,
    worst_time_to_collision,
)
from service.analysis.trace import Trace
from service.world.safety.boxes import time_until_touch

TAU_S = 1.5  # a time to collision below it counts as a conflict in traffic-conflict studies
NEAR_S = 4.0  # states with a longer time to collision are not looked at for TTB and TTR


@dataclass(frozen=True)
class OverTime:
    """The extremes over the states before a contact, and the times exposed.

    ttc_s, wttc_s, ttb_s, ttr_s: smallest; ttb_s and ttr_s are of the states in which it was not too late
    brake_late_s, react_late_s: first moment at which it was too late; infinite: never
    btn: largest
    tet_s, tit_s2: time below tau, and the integral of tau - time to collision over it (Minderhoud and Bovy 2001)
    """

    ttc_s: float
    wttc_s: float
    ttb_s: float
    ttr_s: float
    brake_late_s: float
    react_late_s: float
    btn: float
    tet_s: float
    tit_s2: float


def exposed(ttc_s: np.ndarray, step_s: float, tau_s: float = TAU_S) -> tuple[float, float]:
    """TET (s) and TIT (s^2) of times to collision (n,), a state each.

    >>> exposed(np.array([3.0, 1.0, 0.5, 2.0]), 0.1)
    (0.2, 0.15)
    """
    below = ttc_s[ttc_s <= tau_s]
    return round(below.size * step_s, 9), round(float(np.sum(tau_s - below)) * step_s, 9)


def over_time(trace: Trace, other: int, tau_s: float = TAU_S) -> OverTime:
    """The measures between the ego and the vehicle in row `other`; states in which the boxes overlap are left out."""
    pairs = np.ascontiguousarray(trace.agents[:, [trace.ego, other]])
    touch = np.array([time_until_touch(a, b) for a, b in pairs])
    apart = touch > 0.0
    step_s = float(trace.time_s[1] - trace.time_s[0]) if len(trace.time_s) > 1 else 0.0
    near = apart & (touch <= NEAR_S)
    brake = [(float(trace.time_s[k]), time_to_brake(*pairs[k])) for k in np.flatnonzero(near).tolist()]
    react = [(float(trace.time_s[k]), time_to_react(*pairs[k])) for k in np.flatnonzero(near).tolist()]
    tet_s, tit_s2 = exposed(touch[apart], step_s, tau_s)
    return OverTime(
        ttc_s=float(touch[apart].min(initial=math.inf)),
        wttc_s=min((worst_time_to_collision(a, b) for a, b in pairs[apart]), default=math.inf),
        ttb_s=_smallest(brake),
        ttr_s=_smallest(react),
        brake_late_s=_late(brake),
        react_late_s=_late(react),
        btn=max((brake_threat_number(a, b) for a, b in pairs[apart]), default=0.0),
        tet_s=tet_s,
        tit_s2=tit_s2,
    )


def _smallest(waits: list[tuple[float, float]]) -> float:
    return min((wait for _, wait in waits if wait > -math.inf), default=math.inf)


def _late(waits: list[tuple[float, float]]) -> float:
    return min((time for time, wait in waits if wait == -math.inf), default=math.inf)
