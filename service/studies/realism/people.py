"""Drivers with a human table among recorded vehicles or in a stream: what happens to them, and a step of theirs."""

from functools import cache

import msgspec
import numpy as np

import ce
from policies.jit import kernel
from service.world import agents as A
from service.world.scenario.causes import (
    GLANCE_DURATION_S,
    GLANCE_ONSET_S,
    REACTION_S,
    kinds,
    marginals_of_causes,
)
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M
from service.world.sim.dynamics import advance
from service.world.sim.human import advance_human, reset_minds, traits_of
from service.world.sim.latent import CHANNELS, Latent
from service.world.sim.step import NO_EGO

# what happens, minds and traits of drivers without a human table
UNNEEDED = np.zeros((0, 0, CHANNELS)), np.zeros((0, M.COLUMNS)), np.zeros(0)


@cache
def _latent(scenario: Scenario, steps: int) -> Latent:
    time = msgspec.structs.replace(scenario.time, horizon_s=steps * scenario.time.step_s)
    return Latent(msgspec.structs.replace(scenario, time=time))


def people(
    scenario: Scenario, steps: int, n: int, rng: np.random.Generator, staying: bool = True
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """n drivers as P0 of the scenario draws them: what happens to them (steps, n, 4) (`service.world.sim.latent`), what
    they have in mind at the start (n, M.COLUMNS), and their traits.

    staying: False where rows are handed on from driver to driver: no driver's first long glance is the row's then
    """
    one = ce.Product(marginals_of_causes(scenario)[: len(kinds(scenario))])
    causes, _ = ce.draw(one, int(rng.integers(2**31)), "estimate", 0, 0, n)
    if not staying:
        causes[:, [GLANCE_ONSET_S, GLANCE_DURATION_S]] = 0.0
    happens = _latent(scenario, steps).realise_all(rng.standard_normal((steps, n, CHANNELS)), causes)
    minds = np.zeros((n, M.COLUMNS))
    reset_minds(minds, causes[:, REACTION_S])
    return happens, minds, traits_of(scenario)


@kernel
def advance_people(
    agents: np.ndarray, controlled: int, count: int, seen: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray,
    b2: np.ndarray, head: np.ndarray, action_scale: np.ndarray, happens: np.ndarray, reference: np.ndarray,
    lanes: np.ndarray, spacing_m: float, minds: np.ndarray, traits: np.ndarray, poses: np.ndarray,
) -> None:  # fmt: skip
    """One step of 0.1 s; nobody is taken over at a contact, and who has left the road goes on straight."""
    for i in range(controlled):
        agents[i, A.COLLISION] = 0.0
        agents[i, A.OFF_ROAD] = 0.0
    advance_human(
        agents, controlled, count, NO_EGO, 0.0, 0.0, seen, w1, b1, w2, b2, head, action_scale, happens, 0.1, reference,
        lanes, spacing_m, minds, traits, poses,
    )  # fmt: skip
    for i in range(controlled):
        if agents[i, A.ACTIVE] == 0.0:
            advance(agents[i], 0.0, 0.0, 0.1, False)
