"""What a reference driver sees of a conflict and what it answers: braking, and nothing else.

A reference driver stands for a competent human. It is given distances and speeds without error, as the regulation's
calculations have them, and keeps its lane; steering is not its business.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Own:
    """The vehicle that the reference driver drives.

    speed_mps: along the road
    acceleration_mps2: as applied in the last step
    """

    speed_mps: float
    acceleration_mps2: float


@dataclass(frozen=True, slots=True)
class Other:
    """Another vehicle, along the road and across it.

    ahead: whether its centre is not behind the driver's
    gap_along_m, gap_across_m: between the boxes, 0 and below where they overlap in that direction
    speed_mps: along the road
    towards_mps: across the road, towards the driver
    towards_m: from the middle of its own lane towards the driver's; infinite where it is in the driver's lane
    lengths_m: half of both vehicles' lengths together
    """

    ahead: bool
    gap_along_m: float
    gap_across_m: float
    speed_mps: float
    towards_mps: float
    towards_m: float
    lengths_m: float

    @property
    def in_the_way(self) -> bool:
        """Whether it is ahead, and the driver would touch it by going straight on."""
        return self.ahead and self.gap_across_m <= 0.0

    def time_to_collision_s(self, own: Own) -> float:
        """Gap over closing speed along the road (s); infinite where the driver is not the faster one."""
        closing = own.speed_mps - self.speed_mps
        return max(self.gap_along_m, 0.0) / closing if closing > 0.0 else math.inf


class ReferenceDriver(Protocol):
    """A driver model that a conflict is held against."""

    name: str

    def reset(self) -> None:
        """A new conflict begins."""

    def act(self, own: Own, others: Sequence[Other], dt_s: float) -> float:
        """Acceleration (m/s^2, 0 or below) until the next step; 0 holds the speed."""


class Delayed:
    """What the drivers share: they go on as before for a delay once there is a danger, then their braking builds up.

    A danger that passes for a moment stops the clock and leaves it as it stands; so does braking.
    """

    def __init__(self, delay_s: float):
        self._delay_s = delay_s
        self.reset()

    def reset(self) -> None:
        self._waited_s = 0.0
        self._braking_mps2 = 0.0

    def waits(self, dt_s: float) -> bool:
        """Whether the driver still reacts in this step, in which there is a danger."""
        if self._waited_s < self._delay_s:
            self._waited_s += dt_s
            return True
        return False

    def builds_up(self, jerk_mps3: float, most_mps2: float, dt_s: float) -> float:
        """Deceleration (m/s^2) of this step."""
        self._braking_mps2 = min(self._braking_mps2 + jerk_mps3 * dt_s, most_mps2)
        return self._braking_mps2
