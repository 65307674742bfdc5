"""How the drivers of a rollout drove, as sums from which rates are made: lane changes, hard brakes, headways, speed.

The environment's vehicles alone, and only while their driver network drives them: one that was taken over after a
contact or off the road says nothing of the drivers.
"""

from dataclasses import dataclass

import numpy as np

from policies.realism.lane_changes import crossings
from service.analysis.trace import Trace
from service.world import agents as A

HARD_BRAKE_MPS2 = 3.0  # deceleration that counts as hard braking, as on the drivers' card
CLOSE_S = 1.0  # following within this time headway is close
LONGEST_HEADWAY_S = 10.0  # further behind nobody follows
MOVING_MPS = 1.0  # headways of standing vehicles mean nothing


@dataclass(frozen=True)
class Driving:
    """Sums over the drivers of one rollout.

    km: driven by all of them
    hard_brakes: times that a deceleration of HARD_BRAKE_MPS2 began
    states: vehicles times steps
    following: of these within LONGEST_HEADWAY_S behind another
    close: within CLOSE_S
    headway_s, speed_mps: sums of time headways over `following`, and of speeds over `states`
    """

    km: float = 0.0
    lane_changes: int = 0
    hard_brakes: int = 0
    states: int = 0
    following: int = 0
    close: int = 0
    headway_s: float = 0.0
    speed_mps: float = 0.0


def driving_of(trace: Trace) -> Driving:
    """The sums of one rollout."""
    agents = trace.agents
    if len(agents) < 2:
        return Driving()
    step_s = float(trace.time_s[1] - trace.time_s[0])
    drivers = [i for i in range(len(trace.names)) if i != trace.ego]
    driven = (agents[:, :, A.ACTIVE] != 0.0) & (agents[:, :, A.TAKEN_OVER] == 0.0)
    lane = np.where(driven, agents[:, :, A.LANE], -1).astype(np.int64)
    braking = driven & (agents[:, :, A.ACCELERATION_MPS2] <= -HARD_BRAKE_MPS2)
    moved = np.abs(np.diff(trace.station_m, axis=0))
    headway = _headways(trace, driven)[:, drivers]
    follows = np.isfinite(headway)
    return Driving(
        km=float(np.where(driven[1:], moved, 0.0)[:, drivers].sum()) / 1000.0,
        lane_changes=sum(len(crossings(lane[:, i], step_s)) for i in drivers),
        hard_brakes=int((braking[1:, drivers] & ~braking[:-1, drivers]).sum()),
        states=int(driven[:, drivers].sum()),
        following=int(follows.sum()),
        close=int((headway < CLOSE_S).sum()),
        headway_s=float(headway[follows].sum()),
        speed_mps=float(np.where(driven, agents[:, :, A.SPEED_MPS], 0.0)[:, drivers].sum()),
    )


def _headways(trace: Trace, driven: np.ndarray) -> np.ndarray:
    """Time headway, front to front, of each driven vehicle to the one ahead in its lane, (T, vehicles); NaN where it
    follows nobody within LONGEST_HEADWAY_S."""
    agents, station = trace.agents, trace.station_m
    active = agents[:, :, A.ACTIVE] != 0.0
    lane, speed = agents[:, :, A.LANE], agents[:, :, A.SPEED_MPS]
    ahead = station[:, None, :] - station[:, :, None]  # (T, follower, leader)
    leads = (lane[:, None, :] == lane[:, :, None]) & (ahead > 0.0) & active[:, None, :]
    gap = np.where(leads, ahead, np.inf).min(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        headway = gap / speed
    known = driven & (speed > MOVING_MPS) & (headway < LONGEST_HEADWAY_S)
    return np.where(known, headway, np.nan)
