"""One step of drivers who see, react and sometimes do not look: what `service.world.sim.step.advance_all` is to
others."""

import numpy as np

from policies import layout
from policies.exactmath import exp, sincos
from policies.idm import idm_action
from policies.jit import kernel
from policies.layout import LOG_STD_MAX, LOG_STD_MIN
from policies.network import forward_all, sample_action
from service.world import agents as A
from service.world.scenario.schema import Scenario
from service.world.sim import avoidance as C
from service.world.sim import latent as L
from service.world.sim import minds as M
from service.world.sim.dynamics import advance
from service.world.sim.projection import locate
from service.world.sim.step import TAKEOVER_SPEED_MPS, advance_all, network_driven, write_poses

BUSY_MPS = 0.35  # lateral speed above which nobody begins to look away: a lane change is under way


def traits_of(scenario: Scenario) -> np.ndarray:
    """The scenario's thresholds as the kernel reads them, (C.TRAITS,); empty without a human table."""
    if scenario.human is None:
        return np.zeros(0)
    a = scenario.human.avoidance
    return np.array([a.ttc_s, a.required_mps2, a.hardest_mps2, a.jerk_mps3, a.gap_m, a.gap_closing_s])


@kernel
def reset_minds(minds: np.ndarray, reactions_s: np.ndarray) -> None:
    """Drivers at the start of a rollout, with their reaction times (vehicles,)."""
    for i in range(minds.shape[0]):
        minds[i, :] = 0.0
        minds[i, M.REACTION_S] = reactions_s[i]
        minds[i, M.SINCE_AWAY_S] = M.NEVER_S


@kernel
def _look(
    agents: np.ndarray, controlled: int, count: int, reference: np.ndarray, lanes: np.ndarray, spacing_m: float,
    seen: np.ndarray,
) -> None:  # fmt: skip
    """Fill `seen` (count, C.SEEN): where everybody is along and across the road, before anybody moves."""
    row = np.empty(A.COLUMNS)
    for j in range(count):
        if agents[j, A.ACTIVE] == 0.0:
            continue
        agent = agents[j]
        if j >= controlled:  # background traffic, which `observe` does not locate
            row[:] = agent
            row[A.STATION] = agents[0, A.STATION]
            locate(row, reference, lanes, spacing_m)
            agent = row
        sine, _ = sincos(agent[A.LANE_HEADING_RAD])
        seen[j, C.STATION_M] = agent[A.STATION] * spacing_m + agent[A.ALONG_M]
        seen[j, C.OFFSET_M] = agent[A.OFFSET_M]
        seen[j, C.SPEED_MPS] = agent[A.SPEED_MPS]
        seen[j, C.ACROSS_MPS] = agent[A.SPEED_MPS] * sine
        seen[j, C.ACCELERATION_MPS2] = agent[A.ACCELERATION_MPS2]


@kernel
def advance_human(
    agents: np.ndarray, controlled: int, count: int, ego: int, ego_acceleration_mps2: float, ego_turn_rate_radps: float,
    observations: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray, b2: np.ndarray, head: np.ndarray,
    action_scale: np.ndarray, happens: np.ndarray, dt_s: float, reference: np.ndarray, lanes: np.ndarray,
    spacing_m: float, minds: np.ndarray, traits: np.ndarray, poses: np.ndarray,
) -> None:  # fmt: skip
    """Move every active controlled vehicle by one step, the drivers as people do.

    happens: (controlled, 4), this step's row of `service.world.sim.latent`
    minds: (controlled, M.COLUMNS), updated
    traits: see `traits_of`; the rest as `service.world.sim.step.advance_all` has it
    """
    outputs = np.empty((controlled, layout.OUTPUTS), np.float32)
    rows = np.empty(controlled + 1, np.intp)
    looking, driven = 0, network_driven(agents, controlled, ego, rows)
    for k in range(driven):  # who looks away already does so in this step, and needs no network
        rows[looking] = rows[k]
        looking += 1 if minds[rows[k], M.AWAY_S] <= 0.0 else 0
    forward_all(observations, rows, looking, w1, b1, w2, b2, head, outputs)
    seen = np.zeros((count, C.SEEN))
    _look(agents, controlled, count, reference, lanes, spacing_m, seen)
    for i in range(controlled):
        agent = agents[i]
        if agent[A.ACTIVE] == 0.0:
            continue
        if i == ego:
            advance(agent, ego_acceleration_mps2, ego_turn_rate_radps, dt_s, True)
            continue
        mind = minds[i]
        mind[M.EVADED] = 0.0
        if agent[A.COLLISION] != 0.0 or agent[A.OFF_ROAD] != 0.0:
            agent[A.TAKEN_OVER] = 1.0
        if agent[A.TAKEN_OVER] != 0.0:
            acceleration, turn_rate = idm_action(observations[i], TAKEOVER_SPEED_MPS)
            advance(agent, acceleration, turn_rate, dt_s, False)
            continue
        seconds = happens[i, L.GLANCE]
        if seconds > mind[M.AWAY_S]:
            leaks = happens[i, L.LEAK] != 0.0
            busy = C.in_conflict(agent, mind, BUSY_MPS) or C.foreseen(
                agents, count, seen, i, traits, seconds, mind[M.HELD_MPS2]
            )
            if busy:
                mind[M.LEAKED if leaks else M.RESISTED] += 1.0
            if leaks or not busy:
                mind[M.AWAY_S] = seconds
                mind[M.LONGEST_AWAY_S] = seconds
        noise_a, noise_w = happens[i, L.ACCELERATION], happens[i, L.TURN_RATE]
        if mind[M.AWAY_S] > 0.0:
            acceleration = mind[M.HELD_MPS2]
            turn_rate = agent[A.CURVATURE_PER_M] * agent[A.SPEED_MPS] + mind[M.SPREAD_RADPS] * noise_w
            mind[M.AWAY_S] = max(mind[M.AWAY_S] - dt_s, 0.0)
            mind[M.SINCE_AWAY_S] = 0.0
            mind[M.HAZARD_S] = 0.0
            mind[M.SIDE_S] = 0.0
            mind[M.BRAKE_MPS2] = 0.0
        else:
            acceleration, turn_rate = sample_action(outputs[i], action_scale, noise_a, noise_w)
            mind[M.SPREAD_RADPS] = action_scale[1] * exp(
                min(max(np.float64(outputs[i, 3]), LOG_STD_MIN), LOG_STD_MAX)
            )
            found = C.conflicts(agents, count, seen, i, traits)
            acceleration, turn_rate = C.respond(agent, mind, found, traits, dt_s, acceleration, turn_rate)
            mind[M.SINCE_AWAY_S] += dt_s
            # what a driver holds is what it means to do, braking included, without the noise of the moment
            mind[M.HELD_MPS2] = action_scale[0] * np.float64(outputs[i, 0])
            if mind[M.EVADED] != 0.0:
                mind[M.HELD_MPS2] = acceleration
        advance(agent, acceleration, turn_rate, dt_s, False)
    write_poses(agents, controlled, lanes.shape[1], poses)


@kernel
def advance_vehicles(
    agents: np.ndarray, controlled: int, count: int, ego: int, ego_acceleration_mps2: float, ego_turn_rate_radps: float,
    observations: np.ndarray, w1: np.ndarray, b1: np.ndarray, w2: np.ndarray, b2: np.ndarray, head: np.ndarray,
    action_scale: np.ndarray, happens: np.ndarray, dt_s: float, reference: np.ndarray, lanes: np.ndarray,
    spacing_m: float, minds: np.ndarray, traits: np.ndarray, poses: np.ndarray,
) -> None:  # fmt: skip
    """Move every active controlled vehicle by one step: the drivers as people do, or by their network alone.

    traits: see `traits_of`; without any, `happens` is the `action_noise` of `service.world.sim.step.advance_all`; the
    rest as `advance_human` has it
    """
    if traits.shape[0] > 0:
        advance_human(
            agents, controlled, count, ego, ego_acceleration_mps2, ego_turn_rate_radps, observations, w1, b1, w2, b2,
            head, action_scale, happens, dt_s, reference, lanes, spacing_m, minds, traits, poses,
        )  # fmt: skip
    else:
        advance_all(
            agents, controlled, ego, ego_acceleration_mps2, ego_turn_rate_radps, observations, w1, b1, w2, b2, head,
            action_scale, happens, dt_s, lanes.shape[1], poses,
        )  # fmt: skip
