"""The fitted expert with lane changes: a driver without memory whose motion across the road has two modes.

What tells that somebody is changing lanes is where in the lane and how fast across it they move. In the recordings the
probability to be in the next lane four seconds later rises from 0.07 to 0.7 as the lateral speed in the lane's middle
rises from 0.25 to 0.7 m/s; closer to the marking less speed is needed, and right behind a crossed marking none is
enough. So with o the offset and u the lateral speed towards a side,

    switch = clear / (1 + exp(-(u + offset_gain o - back - threshold) / width)),   back = max(0, -o - 0.3 m)
    lateral acceleration = (1 - switch) lane keeping + switch (cruise - u) / settling

is nearly bistable: below the threshold a driver keeps its lane, above it is drawn into the next one and settles there.
White lateral noise that grows towards the threshold starts changes now and then; a slower leader lowers the threshold.
A side is clear where a lane goes on there and the lidar shows the gaps that recorded drivers accepted. One that stops
being clear ends the change, also halfway, and nobody comes closer to a vehicle abreast than they must.

The numbers below were chosen such that simulated drivers agree with the recordings in changes per vehicle-km, spread
within the lane, peak lateral speed and the probabilities above (deploy/decisions/0011-lane-changes.md has the table).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from policies import layout as O
from service.training.expert import Expert, lateral_speed, leader

LANE_WIDTH_M = 3.66
SETTLED_BEHIND_M = (
    0.3  # a marking crossed less than half a lane ago: no further change before the lane's middle
)
FOLLOWING_S = 2.5  # a leader closer than this
CLEARANCE_SOFTNESS_M = 0.7
ABREAST = range(3, 8)  # beams at 54 to 126 degrees
MOVING_MPS = 3.0  # nobody changes lanes standing


def evasion(seen: np.ndarray, elbow_room_m: float, strongest_mps2: float) -> np.ndarray:
    """Lateral acceleration (n,) in m/s^2 away from vehicles that are abreast and closer than `elbow_room_m`."""
    push = np.zeros(len(seen))
    beams = np.arange(ABREAST.start, ABREAST.stop)
    across = np.sin(2.0 * np.pi * beams / O.BEAMS)
    for side in (1, -1):
        distance = seen[:, O.RANGE_M + (beams if side > 0 else O.BEAMS - beams)].astype(np.float64)
        room = (distance * across).min(axis=1) - 0.5 * seen[:, O.WIDTH_M]
        push -= side * strongest_mps2 * np.clip(1.0 - room / elbow_room_m, 0.0, 1.0)
    return push


@dataclass(frozen=True)
class KeepingExpert(Expert):
    """A driver who keeps the lane, and gives way to a neighbour who comes too close."""

    elbow_room_m: float = 0.9  # side to side; people in the middle of lanes have 1.8 m
    evasion_mps2: float = 1.5

    def lateral_acceleration(self, seen: np.ndarray) -> np.ndarray:
        return super().lateral_acceleration(seen) + evasion(seen, self.elbow_room_m, self.evasion_mps2)


@dataclass(frozen=True)
class ChangingExpert(KeepingExpert):
    """Parameters in SI units; see the module. Gaps are bumper to bumper in the lane beside."""

    lateral_rate_per_s: float = 0.42
    switch_threshold_mps: float = 0.5
    switch_width_mps: float = 0.12
    offset_gain_per_s: float = 0.4
    cruise_mps: float = 0.9
    settling_s: float = 1.0
    noise_strength: float = 0.052  # m/s^1.5
    noise_growth: float = 2.5  # at the threshold, with a clear side
    threshold_behind_slower: float = 0.8  # factor
    front_gap_m: float = 2.5
    front_headway_s: float = 0.2
    rear_gap_m: float = 3.0
    rear_headway_s: float = 0.3
    closing_s: float = 1.5  # more gap for each m/s of closing speed

    def lateral_acceleration(self, seen: np.ndarray) -> np.ndarray:
        u = lateral_speed(seen)
        total = Expert.lateral_acceleration(self, seen)
        for side, share in self._switches(seen):
            total = (1.0 - share) * total + share * (side * self.cruise_mps - u) / self.settling_s
        return total + evasion(seen, self.elbow_room_m, self.evasion_mps2)

    def lateral_noise(self, seen: np.ndarray) -> np.ndarray:
        moved = lateral_speed(seen) + self.offset_gain_per_s * seen[:, O.LANE_OFFSET_M]
        clear = np.where(moved > 0.0, self.clear(seen, 1), self.clear(seen, -1))
        growth = self.noise_growth * np.minimum(np.abs(moved) / self.switch_threshold_mps, 1.0) ** 2
        return self.noise_strength * (1.0 + clear * growth)

    def _switches(self, seen: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        threshold = self.switch_threshold_mps * np.where(
            self._held_up(seen), self.threshold_behind_slower, 1.0
        )
        for side in (1, -1):
            offset, u = side * seen[:, O.LANE_OFFSET_M].astype(np.float64), side * lateral_speed(seen)
            back = np.maximum(-offset - SETTLED_BEHIND_M, 0.0)
            above = u + self.offset_gain_per_s * offset - back - threshold
            yield side, self.clear(seen, side) / (1.0 + np.exp(-above / self.switch_width_mps))

    def _held_up(self, seen: np.ndarray) -> np.ndarray:
        gap, closing = leader(seen)
        v = seen[:, O.SPEED_MPS].astype(np.float64)
        return (gap < FOLLOWING_S * v) & (v - closing < 0.8 * self.desired_speed_mps)

    def clear(self, seen: np.ndarray, side: int) -> np.ndarray:
        """Whether the lane to the left (side 1) or right (-1) can be entered, (n,) from 0 to 1."""
        beams = np.arange(1, O.BEAMS // 2)
        angle = 2.0 * np.pi * beams / O.BEAMS
        beams = beams if side > 0 else O.BEAMS - beams
        distance = seen[:, O.RANGE_M + beams].astype(np.float64)
        rate = seen[:, O.RANGE_RATE_MPS + beams].astype(np.float64)
        v = seen[:, O.SPEED_MPS].astype(np.float64)[:, None]
        # whose near side is closer than this is in the lane beside, or on its way into it
        corridor = 1.25 * LANE_WIDTH_M - side * seen[:, O.LANE_OFFSET_M, None]
        there = (distance < O.LIDAR_RANGE_M - 1e-3) & (distance * np.sin(angle) < corridor)
        gap = distance * np.abs(np.cos(angle)) - 0.5 * seen[:, O.LENGTH_M, None]
        closing = np.maximum(-rate / np.maximum(np.abs(np.cos(angle)), 0.3), 0.0)
        front = np.cos(angle) > 0.0
        needed = np.where(
            front, self.front_gap_m + self.front_headway_s * v, self.rear_gap_m + self.rear_headway_s * v
        )
        spare = gap - needed - self.closing_s * closing
        free = np.where(there, 1.0 / (1.0 + np.exp(-np.clip(spare / CLEARANCE_SOFTNESS_M, -30.0, 30.0))), 1.0)
        exists = seen[:, O.LANE_TO_THE_LEFT if side > 0 else O.LANE_TO_THE_RIGHT]
        return exists * free.min(axis=1) / (1.0 + np.exp(-(v[:, 0] - MOVING_MPS) / 0.7))
