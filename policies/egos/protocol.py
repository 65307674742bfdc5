"""What an ego policy is given and what it answers. The world treats it as a black box."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(slots=True)
class Observation:
    """What the ego perceives at one step.

    `vector` (51,) is laid out as `policies.layout` says. It belongs to the world and is overwritten by the next
    step: a policy that remembers it must copy it.
    """

    vector: np.ndarray
    time_s: float


class EgoPolicy(Protocol):
    """A driving policy under test."""

    name: str

    def reset(self, seed: int) -> None:
        """Forget everything; a new rollout begins. Any randomness must come from `seed` alone."""

    def act(self, observation: Observation) -> tuple[float, float]:
        """Acceleration (m/s^2) and turn rate (rad/s), held until the next step; the world clips them."""
