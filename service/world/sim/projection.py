"""Where a vehicle is on the road: its station, offset, lane and markings, from the network's geometry.

The road is a reference line sampled at equal stations, with the lanes' boundaries as lateral offsets from it
(`sumo_nets.corridor`). A vehicle keeps the index of its nearest station, so a step's projection looks only at
the neighbours.
"""

import math

import numpy as np

from policies.jit import kernel
from policies.layout import LANE_AHEAD_M
from service.world import agents as A

# columns of the reference line's table
REF_X, REF_Y, REF_HEADING, REF_COS, REF_SIN, REF_CURVATURE, ROAD_LEFT, ROAD_RIGHT = range(8)
# rules of a lane, which are added up
RESERVED, CLOSED, KEEPS_LEFT, KEEPS_RIGHT = 1, 2, 4, 8
NOT_FOR_ALL = RESERVED + CLOSED


@kernel
def place(
    agent: np.ndarray, station_m: float, lane: int, lane_offset_m: float, lane_heading_rad: float,
    reference: np.ndarray, lanes: np.ndarray, spacing_m: float,
) -> None:  # fmt: skip
    """Put a vehicle on the road: `station_m` along it, `lane_offset_m` left of the centre of `lane`."""
    k = min(max(int(station_m / spacing_m + 0.5), 0), reference.shape[0] - 1)
    along = station_m - k * spacing_m
    offset = 0.5 * (lanes[k, lane, 0] + lanes[k, lane, 1]) + lane_offset_m
    row = reference[k]
    stretch = 1.0 - row[REF_CURVATURE] * offset
    agent[A.X_M] = row[REF_X] + along * stretch * row[REF_COS] - offset * row[REF_SIN]
    agent[A.Y_M] = row[REF_Y] + along * stretch * row[REF_SIN] + offset * row[REF_COS]
    agent[A.HEADING_RAD] = row[REF_HEADING] + along * row[REF_CURVATURE] + lane_heading_rad
    agent[A.STATION] = k


@kernel
def _invites(lanes: np.ndarray, lane: int, here: int, ahead: int) -> float:
    """1 if `lane` exists at both stations and is open to everybody, else 0."""
    if lane < 0 or lane >= lanes.shape[1] or int(lanes[here, lane, 2]) & NOT_FOR_ALL:
        return 0.0
    return 0.0 if math.isnan(lanes[here, lane, 0]) or math.isnan(lanes[ahead, lane, 0]) else 1.0


@kernel
def locate(agent: np.ndarray, reference: np.ndarray, lanes: np.ndarray, spacing_m: float) -> None:
    """Update a vehicle's station, offset, lane and flags from its position and heading.

    reference: (stations, 8)
    lanes: (stations, lanes, 3) left and right boundary offsets, NaN where a lane does not exist, and its rules: the
        flags do not invite into a lane that is reserved (high-occupancy vehicles) or closed, nor out of one that is to
        be kept to

    A vehicle is off the road when its centre lies beyond the outermost markings, before the start, or on a lane that
    is closed to motor vehicles.
    """
    last = reference.shape[0] - 1
    k = int(agent[A.STATION])
    along = 0.0
    offset = 0.0
    # it never turns back: on a bend two neighbours can each point at the other for points between them
    way = 0
    for _ in range(last + 1):
        row = reference[k]
        dx = agent[A.X_M] - row[REF_X]
        dy = agent[A.Y_M] - row[REF_Y]
        offset = dy * row[REF_COS] - dx * row[REF_SIN]
        along = (dx * row[REF_COS] + dy * row[REF_SIN]) / (1.0 - row[REF_CURVATURE] * offset)
        if along > 0.5 * spacing_m and k < last and way >= 0:
            k += 1
            way = 1
        elif along < -0.5 * spacing_m and k > 0 and way <= 0:
            k -= 1
            way = -1
        else:
            break
    row = reference[k]
    agent[A.STATION] = k
    agent[A.ALONG_M] = along
    agent[A.OFFSET_M] = offset

    # boundaries are linear between stations; a lane counts where it exists at the nearest station
    other = min(k + 1, last) if along >= 0.0 else max(k - 1, 0)
    share = min(abs(along) / spacing_m, 1.0)
    best = 0
    best_distance = math.inf
    best_left = 0.0
    best_right = 0.0
    slope = 0.0
    for lane in range(lanes.shape[1]):
        left = lanes[k, lane, 0]
        right = lanes[k, lane, 1]
        if math.isnan(left):
            continue
        drift = 0.0
        if other != k and not math.isnan(lanes[other, lane, 0]):
            step_left = lanes[other, lane, 0] - left
            step_right = lanes[other, lane, 1] - right
            left += share * step_left
            right += share * step_right
            drift = 0.5 * (step_left + step_right) / (spacing_m if other > k else -spacing_m)
        distance = max(offset - left, right - offset)  # negative inside the lane
        if distance < best_distance:
            best, best_distance, best_left, best_right, slope = lane, distance, left, right, drift
    agent[A.LANE] = best
    agent[A.LANE_OFFSET_M] = offset - 0.5 * (best_left + best_right)
    agent[A.LEFT_MARKING_M] = best_left - offset
    agent[A.RIGHT_MARKING_M] = offset - best_right
    ahead = min(k + int(LANE_AHEAD_M / spacing_m), last)
    rules = int(lanes[k, best, 2])
    agent[A.LANE_TO_THE_LEFT] = 0.0 if rules & KEEPS_LEFT else _invites(lanes, best - 1, k, ahead)
    agent[A.LANE_TO_THE_RIGHT] = 0.0 if rules & KEEPS_RIGHT else _invites(lanes, best + 1, k, ahead)
    curvature = row[REF_CURVATURE] / (1.0 - row[REF_CURVATURE] * offset)
    agent[A.CURVATURE_PER_M] = curvature
    agent[A.LANE_HEADING_RAD] = agent[A.HEADING_RAD] - row[REF_HEADING] - along * row[REF_CURVATURE] - slope
    beyond = offset > row[ROAD_LEFT] or offset < row[ROAD_RIGHT] or rules & CLOSED != 0
    before = k == 0 and along < -0.5 * spacing_m
    agent[A.OFF_ROAD] = 1.0 if beyond or before else 0.0
