"""Data set aggregation (Ross et al. 2011): states that the networks themselves reach, for the expert to label."""

from collections.abc import Callable

import numpy as np

from policies.data.scenes import straight_lanes
from service.training.demonstrations import AGGREGATED, Rows
from service.training.world import (
    DT_S,
    T_ACTIVE,
    T_COLLISION,
    T_OFF_ROAD,
    T_TAKEN_OVER,
    Network,
    rollout,
    standard_starts,
)
from service.world.sim.road import Road, scene_road

WIDE_SHARE = 0.4  # of rollouts with harder starts than the scenario's
SYNTHETIC_SHARE = 0.25  # of rollouts on a winding road, so that the curves of I-80 are not all a driver knows
HEAD_NOISE_SD = (
    0.03  # half of the rollouts: heads moved by this, so that drivers of all xi find their way back
)

EGO_ROW = 2  # the scenario's ego drives in lane 3


def winding_road(rng: np.random.Generator, length_m: float = 1500.0) -> Road:
    """Six lanes of random curvature, radius 500 m or more."""
    station = np.arange(round(length_m) + 1, dtype=np.float64)
    waves = rng.uniform(250.0, 900.0, 3)
    curvature = sum(
        rng.uniform(0.0, 7e-4) * np.sin(2.0 * np.pi * station / wave + rng.uniform(0.0, 6.3))
        for wave in waves
    )
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]))])
    x, y = (
        np.concatenate([[0.0], np.cumsum(f(0.5 * (heading[1:] + heading[:-1])))]) for f in (np.cos, np.sin)
    )
    return scene_road(straight_lanes("winding", length_m, 6, 3.66, (x, y, heading, curvature)))


def _perhaps_moved(head: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The head, in half of the cases moved a little."""
    if rng.random() < 0.5:
        return head + rng.normal(0.0, HEAD_NOISE_SD, head.shape).astype(np.float32)
    return head


def visited(
    network: Network,
    road: Road,
    rollouts: int,
    rng: np.random.Generator,
    *,
    seconds: float = 60.0,
    every: int = 12,
) -> Rows:
    """Every `every`-th state of six drivers in each of `rollouts`; actions are left at 0 for the expert to fill in."""
    parts, numbers = [], []
    steps = round(seconds / DT_S)
    for number in range(rollouts):
        wide = rng.random() < WIDE_SHARE
        here = winding_road(rng) if rng.random() < SYNTHETIC_SHARE else road
        drivers = network._replace(head=_perhaps_moved(network.head, rng).astype(np.float32))
        noise = rng.standard_normal((steps, 6, 2))
        seen, trace, _ = rollout(standard_starts(rng, here, wide=wide), here, steps, drivers, noise)
        state = trace[: len(seen)]
        good = (state[..., T_ACTIVE] > 0) & (state[..., T_OFF_ROAD] + state[..., T_COLLISION] == 0)
        good &= state[..., T_TAKEN_OVER] == 0
        # dense at the start, where the starts' headings are corrected and where i80-paper-10s happens
        when = np.arange(len(seen)) + rng.integers(every)
        good &= ((when % every == 0) | ((when % 4 == 0) & (np.arange(len(seen)) < 100)))[:, None]
        time, vehicle = np.nonzero(good)
        parts.append(seen[time, vehicle].astype(np.float32))
        numbers.append(number * 6 + vehicle)
    return _aggregated(np.concatenate(parts), np.concatenate(numbers))


def visited_among(
    ego: Network,
    draw: Callable[[np.random.Generator], Network],
    road: Road,
    rollouts: int,
    rng: np.random.Generator,
    *,
    seconds: float = 12.0,
    every: int = 2,
) -> Rows:
    """States of an ego in the third lane among drivers drawn by `draw`; half of the egos' heads are moved a little."""
    parts, numbers = [], []
    steps = round(seconds / DT_S)
    for number in range(rollouts):
        head = _perhaps_moved(ego.head, rng)
        agents = standard_starts(rng, road, wide=rng.random() < WIDE_SHARE)
        noise = rng.standard_normal((steps, 6, 2))
        moved = ego._replace(head=head)
        seen, trace, _ = rollout(agents, road, steps, draw(rng), noise, ego=EGO_ROW, ego_network=moved)
        own = trace[: len(seen), EGO_ROW]
        good = (own[:, T_ACTIVE] > 0) & (own[:, T_OFF_ROAD] + own[:, T_COLLISION] == 0)
        pick = np.flatnonzero(good)[int(rng.integers(every)) :: every]
        parts.append(seen[pick, EGO_ROW].astype(np.float32))
        numbers.append(np.full(len(pick), number))
    return _aggregated(np.concatenate(parts), np.concatenate(numbers))


def _aggregated(seen: np.ndarray, trajectory: np.ndarray) -> Rows:
    """Rows without actions: the expert fills them in."""
    return Rows(
        seen,
        np.zeros((len(seen), 2), np.float32),
        np.full(len(seen), AGGREGATED, np.int8),
        trajectory.astype(np.int64),
        np.zeros(len(seen), bool),
    )
