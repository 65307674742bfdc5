"""A part of a rollout as one compiled call: from a state on, with what its drivers do in the steps of that part."""

import math

import numpy as np

from policies.egos.compiled import act
from policies.jit import kernel
from policies.layout import OUTPUTS
from service.world.safety.impact import time_or_impact
from service.world.sim import step
from service.world.sim.human import advance_vehicles
from service.world.sim.step import observe

RAYS, IMPACT = 0, 1  # compiled measures


@kernel
def drive_on(
    agents: np.ndarray, controlled: int, ego: int, ego_kind: int, ego_w1: np.ndarray, ego_b1: np.ndarray,
    ego_w2: np.ndarray, ego_b2: np.ndarray, ego_head: np.ndarray, ego_scale: np.ndarray, w1: np.ndarray, b1: np.ndarray,
    w2: np.ndarray, b2: np.ndarray, head: np.ndarray, scale: np.ndarray, action_noise: np.ndarray, dt_s: float,
    reference: np.ndarray, lanes: np.ndarray, spacing_m: float, beams: np.ndarray, rays: np.ndarray,
    observations: np.ndarray, poses: np.ndarray, measure: int, minds: np.ndarray, traits: np.ndarray, status: int,
    smallest: float,
) -> tuple[float, int, int]:  # fmt: skip
    """The smallest value of the measure so far, how the ego stands (service.world.sim.step) and the steps driven.

    agents, observations, minds: the state, as `observe` left it; they are moved on
    status, smallest: of that state; where it has ended nothing is driven
    ego_kind: see `policies.egos.compiled`
    ego_w1 to ego_scale: the ego's network; w1 to scale: the drivers'
    action_noise: of these steps, (steps, vehicles, 2) standard normals, or (steps, vehicles, 4) of
        `service.world.sim.latent` where `traits` says that the drivers are human
    traits: see `service.world.sim.human`; the rest as `service.world.sim.step` has it

    The smallest value is NaN where the ego answered a number that is not finite.
    """
    outputs = np.empty(OUTPUTS, np.float32)
    k = 0
    while status == step.RUNNING and k < action_noise.shape[0]:
        a, w = act(ego_kind, observations[ego], ego_w1, ego_b1, ego_w2, ego_b2, ego_head, ego_scale, outputs)
        if not (math.isfinite(a) and math.isfinite(w)):
            return math.nan, status, k
        advance_vehicles(
            agents, controlled, controlled, ego, a, w, observations, w1, b1, w2, b2, head, scale, action_noise[k],
            dt_s, reference, lanes, spacing_m, minds, traits, poses,
        )  # fmt: skip
        status, value = observe(
            agents, controlled, controlled, ego, reference, lanes, spacing_m, beams, rays, observations
        )
        if measure == IMPACT:
            value = time_or_impact(agents, controlled, ego)
        if value < smallest:
            smallest = value
        k += 1
    return smallest, status, k
