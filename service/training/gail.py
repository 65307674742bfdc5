"""Model-based generative adversarial imitation (Baram et al. 2017) with shared weights (Bhattacharyya et al. 2018).

The discriminator tells recorded pairs of observation and action from those of the network's own rollouts; the network
is trained by the gradient of its reward, -log(1 - D), through the differentiable world, over horizons that grow. All
driven vehicles of a window share the weights. Three terms are added to the reward:

trajectory   distance in station, lateral offset and speed from what the same driver did in the recording. It uses what
             recorded windows know and a discriminator of single moments does not.
safety       overlap or near-overlap of boxes, closeness to the road's edge, braking beyond what people do. Also on the
             scenario's own road, from its starts, where there are no recordings to tell right from wrong.
likelihood   of the rows that behaviour cloning started from: recorded, perturbed and aggregated.

Gradients fade by FADING a step on their way back through the state, so that a choice between two lanes some seconds
later does not drown everything else.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.parametrizations import spectral_norm

from policies import layout as O
from service.training.network import ACTION_SCALE, LOG_STD_FLOOR, DriverNet
from service.training.torch_world import Place, State, TorchRoad, advance, observe
from service.training.windows import Batch

FADING = 0.98
GAIN = 5.0  # of the discriminator's logits: each spectrally normalised layer is 1-Lipschitz
NEAR_MISS_M = 0.4  # boxes closer than this are penalised
EDGE_M = 1.2  # a vehicle's centre closer than this to the road's edge is penalised
HARD_BRAKE_MPS2 = 2.5
ALONG_M, ALONG_MPS, ACROSS_M, SPEED_MPS = (
    1.0,
    0.5,
    0.7,
    1.5,
)  # errors that count as one: position's grows with time


class Discriminator(nn.Module):
    """53 -> 200 -> 100 -> 1: logits that a pair is recorded; inputs (n, 51) as observed and (n, 2) in m/s^2, rad/s."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: Tensor, scale: Tensor):
        super().__init__()
        self.register_buffer("mean", torch.cat([mean, torch.zeros(2)]))
        action = torch.as_tensor(1.0 / ACTION_SCALE, dtype=torch.float32)
        self.register_buffer("scale", torch.cat([scale, action]))
        self.layers = nn.Sequential(
            spectral_norm(nn.Linear(O.OBSERVATION_SIZE + 2, O.HIDDEN_1)),
            nn.LeakyReLU(0.2),
            spectral_norm(nn.Linear(O.HIDDEN_1, O.HIDDEN_2)),
            nn.LeakyReLU(0.2),
            spectral_norm(nn.Linear(O.HIDDEN_2, 1)),
        )

    def forward(self, seen: Tensor, action: Tensor) -> Tensor:
        x = (torch.cat([seen, action], dim=-1) - self.mean) * self.scale
        return GAIN * self.layers(x.clamp(-6.0, 6.0))[..., 0]


@dataclass(frozen=True)
class Driven:
    """A rollout of T steps: seen (T, B, C, 51), action (T, B, C, 2) in m/s^2 and rad/s, alive (T, B, C): 0 from an
    incident on; place, speed (T, B, C) and states after each step; near (T, B, C): how deep the own box is within
    NEAR_MISS_M of another's, in m."""

    seen: Tensor
    action: Tensor
    alive: Tensor
    station: Tensor
    offset: Tensor
    speed: Tensor
    near: Tensor
    edge: Tensor


def drive(
    policy: Callable[[Tensor], Tensor],
    state: State,
    road: TorchRoad,
    noise: Tensor,
    used: Tensor,
    replay: Tensor | None = None,
) -> Driven:
    """Drive for len(noise) steps with standard normals `noise` (T, B, C, 2); replay (T + 1, B, N - C, 4) or None."""
    scale = torch.as_tensor(ACTION_SCALE, dtype=noise.dtype, device=noise.device)
    alive = used.clone()
    kept: list[list[Tensor]] = [[] for _ in range(8)]
    seen, place, hit = observe(state, road)
    for t in range(len(noise)):
        alive = alive * (~(hit | place.off_road)).to(alive.dtype)
        outputs = policy(seen)
        spread = torch.exp(outputs[..., 2:].clamp(LOG_STD_FLOOR, O.LOG_STD_MAX))
        action = scale * (outputs[..., :2] + spread * noise[t])
        moved = advance(state, place, action, None if replay is None else replay[t + 1])
        state = replace(moved, **{k: _faded(getattr(moved, k)) for k in ("x", "y", "heading", "speed")})
        before = (seen, action, alive)
        seen, place, hit = observe(state, road)
        after = _progress(state, place, road)
        for store, value in zip(kept, (*before, *after), strict=True):
            store.append(value)
    return Driven(*(torch.stack(values) for values in kept))


def _faded(values: Tensor) -> Tensor:
    return FADING * values + (1.0 - FADING) * values.detach()


def _progress(state: State, place: Place, road: TorchRoad) -> tuple[Tensor, ...]:
    station = place.station * road.spacing_m + place.along
    edge = F.relu(EDGE_M - torch.minimum(place.to_left_edge, place.to_right_edge))
    controlled = place.station.shape[1]
    return station, place.offset, state.speed[:, :controlled], _nearness(state, controlled), edge


def _nearness(state: State, controlled: int) -> Tensor:
    """(B, C): how far the own box, NEAR_MISS_M wider all around, reaches into the nearest other one, in m."""
    cos, sin = torch.cos(state.heading[:, :controlled, None]), torch.sin(state.heading[:, :controlled, None])
    dx = state.x[:, None, :] - state.x[:, :controlled, None]
    dy = state.y[:, None, :] - state.y[:, :controlled, None]
    half_length = 0.5 * (state.length[:, None, :] + state.length[:, :controlled, None])
    half_width = 0.5 * (state.width[:, None, :] + state.width[:, :controlled, None])
    gap = torch.maximum((dx * cos + dy * sin).abs() - half_length, (dy * cos - dx * sin).abs() - half_width)
    own = torch.eye(controlled, state.x.shape[1], dtype=torch.bool, device=state.x.device)
    gap = gap.masked_fill(own | ~state.present[:, None, :], math.inf)
    return F.relu(NEAR_MISS_M - gap.min(dim=-1).values)


def reward_loss(discriminator: Discriminator, driven: Driven) -> Tensor:
    """Minus the mean reward -log(1 - D) of the moments before an incident."""
    reward = F.softplus(discriminator(driven.seen, driven.action))
    return -(reward * driven.alive).sum() / driven.alive.sum().clamp(min=1.0)


def trajectory_loss(driven: Driven, batch: Batch, dt_s: float = 0.1) -> Tensor:
    """Mean Huber distance from the recorded motion, in the units of the module's constants."""
    steps = len(driven.station)
    count = torch.arange(1, steps + 1, dtype=driven.station.dtype, device=driven.station.device)
    seconds = dt_s * count[:, None, None]
    along = (driven.station - batch.target[1 : steps + 1, ..., 0]) / (ALONG_M + ALONG_MPS * seconds)
    across = (driven.offset - batch.target[1 : steps + 1, ..., 1]) / ACROSS_M
    faster = (driven.speed - batch.target[1 : steps + 1, ..., 2]) / SPEED_MPS
    loss = sum(F.huber_loss(e, torch.zeros_like(e), reduction="none") for e in (along, across, faster))
    return (loss * driven.alive).sum() / driven.alive.sum().clamp(min=1.0)


def safety_loss(driven: Driven) -> Tensor:
    """Mean penalty for near-overlaps, closeness to the edge and hard braking."""
    braking = F.relu(-driven.action[..., 0] - HARD_BRAKE_MPS2)
    loss = (driven.near / NEAR_MISS_M) ** 2 + driven.edge**2 + 0.5 * braking**2
    return (loss * driven.alive).sum() / driven.alive.sum().clamp(min=1.0)


def discriminator_loss(
    discriminator: Discriminator,
    driven: Driven,
    seen: Tensor,
    action: Tensor,
    rows: int,
    generator: torch.Generator,
) -> tuple[Tensor, float, float]:
    """Cross entropy on recorded pairs (n, 51), (n, 2) and `rows` pairs of the rollout; shares told right of each."""
    alive = torch.nonzero(driven.alive.reshape(-1) > 0)[:, 0]
    pick = alive[torch.randint(len(alive), (rows,), generator=generator).to(alive.device)]
    own = discriminator(
        driven.seen.detach().reshape(-1, O.OBSERVATION_SIZE)[pick],
        driven.action.detach().reshape(-1, 2)[pick],
    )
    recorded = discriminator(seen, action)
    loss = F.softplus(-recorded).mean() + F.softplus(own).mean()
    return loss, float((recorded > 0).float().mean()), float((own < 0).float().mean())


def policy_of(net: DriverNet) -> Callable[[Tensor], Tensor]:
    """The network as `drive` wants it."""
    return lambda seen: net(seen)
