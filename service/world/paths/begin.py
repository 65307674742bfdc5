"""States at the start, from draws of P0: the same bits as `service.world.sim.rollout.Draw` gives one rollout."""

import math
from typing import NamedTuple

import numpy as np

from policies.exactmath import arcsine, exp, log, sincos
from policies.jit import kernel
from policies.layout import HEAD_SIZE
from service.world import agents as A
from service.world.paths.states import CAUSES
from service.world.safety.impact import time_or_impact
from service.world.scenario.base import STARTS, before_weights
from service.world.scenario.causes import REACTION_S, cause_names, kinds
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M
from service.world.sim.projection import place
from service.world.sim.segment import IMPACT
from service.world.sim.step import observe


class Layout(NamedTuple):
    """Where in x what lies, and what the scenario makes of it, as the kernel reads it.

    first_cause: column of the causes; width: of one vehicle's, 0 without; first_weight: column of xi
    lanes, lengths_m, widths_m: (vehicles,)
    across: whether a lateral speed is drawn in place of the heading; the rest: `service.world.scenario.schema.Start`
    """

    ego: int
    first_cause: int
    width: int
    first_weight: int
    lanes: np.ndarray
    lengths_m: np.ndarray
    widths_m: np.ndarray
    across: bool
    offset_gain: float
    full_mps: float
    speed_power: float
    steepest_deg: float


def layout_of(scenario: Scenario) -> Layout:
    """Of a scenario's draws."""
    first_weight = before_weights(scenario)
    start = scenario.start
    return Layout(
        scenario.ego,
        first_weight - len(cause_names(scenario)),
        len(kinds(scenario)),
        first_weight,
        np.array([v.lane - 1 for v in scenario.vehicles], dtype=np.int64),
        np.array([float(scenario.of(v, "length_m")) for v in scenario.vehicles]),
        np.array([float(scenario.of(v, "width_m")) for v in scenario.vehicles]),
        start.lateral_mps is not None,
        start.lateral_offset_gain,
        start.lateral_full_mps,
        start.lateral_speed_power,
        start.lateral_steepest_deg,
    )


@kernel
def _heading(at: Layout, offset_m: float, drawn: float, speed_mps: float) -> float:
    """As `service.world.scenario.base` has it, in radians relative to the lane."""
    if not at.across:
        return drawn * (math.pi / 180.0)
    if speed_mps <= 0.0:
        return 0.0
    most, _ = sincos(at.steepest_deg * (math.pi / 180.0))
    slow = min(1.0, speed_mps / at.full_mps)
    slowed = exp(at.speed_power * log(slow)) if slow > 0.0 else 0.0
    lateral = drawn * (1.0 + at.offset_gain * offset_m * offset_m) * slowed
    return arcsine(min(max(lateral / speed_mps, -most), most))


@kernel
def begin(
    x: np.ndarray, layout: Layout, reference: np.ndarray, lanes: np.ndarray, spacing_m: float, beams: np.ndarray,
    rays: np.ndarray, measure: int, grid: float, agents: np.ndarray, observations: np.ndarray, minds: np.ndarray,
    causes: np.ndarray, heads: np.ndarray, smallest: np.ndarray, status: np.ndarray,
) -> None:  # fmt: skip
    """Fill the states' arrays, all zero before, from x (n, d)."""
    vehicles = agents.shape[1]
    for r in range(x.shape[0]):
        for i in range(vehicles):
            agent = agents[r, i]
            at = STARTS * i
            station, offset, third, speed = x[r, at], x[r, at + 1], x[r, at + 2], x[r, at + 3]
            agent[A.LENGTH_M] = layout.lengths_m[i]
            agent[A.WIDTH_M] = layout.widths_m[i]
            agent[A.SPEED_MPS] = speed
            agent[A.ACTIVE] = 1.0
            heading = _heading(layout, offset, third, speed)
            place(agent, station, layout.lanes[i], offset, heading, reference, lanes, spacing_m)
        for j in range(HEAD_SIZE):
            heads[r, j] = x[r, layout.first_weight + j]
        other = 0
        for i in range(minds.shape[1]):
            minds[r, i, M.SINCE_AWAY_S] = M.NEVER_S
            if i != layout.ego:
                for c in range(CAUSES):
                    causes[r, i, c] = x[r, layout.first_cause + layout.width * other + c]
                other += 1
            minds[r, i, M.REACTION_S] = np.rint(causes[r, i, REACTION_S] / grid) * grid
        status[r], smallest[r] = observe(
            agents[r],
            vehicles,
            vehicles,
            layout.ego,
            reference,
            lanes,
            spacing_m,
            beams,
            rays,
            observations[r],
        )
        if measure == IMPACT:
            smallest[r] = time_or_impact(agents[r], vehicles, layout.ego)
