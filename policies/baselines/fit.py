"""IDM+MOBIL fitted to recordings: car following by trajectory error, lane changes by maximum likelihood.

Car following (v0, T, s0, a, b): a follower simulated behind its recorded leader over whole events, least mean square of
log(simulated gap / recorded gap), by Nelder-Mead from several starts on bounded logarithms.

Lane changes: once a second each training vehicle of a main lane either starts to change to a side or does not; the
likelihood of that under rate (1) of idm_mobil.py is maximised over politeness, threshold, softness, rate and the
bias to the right (L-BFGS-B). A change starts LEAD_S before the centre crosses the boundary.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from policies.baselines.idm_mobil import PARAMETERS, RATE, incentive
from policies.data.scenes import DataError, Scene
from policies.jit import kernel
from policies.realism.lane_changes import crossings

DT_S = 0.1
LEAD_S = 2.5  # from the decision to the crossing: a third of a recorded lane change
DECIDE_EVERY_S = 1.0
SAFE_MPS2 = 4.0
LATERAL_RATE_PER_S = 0.6  # of the recorded lane keeping (service/training/expert.py)
BOUNDS = {
    "desired_speed_mps": (10.0, 40.0),
    "time_headway_s": (0.3, 3.0),
    "standstill_gap_m": (0.5, 6.0),
    "acceleration_mps2": (0.2, 4.0),
    "comfort_mps2": (0.5, 8.0),
}
STARTS = ((24.0, 1.2, 2.0, 1.0, 2.0), (20.0, 0.9, 3.0, 0.7, 1.5))


@dataclass(frozen=True)
class Fit:
    """What IDM and MOBIL fitted to recordings come to.

    values: PARAMETERS in SI units
    following_error: root mean square of log(gap ratio), and how many events
    decisions, changes: rows of the likelihood
    log_likelihood: of them, and of a constant rate
    """

    values: np.ndarray
    following_error: float
    events: int
    decisions: int
    changes: int
    log_likelihood: float
    log_likelihood_constant: float

    def as_dict(self) -> dict:
        return {
            "parameters": {n: round(float(v), 4) for n, v in zip(PARAMETERS, self.values, strict=True)},
            "following_rms_log_gap": round(self.following_error, 4),
            "following_events": self.events,
            "lane_change_decisions": self.decisions,
            "lane_changes": self.changes,
            "lane_change_log_likelihood": round(self.log_likelihood, 2),
            "lane_change_log_likelihood_of_a_constant_rate": round(self.log_likelihood_constant, 2),
        }


def fit(following: np.ndarray, scenes: list[Scene], evaluations: int = 400) -> Fit:
    """Fit to car-following events (events, steps, 3: gap, own speed, leader's speed) and the scenes' training
    vehicles. Raises DataError where there is nothing to fit to."""
    if not len(following):
        raise DataError("a car-following model needs car-following events; the recordings have none")
    idm, error = fit_following(following, evaluations)
    lane, decisions, changes, best, constant = fit_lane_changes(idm, scenes)
    values = np.concatenate([idm, lane, [SAFE_MPS2, LATERAL_RATE_PER_S]])
    return Fit(values, error, len(following), decisions, changes, best, constant)


def fit_following(following: np.ndarray, evaluations: int = 400) -> tuple[np.ndarray, float]:
    """v0, T, s0, a, b, and the root mean square of log(simulated / recorded gap)."""
    low, high = np.log(np.array(list(BOUNDS.values())).T)

    def loss(logs: np.ndarray) -> float:
        inside = np.clip(logs, low, high)
        return spacing_error(np.exp(inside), following) + float(np.sum((logs - inside) ** 2))

    found = [
        minimize(loss, np.log(start), method="Nelder-Mead", options={"maxfev": evaluations, "xatol": 1e-3})
        for start in STARTS
    ]
    best = min(found, key=lambda f: f.fun)
    return np.exp(np.clip(best.x, low, high)), float(np.sqrt(best.fun))


@kernel
def spacing_error(idm: np.ndarray, following: np.ndarray) -> float:
    """Mean square of log(simulated gap / recorded gap), each follower simulated from its first row."""
    v0, headway, standstill, a, b = idm[0], idm[1], idm[2], idm[3], idm[4]
    root = 2.0 * math.sqrt(a * b)
    total, count = 0.0, 0
    for event in range(following.shape[0]):
        rows = following[event]
        gap, v = rows[0, 0], rows[0, 1]
        for k in range(1, following.shape[1]):
            recorded, lead, before = rows[k, 0], rows[k, 2], rows[k - 1, 2]
            if math.isnan(recorded):
                break
            ratio = v / v0
            wanted = standstill + max(0.0, headway * v + v * (v - before) / root)
            share = wanted / max(gap, 0.5)
            accel = a * (1.0 - (ratio * ratio) * (ratio * ratio) - share * share)
            new = max(v + min(max(accel, -8.0), 4.0) * DT_S, 0.0)
            gap = max(gap + DT_S * (0.5 * (lead + before) - 0.5 * (v + new)), 0.1)
            v = new
            if recorded > 0.5:
                error = math.log(gap / recorded)
                total += error * error
                count += 1
    return total / max(count, 1)


def fit_lane_changes(idm: np.ndarray, scenes: list[Scene]) -> tuple[np.ndarray, int, int, float, float]:
    """Politeness, threshold, softness, rate and right bias; decisions, changes, and two log likelihoods."""
    base = np.concatenate([idm, [0.0, 0.0, 1.0, 0.0, 0.0, SAFE_MPS2, LATERAL_RATE_PER_S]])
    rows = np.array([row for scene in scenes for row in _decisions(base, scene)])
    if not len(rows) or not rows[:, 3].any():
        nothing = np.array([0.0, 1.0, 1.0, 0.0, 0.0])
        return nothing, len(rows), 0, 0.0, 0.0
    own, others, right, changed = rows.T

    def loss(q: np.ndarray) -> float:
        polite, threshold, softness, log_rate, bias = q
        z = np.clip((own + polite * others - threshold - bias * right) / softness, -40.0, 40.0)
        hazard = np.exp(log_rate) / (1.0 + np.exp(-z)) * DECIDE_EVERY_S
        chance = np.clip(1.0 - np.exp(-hazard), 1e-12, 1.0 - 1e-12)
        return -float(np.sum(np.where(changed > 0, np.log(chance), np.log1p(-chance))))

    bounds = [(0.0, 1.0), (-4.0, 4.0), (0.05, 2.0), (-9.0, 0.0), (0.0, 6.0)]
    found = minimize(loss, [0.2, 0.3, 0.5, -3.5, 0.3], method="L-BFGS-B", bounds=bounds)
    share = changed.mean()
    constant = float(len(rows) * (share * np.log(share) + (1.0 - share) * np.log1p(-share)))
    values = found.x.copy()
    values[RATE - len(idm)] = np.exp(values[RATE - len(idm)])
    return values, len(rows), int(changed.sum()), -float(found.fun), constant


def _decisions(p: np.ndarray, scene: Scene) -> list[tuple[float, float, float, float]]:
    """(own gain, others' gain, to the right, changed) of every allowed change that a training vehicle could make."""
    last = len(scene.road.lane_left) - 2  # the last lane of a recorded road is its ramp
    every, lead = round(DECIDE_EVERY_S / scene.dt_s), round(LEAD_S / scene.dt_s)
    rows = []
    for v in np.flatnonzero(scene.vehicle_id < scene.held_out_from):
        lane = scene.lane[:, v]
        starts = {max(k - lead, 0): int(lane[k]) for k in crossings(lane, scene.dt_s)}
        busy = np.zeros(len(lane), dtype=bool)
        for k in starts:
            busy[k + 1 : k + 2 * lead] = True
        for k in sorted(set(range(int(v) % every, len(lane), every)) | set(starts)):
            if not scene.usable[k, v] or not 0 <= lane[k] <= last or (busy[k] and k not in starts):
                continue
            for to_lane in (int(lane[k]) - 1, int(lane[k]) + 1):
                changed = starts.get(k) == to_lane
                # lane 1 is reserved where its traffic is (high-occupancy vehicles): only recorded changes count
                if not 0 <= to_lane <= last or (to_lane == 0 and not changed):
                    continue
                own, others, allowed = incentive(
                    p, scene.station[k], scene.lane[k], scene.speed[k], scene.length_m, scene.present[k],
                    int(v), to_lane,
                )  # fmt: skip
                if allowed or changed:
                    rows.append((own, others, float(to_lane > lane[k]), float(changed)))
    return rows
