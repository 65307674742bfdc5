"""What an ego policy is given and what it answers. The world treats it as a black box."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(slots=True)
class Observation:
    """What the ego perceives at one step.

    `vector` (51,) is laid out as `policies.layout` says; `row`, the ego's row of the world's state, has the columns of
    `service.world.agents`; `frame` (height, width, 3) uint8 RGB is the camera's picture, for egos whose
    `wants_camera` is true. All belong to the world and are overwritten by the next step: a policy that remembers them
    must copy them.
    """

    vector: np.ndarray
    time_s: float
    row: np.ndarray | None = None
    frame: np.ndarray | None = None


class EgoPolicy(Protocol):
    """A driving policy under test. One that has the attribute `wants_camera = True` is given pictures.

    What it holds outside this process, it gives back in `close()`, where it has that method.
    """

    name: str

    def reset(self, seed: int) -> None:
        """Forget everything; a new rollout begins. Any randomness must come from `seed` alone."""

    def act(self, observation: Observation) -> tuple[float, float]:
        """Acceleration (m/s^2) and turn rate (rad/s), held until the next step; the world clips them."""
