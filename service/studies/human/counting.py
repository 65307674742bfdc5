"""One rollout as the rates see it: kilometres, contacts and near-crashes among the environment vehicles.

The same rollout, to the bit, as `service.world.sim.without_sumo` drives; only more is written down of it.
"""

import math

import numpy as np

from policies.drivers import DriverModel
from policies.egos import load_ego
from policies.egos.compiled import IDM, act
from policies.egos.lidar import LidarEgo
from policies.exactmath import sincos
from policies.jit import kernel
from policies.layout import OUTPUTS
from service.errors import InputError
from service.world import agents as A
from service.world.safety.boxes import time_until_touch
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M
from service.world.sim import step
from service.world.sim.collision import overlap
from service.world.sim.human import advance_human, traits_of
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.step import advance_all, observe
from service.world.sim.world import DriverNetwork, World
from sumo_nets.corridor import Corridor

EARLY_S = 10.0  # what happens before is told apart
NEAR_TTC_S = 1.5  # time until the boxes touch, with evasion: a near-crash
NEAR_REQUIRED_MPS2 = 0.5 * 9.80665  # or a deceleration required above this
EVASIVE_MPS2 = 3.0  # a rapid evasion: braking harder than this, ...
EVASIVE_ACROSS_MPS2 = 2.0  # ... or an evasive turn with this much lateral acceleration
APART_S = 2.0  # dangers of a pair less than this apart are one
SAME_LANE_S = 3.0  # in each other's path this long before a contact: a rear-end, not a cut-in
RECENT_S = 1.5  # a glance this short a time before a contact had to do with it
MOST_CONTACTS = 64  # contacts and near-crashes of one rollout, that are kept
REAR_END, CUT_IN, SIDE, NEAR_CRASH = range(4)
KINDS = ("rear-end", "cut-in", "side")  # of contacts

# columns of a contact, or of a near-crash, whose CAUSE is 0 by time to touch and 1 by deceleration
TIME_S, FIRST, SECOND, KIND, DELTA_V_MPS, LOOKED_AWAY, LONGEST_AWAY_S, CAUSE, AGAIN, LEAKED, RESISTED = range(
    11
)
CONTACT = 11  # the last two: of all drivers so far, by which a contact is weighed for another epsilon
# of the tallies (2, TALLIES): before EARLY_S and after
KM, EVADING_S = range(2)
TALLIES = 2


@kernel
def drive_and_count(
    agents: np.ndarray,
    n: int,
    ego: int,
    ego_kind: int,
    ew1: np.ndarray,
    eb1: np.ndarray,
    ew2: np.ndarray,
    eb2: np.ndarray,
    ehead: np.ndarray,
    escale: np.ndarray,
    w1: np.ndarray,
    b1: np.ndarray,
    w2: np.ndarray,
    b2: np.ndarray,
    head: np.ndarray,
    scale: np.ndarray,
    noise: np.ndarray,
    dt_s: float,
    reference: np.ndarray,
    lanes: np.ndarray,
    spacing_m: float,
    beams: np.ndarray,
    rays: np.ndarray,
    observations: np.ndarray,
    poses: np.ndarray,
    minds: np.ndarray,
    traits: np.ndarray,
    tallies: np.ndarray,
    contacts: np.ndarray,
) -> tuple[int, int, int]:
    """Drive, add to `tallies` (2, TALLIES), fill `contacts` (MOST_CONTACTS, CONTACT): how it ended, steps, contacts."""
    outputs = np.empty(OUTPUTS, np.float32)
    touched = np.zeros((n, n))  # 1 once a pair has been in contact
    hurt = np.zeros(n)  # 1 once a vehicle has been in any
    counted = np.full((n, n), -math.inf)  # when a danger was last seen: not counted again within APART_S
    told = np.full((n, n), -1)  # row of the near-crash that was counted last
    in_path = np.zeros((n, n))  # seconds that a pair has overlapped across the road
    seen = np.zeros((n, 3))
    history = np.zeros((int(SAME_LANE_S / dt_s) + 1, n))
    status, _ = observe(agents, n, n, ego, reference, lanes, spacing_m, beams, rays, observations)
    found = 0
    k = 0
    while True:
        t = k * dt_s
        part = 0 if t < EARLY_S else 1
        for i in range(n):
            a = agents[i]
            seen[i, 0] = a[A.STATION] * spacing_m + a[A.ALONG_M]
            seen[i, 1] = a[A.OFFSET_M]
            sine, _ = sincos(a[A.LANE_HEADING_RAD])
            seen[i, 2] = a[A.SPEED_MPS] * sine
            history[k % history.shape[0], i] = a[A.OFFSET_M]
            if i != ego and a[A.ACTIVE] != 0.0 and a[A.TAKEN_OVER] == 0.0:
                tallies[part, KM] += a[A.SPEED_MPS] * dt_s / 1000.0
                if minds[i, M.EVADED] != 0.0:
                    tallies[part, EVADING_S] += dt_s
        for i in range(n):
            for j in range(i + 1, n):
                a, b = agents[i], agents[j]
                if i == ego or j == ego or a[A.ACTIVE] == 0.0 or b[A.ACTIVE] == 0.0:
                    continue
                along, across = seen[j, 0] - seen[i, 0], seen[j, 1] - seen[i, 1]
                room = abs(across) - 0.5 * (a[A.WIDTH_M] + b[A.WIDTH_M])
                in_path[i, j] = in_path[i, j] + dt_s if room < 0.0 else 0.0
                if abs(along) > 60.0 or touched[i, j] != 0.0:
                    continue
                rear, front = (i, j) if along >= 0.0 else (j, i)
                gap = abs(along) - 0.5 * (a[A.LENGTH_M] + b[A.LENGTH_M])
                if a[A.COLLISION] != 0.0 and b[A.COLLISION] != 0.0 and overlap(a, b):
                    touched[i, j] = 1.0
                    if told[i, j] >= 0 and counted[i, j] > t - 2.0 * APART_S:
                        contacts[told[i, j], AGAIN] = 1.0  # it was no near-crash
                    if found < MOST_CONTACTS:
                        e = contacts[found]
                        found += 1
                        ux = a[A.SPEED_MPS] * a[A.COS] - b[A.SPEED_MPS] * b[A.COS]
                        uy = a[A.SPEED_MPS] * a[A.SIN] - b[A.SPEED_MPS] * b[A.SIN]
                        then = (
                            history[(k + 1) % history.shape[0]] if k + 1 >= history.shape[0] else history[0]
                        )
                        sign = 1.0 if across > 0.0 else -1.0
                        moved_i, moved_j = sign * (seen[i, 1] - then[i]), -sign * (seen[j, 1] - then[j])
                        if in_path[i, j] > SAME_LANE_S:
                            kind, cause = REAR_END, rear
                        else:
                            kind = CUT_IN if gap > -0.6 and room < -0.1 else SIDE
                            cause = i if moved_i > moved_j else j
                        e[TIME_S], e[FIRST], e[SECOND], e[KIND] = t, rear, front, kind
                        e[DELTA_V_MPS] = 0.5 * math.sqrt(ux * ux + uy * uy)
                        e[CAUSE] = cause
                        e[LOOKED_AWAY] = 1.0 if minds[cause, M.SINCE_AWAY_S] <= RECENT_S else 0.0
                        e[LONGEST_AWAY_S] = minds[cause, M.LONGEST_AWAY_S]
                        e[AGAIN] = max(hurt[i], hurt[j])
                        for q in range(n):
                            e[LEAKED] += minds[q, M.LEAKED]
                            e[RESISTED] += minds[q, M.RESISTED]
                    continue
                if hurt[i] != 0.0 or hurt[j] != 0.0:
                    continue
                evades = False
                for q in (i, j):
                    g = agents[q]
                    turn = (g[A.TURN_RATE_RADPS] - g[A.CURVATURE_PER_M] * g[A.SPEED_MPS]) * g[A.SPEED_MPS]
                    steers = minds[q, M.EVADED] != 0.0 and abs(turn) > EVASIVE_ACROSS_MPS2
                    evades = evades or steers or g[A.ACCELERATION_MPS2] < -EVASIVE_MPS2
                closing = agents[rear, A.SPEED_MPS] - agents[front, A.SPEED_MPS]
                dangers = (
                    evades and time_until_touch(a, b) < NEAR_TTC_S,
                    room < 0.0
                    and gap > 0.0
                    and closing > 0.0
                    and closing * closing / (2.0 * gap) > NEAR_REQUIRED_MPS2,
                )
                if dangers[0] or dangers[1]:
                    if t - counted[i, j] > APART_S and found < MOST_CONTACTS:
                        e = contacts[found]
                        told[i, j] = found
                        found += 1
                        e[TIME_S], e[FIRST], e[SECOND], e[KIND] = t, rear, front, NEAR_CRASH
                        e[CAUSE] = 0.0 if dangers[0] else 1.0
                        for q in range(n):
                            e[LEAKED] += minds[q, M.LEAKED]
                            e[RESISTED] += minds[q, M.RESISTED]
                    counted[i, j] = t
        for i in range(n):
            if agents[i, A.COLLISION] != 0.0:
                hurt[i] = 1.0
        if status != step.RUNNING or k >= noise.shape[0]:
            return status, k, found
        acceleration, turn_rate = act(ego_kind, observations[ego], ew1, eb1, ew2, eb2, ehead, escale, outputs)
        if traits.shape[0] > 0:
            advance_human(
                agents, n, n, ego, acceleration, turn_rate, observations, w1, b1, w2, b2, head, scale, noise[k], dt_s,
                reference, lanes, spacing_m, minds, traits, poses,
            )  # fmt: skip
        else:
            advance_all(
                agents, n, ego, acceleration, turn_rate, observations, w1, b1, w2, b2, head, scale, noise[k], dt_s,
                lanes.shape[1], poses,
            )  # fmt: skip
        status, _ = observe(agents, n, n, ego, reference, lanes, spacing_m, beams, rays, observations)
        k += 1


class Counter:
    """Counts in rollouts of one scenario with the ego `idm` or `lidar`."""

    def __init__(self, scenario: Scenario, corridor: Corridor, drivers: DriverModel, ego: str) -> None:
        """InputError where the scenario has background traffic, whose vehicles nobody counts."""
        if scenario.background is not None:
            raise InputError(f"scenario {scenario.name} has background traffic; rates are counted without it")
        net = DriverNetwork(drivers.w1, drivers.b1, drivers.w2, drivers.b2, drivers.action_scale)
        self._net = net
        self._dt_s = scenario.time.step_s
        self._world = World(
            road_of(corridor),
            net,
            len(scenario.vehicles),
            scenario.ego,
            self._dt_s,
            traits=traits_of(scenario),
        )
        self._draw = Draw(scenario)
        policy = load_ego(ego)
        own = (net.w1, net.b1, net.w2, net.b2, drivers.mu0.astype(np.float32), net.action_scale)
        self._ego = (policy.kind, *policy.weights) if isinstance(policy, LidarEgo) else (IDM, *own)

    def run(self, x: np.ndarray, noise_seed: int, tallies: np.ndarray) -> tuple[int, int, np.ndarray]:
        """How the rollout ended (service.world.sim.step), its steps and its contacts (n, CONTACT); adds to
        `tallies`."""
        world, net = self._world, self._net
        contacts = np.zeros((MOST_CONTACTS, CONTACT))
        world.minds[:] = 0.0
        _, normals = self._draw.begin(world, x, noise_seed)
        status, k, found = drive_and_count(
            world.agents, world.vehicles, world.ego, *self._ego, net.w1, net.b1, net.w2, net.b2, world.head,
            net.action_scale, normals, self._dt_s, world.road.reference, world.road.lanes, world.road.spacing_m,
            world.beams, world.rays, world.observations, world.poses, world.minds, world.traits, tallies, contacts,
        )  # fmt: skip
        return status, k, contacts[:found]

    @property
    def agents(self) -> np.ndarray:
        """The state in which the last rollout ended."""
        return self._world.agents
