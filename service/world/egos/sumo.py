"""An ego that one of SUMO's own car-following models drives: `sumo:Krauss`, `sumo:IDM`, `sumo:EIDM`, `sumo:ACC`, ...

A third party's controller, made for traffic simulation and not for this project. SUMO finds the vehicle ahead in the
ego's lane and says which speed its model allows behind it; acceleration and braking are bounded by the type's own. The
lane is kept as the `idm` ego keeps it, because SUMO's vehicles run on rails.
"""

from typing import Protocol

from policies.egos import Observation
from policies.egos.idm import DESIRED_SPEED_MPS
from policies.idm import lane_keeping_turn_rate
from policies.layout import SPEED_MPS
from service.errors import EgoError

PREFIX = "sumo:"
MODELS = ("Krauss", "KraussOrig1", "IDM", "EIDM", "ACC", "Wiedemann", "W99")
NAMES = tuple(f"{PREFIX}{model}" for model in MODELS)


class Follows(Protocol):
    """What the ego asks of SUMO (`service.world.sim.sumo.SumoSession`)."""

    def follow_speed(self, vehicle: str, speed_mps: float) -> tuple[float, float, float]: ...


class SumoEgo:
    """Drives by SUMO's model; the simulator hands it its SUMO session before the first rollout."""

    def __init__(self, model: str, step_s: float):
        self.name = f"{PREFIX}{model}"
        self.model = model
        self._step_s = step_s
        self._sumo: Follows | None = None
        self._vehicle = ""

    def enter(self, sumo: Follows, vehicle: str) -> None:
        """`vehicle`: what SUMO calls the ego."""
        self._sumo, self._vehicle = sumo, vehicle

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation: Observation) -> tuple[float, float]:
        if self._sumo is None:
            raise EgoError(f"ego {self.name!r} drives in SUMO only, and no session was handed to it")
        speed = float(observation.vector[SPEED_MPS])
        allowed, most, least = self._sumo.follow_speed(self._vehicle, max(speed, 0.0))
        wanted = min(allowed, DESIRED_SPEED_MPS)
        acceleration = (wanted - speed) / self._step_s
        return min(max(acceleration, -least), most), lane_keeping_turn_rate(observation.vector)
