"""Where egos learn: drives of one vehicle among the drivers of a scenario, in our world without SUMO."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

import ce
from policies import layout as O
from policies.drivers import load_drivers
from policies.egos.compiled import NETWORK, NETWORK_WITH_EMERGENCY, act
from service.training.aggregation import HEAD_NOISE_SD
from service.training.demonstrations import AGGREGATED, Rows
from service.training.demonstrator import avoid, demonstrated
from service.training.expert import Expert
from service.training.metrics import rate
from service.training.world import Network
from service.world import agents as A
from service.world.safety.contact import contact_of
from service.world.scenario import load_scenario
from service.world.scenario.base import base_distribution
from service.world.scenario.check import check_road
from service.world.sim import step
from service.world.sim.road import road_of
from service.world.sim.rollout import Draw
from service.world.sim.world import World

Policy = Callable[[np.ndarray], tuple[float, float]]  # observation (51,) -> m/s^2 and rad/s


HARDER_SHARE = 0.5  # of the rollouts in which egos learn: a neighbour straddles the marking, or is about to
SWAY_SHARE, SWAY = 0.3, (0.5, 0.01)  # of the rollouts, with disturbed actions of so many m/s^2 and rad/s
EVERY = 2  # steps between the moments kept


@dataclass(frozen=True)
class Drive:
    """One rollout of the ego.

    status: how it ended (service.world.sim.step)
    km: driven
    seen: (n, 51) what the ego perceived at the moments kept
    avoidance: (n, 2) what the demonstrator's conflict avoidance asked for there
    at_fault: whether it brought about the contact that ended the drive, None where there was none
    """

    status: int
    km: float
    seen: np.ndarray
    avoidance: np.ndarray
    at_fault: bool | None


class Traffic:
    """Rollouts of a built-in or a user's scenario with any policy as its ego."""

    def __init__(self, scenario: str):
        self.scenario = load_scenario(scenario)
        drivers = load_drivers(self.scenario.drivers.weights)
        self.corridor = check_road(self.scenario, self.scenario.name)
        self.base = base_distribution(self.scenario, drivers)
        self._draw = Draw(self.scenario)
        self.world = World.of(self.scenario, road_of(self.corridor), drivers, rays=O.BEAMS)

    def draw(self, seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Draws x (count, d) from P0 and noise seeds (count,): those of naive Monte Carlo with that seed."""
        return ce.draw(self.base, seed, "estimate", 0, 0, count)

    def drive(
        self,
        policy: Policy,
        x: np.ndarray,
        noise_seed: int,
        *,
        every: int = 0,
        sway: np.ndarray | None = None,
    ) -> Drive:
        """Let `policy` drive the rollout of (x, noise seed).

        every: of every so many moments one is kept, 0: none
        sway: (steps, 2) disturbs its actions, m/s^2 and rad/s
        """
        world, ego = self.world, self.world.ego
        _, happens = self._draw.begin(world, x, noise_seed)
        me, spacing = world.agents[ego], world.road.spacing_m
        status, _ = world.observe()
        start_m = me[A.STATION] * spacing + me[A.ALONG_M]
        seen, avoidance = [], []
        for k in range(self.scenario.steps):
            if status != step.RUNNING:
                break
            if every and k % every == 0:
                seen.append(world.observations[ego].astype(np.float32))
                avoidance.append(avoid(world.agents[: world.vehicles], ego, spacing))
            a, w = policy(world.observations[ego])
            if sway is not None:
                a, w = a + sway[k, 0], w + sway[k, 1]
            world.advance(a, w, happens[k])
            status, _ = world.observe()
        km = float(me[A.STATION] * spacing + me[A.ALONG_M] - start_m) / 1000.0
        return Drive(
            status,
            km,
            np.array(seen, np.float32).reshape(-1, O.OBSERVATION_SIZE),
            np.array(avoidance).reshape(-1, 2),
            self._ran_into_it() if status == step.COLLIDED else None,
        )

    def harder(self, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The draw x with a vehicle of the next lane up to 10 m behind or 35 m ahead of the ego, up to 3 m/s faster or
        9 m/s slower, nearer to the ego's lane by up to 1.5 m and moving there at up to 0.7 m/s."""
        vehicles, ego = self.scenario.vehicles, self.scenario.vehicles[self.world.ego]
        beside = [v for v in vehicles if abs(v.lane - ego.lane) == 1]
        if not beside:
            return x
        other = beside[int(rng.integers(len(beside)))]
        towards = 1.0 if other.lane > ego.lane else -1.0  # lanes are numbered from the left
        names = list(self.base.names or ())
        changed = x.copy()
        speed = x[names.index(f"{ego.name}.speed_mps")]
        along = rng.uniform(-10.0, 35.0)
        other_speed = max(speed - rng.uniform(-3.0, 9.0), 2.0)
        nearer = (
            rng.uniform(0.0, 1.5) if along > 10.0 else rng.uniform(0.0, 0.8)
        )  # nobody starts inside another's box
        changed[names.index(f"{other.name}.station_m")] = x[names.index(f"{ego.name}.station_m")] + along
        changed[names.index(f"{other.name}.speed_mps")] = other_speed
        changed[names.index(f"{other.name}.lane_offset_m")] += towards * nearer
        across, offset = towards * rng.uniform(0.0, 0.7), changed[names.index(f"{other.name}.lane_offset_m")]
        if self.scenario.start.lateral_mps is None:
            changed[names.index(f"{other.name}.heading_deg")] = np.rad2deg(across / other_speed)
        else:  # what is drawn is the lateral speed in the lane's middle
            gain = 1.0 + self.scenario.start.lateral_offset_gain * offset**2
            changed[names.index(f"{other.name}.lateral_mps")] = across / gain
        return changed

    def visited(self, network: Network, expert: Expert, rollouts: int, rng: np.random.Generator) -> Rows:
        """Moments that the network reaches as ego, with the demonstrator's actions; half of the heads are moved."""
        parts, numbers = [], []
        steps = self.scenario.steps
        x, noise_seeds = self.draw(int(rng.integers(2**31)), rollouts)
        for number in range(rollouts):
            head = network.head
            if rng.random() < 0.5:
                head = head + rng.normal(0.0, HEAD_NOISE_SD, head.shape).astype(np.float32)
            start = self.harder(x[number], rng) if rng.random() < HARDER_SHARE else x[number]
            sway = rng.normal(0.0, SWAY, (steps, 2)) if rng.random() < SWAY_SHARE else None
            policy = policy_of(network._replace(head=head))
            drive = self.drive(policy, start, int(noise_seeds[number]), every=EVERY, sway=sway)
            good = drive.seen[:, O.INCIDENT] == 0.0
            parts.append((drive.seen[good], drive.avoidance[good]))
            numbers.append(np.full(int(good.sum()), number))
        seen, avoidance = (np.concatenate(column) for column in zip(*parts, strict=True))
        trajectory = np.concatenate(numbers)
        return Rows(
            seen,
            demonstrated(expert, seen, avoidance),
            np.full(len(seen), AGGREGATED, np.int8),
            trajectory,
            np.zeros(len(seen), bool),
        )

    def contacts(
        self, policy: Policy, rollouts: int, seed: int, tick: Callable[[], None] = lambda: None
    ) -> dict[str, Any]:
        """How often the ego touches another vehicle or leaves the road, and how often it brought the contact about."""
        x, noise_seeds = self.draw(seed, rollouts)
        km, faults, off = 0.0, [], 0
        for row, noise_seed in zip(x, noise_seeds.tolist(), strict=True):
            drive = self.drive(policy, row, noise_seed)
            km += drive.km
            off += drive.status == step.OFF_ROAD
            if drive.at_fault is not None:
                faults.append(drive.at_fault)
            tick()
        return {
            "scenario": self.scenario.name,
            "rollouts": rollouts,
            "km": round(km, 1),
            "contacts": rate(len(faults), km),
            "brought_about_by_the_ego": sum(faults),
            "left_the_road": off,
        }

    def _ran_into_it(self) -> bool:
        """Whether the ego is the striking vehicle of the contact that it is in."""
        contact = contact_of(self.world.agents, self.world.vehicles, self.world.ego)
        return contact is not None and contact.striking == "ego"


def policy_of(network: Network, emergency: bool = False) -> Policy:
    """Driving by the network's mean action, as the lidar ego does.

    emergency: with `policies.egos.emergency` beside
    """
    outputs = np.empty(O.OUTPUTS, np.float32)
    kind = NETWORK_WITH_EMERGENCY if emergency else NETWORK

    def answer(seen: np.ndarray) -> tuple[float, float]:
        return act(
            kind, seen, network.w1, network.b1, network.w2, network.b2, network.head, network.action_scale, outputs
        )  # fmt: skip

    return answer
