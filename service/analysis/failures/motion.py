"""What led up to a dangerous moment, as a few numbers with a meaning: the motion of the ego and of the other vehicle.

Everything is in the road's own frame: along the road, and across it with left positive. The moment is that of the
smallest value of the safety measure; where the boxes meet, it is the last state before they did, because positions of
overlapping boxes say nothing about how they came to overlap.
"""

import math

import msgspec
import numpy as np

from service.analysis.trace import Trace
from service.world import agents as A
from service.world.safety.ttc import ego_time_to_collision
from service.world.sensors.lidar import beam_directions
from sumo_nets.corridor import Corridor

# motion before the moment that is looked at: a lane change takes 3 to 6 s (Toledo and Zohar 2007)
WINDOW_S = 3.0
ALONGSIDE_M = 3.0  # a vehicle this close behind or ahead of the ego's box still blocks the lane beside it


class Motion(msgspec.Struct, frozen=True, kw_only=True):
    """The moment of smallest f, and the seconds before it.

    Gaps are between boxes, negative where they overlap along that axis; speeds are relative to the ego where they say
    so. A lane change is net over the window: lanes to the left, negative to the right.
    """

    other: int  # the vehicle that the smallest value is to: its row in the scenario
    time_s: float  # of the moment, since the start
    ahead_m: float  # of the ego's centre to the other's, along the road
    left_m: float  # the same across the road
    gap_along_m: float
    gap_across_m: float
    closing_along_mps: float  # how fast the centres approach along the road; negative: they part
    closing_across_mps: float  # the same across the road
    ego_speed_mps: float
    other_speed_mps: float
    ego_across_mps: float  # lateral speed, left positive
    other_across_mps: float
    heading_deg: float  # the other's heading relative to the ego's, counter-clockwise
    ray_deg: float  # direction from the ego to the other relative to the ego's heading, counter-clockwise
    before_ahead_m: float  # ahead_m and left_m when the window begins
    before_left_m: float
    same_lane: bool  # at the moment
    same_lane_before: bool  # when the window begins
    ego_lanes_left: int  # lanes changed in the window
    other_lanes_left: int
    ego_moved_left_m: float  # moved across the road in the window
    other_moved_left_m: float
    ego_braking_mps2: float  # hardest deceleration in the window, 0 or more
    other_braking_mps2: float
    ego_action_mps2: float  # what the ego asked for at the moment
    ego_action_radps: float
    left_blocked: bool  # a vehicle beside the ego in the next lane, or no lane there
    right_blocked: bool


def motion_of(trace: Trace, rays: int, corridor: Corridor) -> Motion | None:
    """The motion that led to the trace's smallest value; None where no vehicle of the scenario is to be seen.

    rays: of the safety measure

    None also where background traffic is closer in time than any of the scenario's vehicles, as the trace does not
    hold it.
    """
    if not trace.measured.size:
        return None
    worst = int(np.argmin(trace.measured))
    other = _touched(trace, worst)
    if other is None:
        other = threat(trace, worst, rays)
    if other is None:
        return None
    ego = trace.ego
    k = _before_contact(trace, worst, other)
    first = max(int(np.searchsorted(trace.time_s, trace.time_s[k] - WINDOW_S - 1e-9)), 0)
    me, you = trace.agents[k, ego], trace.agents[k, other]
    ahead, left = _apart(trace, k, other)
    before_ahead, before_left = _apart(trace, first, other)
    window = slice(first, k + 1)
    along, across = _velocity(you)
    my_along, my_across = _velocity(me)
    action = trace.actions[min(k, len(trace.actions) - 1)] if len(trace.actions) else np.zeros(2)
    moved = trace.agents[k, :, A.OFFSET_M] - trace.agents[first, :, A.OFFSET_M]
    changed = trace.agents[first, :, A.LANE] - trace.agents[k, :, A.LANE]  # lane 0 is the leftmost
    dx, dy = you[A.X_M] - me[A.X_M], you[A.Y_M] - me[A.Y_M]
    return Motion(
        other=other,
        time_s=float(trace.time_s[worst]),
        ahead_m=ahead,
        left_m=left,
        gap_along_m=abs(ahead) - 0.5 * float(me[A.LENGTH_M] + you[A.LENGTH_M]),
        gap_across_m=abs(left) - 0.5 * float(me[A.WIDTH_M] + you[A.WIDTH_M]),
        closing_along_mps=math.copysign(1.0, ahead) * (my_along - along),
        closing_across_mps=math.copysign(1.0, left) * (my_across - across),
        ego_speed_mps=float(me[A.SPEED_MPS]),
        other_speed_mps=float(you[A.SPEED_MPS]),
        ego_across_mps=my_across,
        other_across_mps=across,
        heading_deg=_degrees(you[A.HEADING_RAD] - me[A.HEADING_RAD]),
        ray_deg=_degrees(math.atan2(dy, dx) - me[A.HEADING_RAD]),
        before_ahead_m=before_ahead,
        before_left_m=before_left,
        same_lane=bool(me[A.LANE] == you[A.LANE]),
        same_lane_before=bool(trace.agents[first, ego, A.LANE] == trace.agents[first, other, A.LANE]),
        ego_lanes_left=int(changed[ego]),
        other_lanes_left=int(changed[other]),
        ego_moved_left_m=float(moved[ego]),
        other_moved_left_m=float(moved[other]),
        ego_braking_mps2=_braking(trace, window, ego),
        other_braking_mps2=_braking(trace, window, other),
        ego_action_mps2=float(action[0]),
        ego_action_radps=float(action[1]),
        left_blocked=_blocked(trace, k, -1, corridor),
        right_blocked=_blocked(trace, k, 1, corridor),
    )


def _touched(trace: Trace, k: int) -> int | None:
    """The vehicle in the ego's contact, where state k is the one in which it ended."""
    contact = trace.rollout.contact
    known = contact is not None and contact.other < len(trace.names) and k == len(trace.time_s) - 1
    return contact.other if contact is not None and known else None


def threat(trace: Trace, k: int, rays: int) -> int | None:
    """The vehicle whose time to collision with the ego is the smallest at state k; where nobody closes in, the nearest.

    None where that is none of the scenario's vehicles: the trace's own smallest time to collision is then to
    background traffic, which it does not hold.
    """
    directions = beam_directions(rays)
    soonest, found = math.inf, None
    nearest, beside = math.inf, None
    for i in range(len(trace.names)):
        if i == trace.ego or trace.agents[k, i, A.ACTIVE] == 0.0:
            continue
        pair = np.ascontiguousarray(trace.agents[k, [trace.ego, i]])
        ttc_s = ego_time_to_collision(pair, 2, 0, directions, np.empty(rays), np.empty(rays))
        if ttc_s < soonest:
            soonest, found = ttc_s, i
        distance = math.hypot(*_apart(trace, k, i))
        if distance < nearest:
            nearest, beside = distance, i
    if soonest == trace.ttc_s[k] == math.inf:
        return beside
    return found if soonest <= trace.ttc_s[k] else None


def _before_contact(trace: Trace, k: int, other: int) -> int:
    """The last state up to k in which the two boxes are apart along or across the road; k itself if there is none."""
    me, you = trace.agents[k, trace.ego], trace.agents[k, other]
    length, width = 0.5 * (me[A.LENGTH_M] + you[A.LENGTH_M]), 0.5 * (me[A.WIDTH_M] + you[A.WIDTH_M])
    for state in range(k, -1, -1):
        ahead, left = _apart(trace, state, other)
        if abs(ahead) > length or abs(left) > width:
            return state
    return k


def _apart(trace: Trace, k: int, other: int) -> tuple[float, float]:
    station, offset = trace.station_m[k], trace.agents[k, :, A.OFFSET_M]
    return float(station[other] - station[trace.ego]), float(offset[other] - offset[trace.ego])


def _velocity(agent: np.ndarray) -> tuple[float, float]:
    """Speed along and across the vehicle's lane, m/s."""
    speed, angle = float(agent[A.SPEED_MPS]), float(agent[A.LANE_HEADING_RAD])
    return speed * math.cos(angle), speed * math.sin(angle)


def _braking(trace: Trace, window: slice, vehicle: int) -> float:
    return max(-float(trace.agents[window, vehicle, A.ACCELERATION_MPS2].min()), 0.0)


def _blocked(trace: Trace, k: int, side: int, corridor: Corridor) -> bool:
    """Whether the lane beside the ego's (side -1: left, 1: right) is missing or has a vehicle beside the ego."""
    me = trace.agents[k, trace.ego]
    beside = int(me[A.LANE]) + side
    lanes = corridor.sumo_lane.shape[0]
    if not 0 <= beside < lanes or corridor.sumo_lane[beside, int(me[A.STATION])] < 0:
        return True
    for i in range(len(trace.names)):
        you = trace.agents[k, i]
        if i == trace.ego or you[A.ACTIVE] == 0.0 or int(you[A.LANE]) != beside:
            continue
        ahead, _ = _apart(trace, k, i)
        if abs(ahead) - 0.5 * (me[A.LENGTH_M] + you[A.LENGTH_M]) < ALONGSIDE_M:
            return True
    return False


def _degrees(angle_rad: float) -> float:
    return math.degrees(math.remainder(angle_rad, 2.0 * math.pi))
