"""IDM with MOBIL lane changes (Treiber et al. 2000; Kesting et al. 2007) as compiled code on the world's agents.

Car following: a (1 - (v/v0)^4 - (s*/s)^2), s* = s0 + max(0, T v + v dv / (2 sqrt(a b))).

Lane changes: a change's incentive is I = a_new - a_old + politeness * (change of the two followers' accelerations),
gains clipped to GAIN_LIMIT_MPS2; it is allowed where the new follower need not brake harder than `safe` and no box is
beside. MOBIL changes lanes as soon as I exceeds a threshold; people do so only at a rate, which is fitted here:

    rate = r / (1 + exp(-(I - threshold) / softness))   a second, threshold larger by `right_bias` to the right      (1)

Lane keeping and changing: a damped oscillator towards the centre of the lane that is wanted.
"""

import math

import numpy as np

from policies.exactmath import exp, sincos
from policies.jit import kernel

PARAMETERS = (
    "desired_speed_mps", "time_headway_s", "standstill_gap_m", "acceleration_mps2", "comfort_mps2", "politeness",
    "threshold_mps2", "softness_mps2", "rate_per_s", "right_bias_mps2", "safe_mps2", "lateral_rate_per_s",
)  # fmt: skip
(V0, HEADWAY, STANDSTILL, ACCEL, COMFORT, POLITE, THRESHOLD, SOFT, RATE, BIAS, SAFE, LATERAL) = range(12)
DAMPING = 0.9
SPEED_FLOOR_MPS = 4.0
GAIN_LIMIT_MPS2 = 2.0  # gains are clipped: IDM's brake at short gaps is no measure of how much a driver minds
ARRIVED_M = 0.5  # this close to the new lane's centre a lane change is over
BESIDE_M = 1.0  # gaps smaller than this in the new lane forbid a change
FREE_M = 1e6


@kernel
def following(p: np.ndarray, speed: float, gap: float, closing: float) -> float:
    """Acceleration (m/s^2) behind a leader `gap` m ahead; FREE_M for none."""
    ratio = speed / p[V0]
    free = 1.0 - (ratio * ratio) * (ratio * ratio)
    wanted = p[STANDSTILL] + max(
        0.0, p[HEADWAY] * speed + speed * closing / (2.0 * math.sqrt(p[ACCEL] * p[COMFORT]))
    )
    share = wanted / max(gap, 0.5)
    return max(p[ACCEL] * (free - share * share), -8.0)


@kernel
def beside(
    station: np.ndarray, lane: np.ndarray, present: np.ndarray, me: int, in_lane: int
) -> tuple[int, int]:
    """The nearest vehicles ahead and behind of `me` in a lane, -1 for none; arrays (n,), stations in m."""
    lead, lag = -1, -1
    for j in range(station.shape[0]):
        if j == me or not present[j] or lane[j] != in_lane:
            continue
        if station[j] >= station[me]:
            if lead < 0 or station[j] < station[lead]:
                lead = j
        elif lag < 0 or station[j] > station[lag]:
            lag = j
    return lead, lag


@kernel
def behind(
    p: np.ndarray, station: np.ndarray, speed: np.ndarray, length: np.ndarray, me: int, lead: int
) -> float:
    """Acceleration of `me` behind `lead` (-1: free road)."""
    if lead < 0:
        return following(p, speed[me], FREE_M, 0.0)
    gap = station[lead] - station[me] - 0.5 * (length[lead] + length[me])
    return following(p, speed[me], gap, speed[me] - speed[lead])


@kernel
def incentive(
    p: np.ndarray, station: np.ndarray, lane: np.ndarray, speed: np.ndarray, length: np.ndarray, present: np.ndarray,
    me: int, to_lane: int,
) -> tuple[float, float, bool]:  # fmt: skip
    """Own gain and the followers' gain (m/s^2) of changing to `to_lane`, and whether that is allowed."""
    lead, lag = beside(station, lane, present, me, lane[me])
    new_lead, new_lag = beside(station, lane, present, me, to_lane)
    allowed = True
    if new_lead >= 0:
        allowed = station[new_lead] - station[me] - 0.5 * (length[new_lead] + length[me]) > BESIDE_M
    own = behind(p, station, speed, length, me, new_lead) - behind(p, station, speed, length, me, lead)
    others = 0.0
    if new_lag >= 0:
        after = behind(p, station, speed, length, new_lag, me)
        allowed = allowed and after > -p[SAFE]
        allowed = allowed and station[me] - station[new_lag] - 0.5 * (length[me] + length[new_lag]) > BESIDE_M
        others += after - behind(p, station, speed, length, new_lag, new_lead)
    if lag >= 0:
        others += behind(p, station, speed, length, lag, lead) - behind(p, station, speed, length, lag, me)
    own = min(max(own, -GAIN_LIMIT_MPS2), GAIN_LIMIT_MPS2)
    return own, min(max(others, -GAIN_LIMIT_MPS2), GAIN_LIMIT_MPS2), allowed


@kernel
def change_rate(p: np.ndarray, own: float, others: float, to_the_right: bool) -> float:
    """Rate (1) of lane changes, 1/s."""
    threshold = p[THRESHOLD] + (p[BIAS] if to_the_right else 0.0)
    z = (own + p[POLITE] * others - threshold) / p[SOFT]
    return p[RATE] / (1.0 + exp(-min(max(z, -40.0), 40.0)))


@kernel
def steering(p: np.ndarray, speed: float, offset: float, heading: float, curvature: float) -> float:
    """Turn rate (rad/s) towards the centre of the lane that is wanted, `offset` m to its left."""
    v = max(speed, SPEED_FLOOR_MPS)
    sine, _ = sincos(heading)
    across = p[LATERAL] * p[LATERAL] * offset + 2.0 * DAMPING * p[LATERAL] * speed * sine
    return speed * curvature - across / v
