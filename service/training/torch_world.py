"""The world in torch: many rollouts at once, differentiable from the last state back to every action and weight.

Geometry, dynamics, observation and lidar are those of the compiled kernels (service.world.sim,
service.world.sensors); a test compares them. What is discrete there (the nearest station, the lane, which vehicle a
beam hits) is decided here without a gradient; the values that follow from the choice are differentiated. Arrays are
(B, N): B rollouts of N vehicles, of which the first C are controlled; all on one road.

Two things of the simulation are left out, because training stops where they begin: vehicles are not taken over after an
incident, and none leaves the world at the road's end.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from policies import layout as O
from service.world.sim.projection import (
    REF_COS,
    REF_CURVATURE,
    REF_HEADING,
    REF_SIN,
    REF_X,
    REF_Y,
    ROAD_LEFT,
    ROAD_RIGHT,
)
from service.world.sim.road import Road

DT_S = 0.1
CPU = torch.device("cpu")
PARALLEL = 1e-12
REVERSING_SPEED_MPS = -0.1


class TorchRoad(NamedTuple):
    """A road's tables (service.world.sim.road) as tensors."""

    reference: Tensor  # (K, 8)
    lanes: Tensor  # (K, L, 2), NaN where a lane is absent
    spacing_m: float


@dataclass(frozen=True)
class State:
    """Vehicles (B, N): x, y (m), heading (rad), speed (m/s), length, width (m), present (bool), station (int)."""

    x: Tensor
    y: Tensor
    heading: Tensor
    speed: Tensor
    length: Tensor
    width: Tensor
    present: Tensor
    station: Tensor  # (B, C): of the controlled vehicles' nearest station, a hint that `locate` updates


class Place(NamedTuple):
    """Where the controlled vehicles are on the road, each (B, C); see service.world.sim.projection."""

    station: Tensor
    along: Tensor
    offset: Tensor
    lane: Tensor
    lane_offset: Tensor
    left_marking: Tensor
    right_marking: Tensor
    curvature: Tensor
    lane_heading: Tensor
    off_road: Tensor  # bool
    left_lane: Tensor  # 0 or 1
    right_lane: Tensor
    to_left_edge: Tensor  # from the vehicle's centre to the outermost marking, m; negative off the road
    to_right_edge: Tensor


def state_of(
    values: np.ndarray,
    present: np.ndarray,
    station: np.ndarray,
    dtype: torch.dtype = torch.float32,
    device: torch.device = CPU,
) -> State:
    """Vehicles (B, N) from values (B, N, 6): x, y, heading, speed, length, width; see State."""
    x, y, heading, speed, length, width = torch.as_tensor(values, dtype=dtype).to(device).unbind(dim=-1)
    there, near = torch.as_tensor(present).to(device), torch.as_tensor(station).to(device)
    return State(x, y, heading, speed, length, width, there, near)


def torch_road(road: Road, dtype: torch.dtype = torch.float32, device: torch.device = CPU) -> TorchRoad:
    """The tensors of a road."""
    reference, lanes = (
        torch.as_tensor(table, dtype=dtype).to(device) for table in (road.reference, road.lanes)
    )
    return TorchRoad(reference, lanes, road.spacing_m)


def locate(state: State, road: TorchRoad) -> Place:
    """Stations, lanes and offsets of the controlled vehicles."""
    controlled = state.station.shape[1]
    x, y, heading = state.x[:, :controlled], state.y[:, :controlled], state.heading[:, :controlled]
    k = _nearest_station(x.detach(), y.detach(), state.station, road)
    row = road.reference[k]
    along, offset = _along_offset(x, y, row)
    last = len(road.reference) - 1
    other = torch.where(along >= 0.0, (k + 1).clamp(max=last), (k - 1).clamp(min=0))
    share = (along.abs() / road.spacing_m).clamp(max=1.0)[..., None]
    here, there = road.lanes[k, :, :2], road.lanes[other, :, :2]  # (B, C, L, 2)
    step = torch.nan_to_num(there - here)  # a lane that ends at the neighbour keeps its boundaries
    edge = here + share[..., None] * step
    slope = 0.5 * step.sum(dim=-1) / torch.where(other > k, road.spacing_m, -road.spacing_m)[..., None]
    with torch.no_grad():
        distance = torch.maximum(offset[..., None] - edge[..., 0], edge[..., 1] - offset[..., None])
        lane = torch.nan_to_num(distance, nan=math.inf).argmin(dim=-1)
    pick = lane[..., None]
    left, right = (edge[..., i].gather(-1, pick)[..., 0] for i in range(2))
    slope = slope.gather(-1, pick)[..., 0]
    ahead = (k + int(O.LANE_AHEAD_M / road.spacing_m)).clamp(max=last)
    invites = ~(torch.isnan(here[..., 0]) | torch.isnan(road.lanes[ahead][..., 0]))
    invites = torch.nn.functional.pad(invites & (road.lanes[k, :, 2] == 0.0), (1, 1))
    curvature = row[..., REF_CURVATURE]
    to_left, to_right = row[..., ROAD_LEFT] - offset, offset - row[..., ROAD_RIGHT]
    return Place(
        k,
        along,
        offset,
        lane,
        offset - 0.5 * (left + right),
        left - offset,
        offset - right,
        curvature / (1.0 - curvature * offset),
        heading - row[..., REF_HEADING] - along * curvature - slope,
        (to_left < 0.0) | (to_right < 0.0) | ((k == 0) & (along < -0.5 * road.spacing_m)),
        invites.gather(-1, pick)[..., 0].to(x.dtype),
        invites.gather(-1, pick + 2)[..., 0].to(x.dtype),
        to_left,
        to_right,
    )


def _along_offset(x: Tensor, y: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    dx, dy = x - row[..., REF_X], y - row[..., REF_Y]
    offset = dy * row[..., REF_COS] - dx * row[..., REF_SIN]
    ahead = dx * row[..., REF_COS] + dy * row[..., REF_SIN]
    return ahead / (1.0 - row[..., REF_CURVATURE] * offset), offset


def _nearest_station(x: Tensor, y: Tensor, station: Tensor, road: TorchRoad) -> Tensor:
    last, half = len(road.reference) - 1, 0.5 * road.spacing_m
    k, way = station, torch.zeros_like(station)
    while True:
        along, _ = _along_offset(x, y, road.reference[k])
        move = ((along > half) & (k < last) & (way >= 0)).long()
        move -= ((along < -half) & (k > 0) & (way <= 0)).long()
        if not move.any():
            return k
        k, way = k + move, torch.where(move != 0, move, way)


def lidar(state: State, controlled: int) -> tuple[Tensor, Tensor]:
    """Ranges (m) and range rates (m/s), each (B, C, BEAMS), of the controlled vehicles (service.world.sensors)."""
    angle = torch.arange(O.BEAMS, dtype=state.x.dtype, device=state.x.device) * (2.0 * math.pi / O.BEAMS)
    beam = torch.stack([torch.cos(angle), torch.sin(angle)])  # (2, BEAMS)
    cos, sin = torch.cos(state.heading), torch.sin(state.heading)
    with torch.no_grad():
        hit = _hits(state, cos, sin, controlled, beam)
        best, which = hit.min(dim=2)  # (B, C, BEAMS)
        seen = best < O.LIDAR_RANGE_M
        flat = which.reshape(len(which), -1)

    def of_hit(values: Tensor) -> Tensor:
        return values.gather(1, flat).reshape(which.shape)

    own = [v[:, :controlled, None] for v in (state.x, state.y, cos, sin, state.speed)]
    px, py = of_hit(state.x) - own[0], of_hit(state.y) - own[1]
    c, s, speed = of_hit(cos), of_hit(sin), of_hit(state.speed)
    distance = _ray_box(
        px, py, c, s, own[2], own[3], beam, 0.5 * of_hit(state.length), 0.5 * of_hit(state.width)
    )
    ux, uy = speed * c - own[4] * own[2], speed * s - own[4] * own[3]
    ahead, left = ux * own[2] + uy * own[3], uy * own[2] - ux * own[3]
    rate = ahead * beam[0] + left * beam[1]
    limit = torch.full_like(distance, O.LIDAR_RANGE_M)
    return torch.where(seen, distance, limit), torch.where(seen, rate, torch.zeros_like(rate))


def _ray_box(
    px: Tensor, py: Tensor, c: Tensor, s: Tensor, own_c: Tensor, own_s: Tensor, beam: Tensor, half_length: Tensor,
    half_width: Tensor,
) -> Tensor:  # fmt: skip
    """Distance along each beam to a box, inf where it misses; the sizes broadcast against px."""
    cosine, sine = own_c * c + own_s * s, own_s * c - own_c * s
    dx, dy = beam[0] * cosine - beam[1] * sine, beam[0] * sine + beam[1] * cosine
    cx, cy = px * c + py * s, py * c - px * s
    near_x, far_x = _slab(dx, cx, half_length)
    near_y, far_y = _slab(dy, cy, half_width)
    near = torch.maximum(near_x, near_y).clamp(min=0.0)
    return torch.where(near > torch.minimum(far_x, far_y), torch.inf, near)


def _slab(d: Tensor, centre: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
    flat = d.abs() < PARALLEL
    safe = torch.where(flat, PARALLEL, d)
    middle, reach = centre / safe, (half / safe).abs()
    return middle - reach, middle + reach


def _hits(state: State, cos: Tensor, sin: Tensor, controlled: int, beam: Tensor) -> Tensor:
    """Distances (B, C, N, BEAMS), inf for absent vehicles and for itself."""
    px = state.x[:, None, :] - state.x[:, :controlled, None]
    py = state.y[:, None, :] - state.y[:, :controlled, None]
    sizes = (0.5 * state.length[:, None, :, None], 0.5 * state.width[:, None, :, None])
    hit = _ray_box(
        px[..., None], py[..., None], cos[:, None, :, None], sin[:, None, :, None],
        cos[:, :controlled, None, None], sin[:, :controlled, None, None], beam, *sizes,
    )  # fmt: skip
    own = torch.eye(controlled, state.x.shape[1], dtype=torch.bool, device=state.x.device)
    hidden = own | ~state.present[:, None, :]
    return hit.masked_fill_(hidden[..., None], torch.inf)


def overlaps(state: State, controlled: int) -> Tensor:
    """(B, C) bool: whose box overlaps or touches another's (separating axes, see service.world.sim.collision)."""
    cos, sin = torch.cos(state.heading), torch.sin(state.heading)
    dx = state.x[:, None, :] - state.x[:, :controlled, None]
    dy = state.y[:, None, :] - state.y[:, :controlled, None]
    ca, sa = cos[:, :controlled, None], sin[:, :controlled, None]
    cb, sb = cos[:, None, :], sin[:, None, :]
    la, wa = (0.5 * size[:, :controlled, None] for size in (state.length, state.width))
    lb, wb = (0.5 * size[:, None, :] for size in (state.length, state.width))
    cosine, sine = (ca * cb + sa * sb).abs(), (ca * sb - sa * cb).abs()
    touch = (dx * ca + dy * sa).abs() <= la + lb * cosine + wb * sine
    touch &= (dy * ca - dx * sa).abs() <= wa + lb * sine + wb * cosine
    touch &= (dx * cb + dy * sb).abs() <= lb + la * cosine + wa * sine
    touch &= (dy * cb - dx * sb).abs() <= wb + la * sine + wa * cosine
    own = torch.eye(controlled, state.x.shape[1], dtype=torch.bool, device=state.x.device)
    return (touch & ~own & state.present[:, None, :]).any(dim=-1)


def observe(state: State, road: TorchRoad) -> tuple[Tensor, Place, Tensor]:
    """Observations (B, C, 51) as in policies.layout, the places, and who collides (B, C)."""
    place = locate(state, road)
    controlled = place.station.shape[1]
    ranges, rates = lidar(state, controlled)
    with torch.no_grad():
        hit = overlaps(state, controlled)
        speed = state.speed[:, :controlled]
        incident = (hit | place.off_road | (speed < REVERSING_SPEED_MPS)).to(speed.dtype)
    first = [
        place.lane_offset, place.lane_heading, state.speed[:, :controlled], state.length[:, :controlled],
        state.width[:, :controlled], place.curvature, place.left_marking, place.right_marking,
        place.left_lane, place.right_lane, incident,
    ]  # fmt: skip
    return torch.cat([torch.stack(first, dim=-1), ranges, rates], dim=-1), place, hit


def advance(state: State, place: Place, action: Tensor, others: Tensor | None = None) -> State:
    """The state a step later: `action` (B, C, 2) in m/s^2 and rad/s, clipped as in service.world.sim.dynamics.

    others: (B, N - C, 4) x, y, heading and speed of the vehicles that are not controlled, NaN where absent; None
    leaves them where they are.
    """
    controlled = place.station.shape[1]
    x, y, heading, speed = (v[:, :controlled] for v in (state.x, state.y, state.heading, state.speed))
    a = action[..., 0].clamp(-O.MAX_DECELERATION_MPS2, O.MAX_ACCELERATION_MPS2)
    sharpest = (speed.abs() / O.MIN_TURN_RADIUS_M).clamp(max=O.MAX_TURN_RATE_RADPS)
    w = torch.minimum(torch.maximum(action[..., 1], -sharpest), sharpest)
    faster = (speed + a * DT_S).clamp(min=0.0)
    course = heading + 0.5 * w * DT_S
    distance = 0.5 * (speed + faster) * DT_S
    new = [
        x + distance * torch.cos(course), y + distance * torch.sin(course), heading + w * DT_S, faster,
    ]  # fmt: skip
    rest = [v[:, controlled:] for v in (state.x, state.y, state.heading, state.speed)]
    present = state.present
    if others is not None:
        there = ~torch.isnan(others[..., 0])
        rest = [torch.where(there, others[..., i], rest[i]) for i in range(4)]
        present = torch.cat([present[:, :controlled], there], dim=1)
    moved = [torch.cat(pair, dim=1) for pair in zip(new, rest, strict=True)]
    return replace(
        state,
        x=moved[0],
        y=moved[1],
        heading=moved[2],
        speed=moved[3],
        present=present,
        station=place.station,
    )
