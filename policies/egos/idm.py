"""The baseline ego: an intelligent driver that keeps its lane and follows what its lidar sees ahead."""

from policies.egos.protocol import Observation
from policies.idm import idm_action

DESIRED_SPEED_MPS = 24.6  # the speed limit of the road, 55 mph


class IdmEgo:
    name = "idm"

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        return idm_action(observation.vector, DESIRED_SPEED_MPS)
