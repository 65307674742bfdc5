"""The training loop of model-based GAIL: two networks, rollouts whose horizon grows, a checkpoint that resumes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from service.training import stored
from service.training.gail import (
    Discriminator,
    discriminator_loss,
    drive,
    reward_loss,
    safety_loss,
    trajectory_loss,
)
from service.training.network import ACTION_SCALE, NEVER_SET, DriverNet, negative_log_likelihood
from service.training.torch_world import CPU, State, state_of, torch_road
from service.training.windows import DRIVEN, Windows
from service.training.world import standard_starts
from service.world import agents as A
from service.world.sim.road import Road


@dataclass(frozen=True)
class GailSettings:
    """Numbers of the adversarial training; horizons in steps of 0.1 s, each for `updates` updates."""

    horizons: tuple[int, ...] = (10, 20, 50, 100)
    updates: int = 60
    windows: int = 12  # a batch
    road_starts: int = 8  # rollouts of six from the scenario's starts, a batch
    rows: int = 1024  # of the likelihood, and of each side of the discriminator
    rate: float = 1e-4  # of Adam, of the network
    discriminator_rate: float = 4e-4
    warm_up: int = 30  # updates of the discriminator alone
    reward: float = 0.3  # weights of the losses
    trajectory: float = 1.5
    safety: float = 6.0
    likelihood: float = 1.0


@dataclass(frozen=True)
class Sampled:
    """Rows to draw from in proportion to `share` (n,): seen (n, 51), actions and their noise (n, 2) in m/s^2, rad/s."""

    seen: np.ndarray
    action: np.ndarray
    sd: np.ndarray
    share: np.ndarray

    def draw(self, n: int, rng: np.random.Generator, device: torch.device = CPU) -> tuple[Tensor, Tensor]:
        """n observations and actions with their noise, on `device`."""
        pick = np.minimum(np.searchsorted(np.cumsum(self.share), rng.random(n)), len(self.share) - 1)
        action = self.action[pick] + self.sd[pick] * rng.standard_normal((n, 2))
        return torch.as_tensor(self.seen[pick]).to(device), torch.as_tensor(action, dtype=torch.float32).to(
            device
        )


@dataclass(frozen=True)
class _Checkpoint:
    """Where an interrupted training goes on: states of the networks and of their optimisers, records so far."""

    net: dict[str, Tensor]
    discriminator: dict[str, Tensor]
    generator_steps: dict[str, Any]
    discriminator_steps: dict[str, Any]
    curve: list[dict[str, Any]]


def train_adversarially(
    net: DriverNet,
    sites: Sequence[Windows],
    recorded: Sampled,
    anchor: Sampled,
    road: Road,
    settings: GailSettings,
    seed: int,
    *,
    checkpoint: Path | None = None,
    checkpoint_every: int = 25,
    tick: Callable[[dict], None] = lambda _: None,
) -> list[dict]:
    """Train `net` in place; returns the learning curve, one record an update.

    The training runs on the device that `net` lies on, which has to be that of `sites`.

    recorded: what the discriminator takes for real
    anchor: rows of the likelihood

    With a checkpoint's path an interrupted training goes on after its last checkpoint (one every `checkpoint_every`
    updates) to the same weights.
    """
    device = net.mean.device
    discriminator = Discriminator(net.mean.cpu(), net.scale.cpu()).to(device)
    generator_steps = torch.optim.Adam(net.parameters(), lr=settings.rate, betas=(0.5, 0.99))
    discriminator_steps = torch.optim.Adam(
        discriminator.parameters(), lr=settings.discriminator_rate, betas=(0.5, 0.99)
    )
    curve: list[dict] = []
    if checkpoint is not None and checkpoint.is_file():
        kept = stored.load(checkpoint, _Checkpoint)
        net.load_state_dict(kept.net)
        discriminator.load_state_dict(kept.discriminator)
        generator_steps.load_state_dict(kept.generator_steps)
        discriminator_steps.load_state_dict(kept.discriminator_steps)
        curve = kept.curve
    tables = torch_road(road, device=device)
    scale = torch.as_tensor(ACTION_SCALE, dtype=torch.float32, device=device)
    total = settings.warm_up + settings.updates * len(settings.horizons)
    for update in range(len(curve), total):
        rng = np.random.default_rng([seed, update])
        draws = torch.Generator().manual_seed(int(rng.integers(2**31)))
        warm = update < settings.warm_up
        steps = settings.horizons[0 if warm else (update - settings.warm_up) // settings.updates]
        site = sites[int(rng.integers(len(sites)))]
        starts = site.starts(steps)
        if len(starts) == 0:  # recordings too short for this horizon
            site = sites[0]
            starts = site.starts(steps)
        batch = site.batch(starts[rng.integers(len(starts), size=settings.windows)], steps)
        noise = torch.randn(steps, settings.windows, DRIVEN, 2, generator=draws).to(device)
        with torch.set_grad_enabled(not warm):
            driven = drive(net, batch.state, batch.road, noise, batch.used, batch.replay)
        seen, action = recorded.draw(settings.rows, rng, device)
        record: dict = {"update": update, "steps": steps}
        loss, record["told_recorded"], record["told_own"] = discriminator_loss(
            discriminator, driven, seen, action, settings.rows, draws
        )
        record["discriminator"] = float(loss.detach())
        discriminator_steps.zero_grad(set_to_none=True)
        loss.backward()
        discriminator_steps.step()
        if not warm:
            free = scenario_starts(rng, road, settings.road_starts, device)
            free_noise = torch.randn(steps, settings.road_starts, free.station.shape[1], 2, generator=draws)
            everybody = torch.ones(free.station.shape, device=device)
            on_road = drive(net, free, tables, free_noise.to(device), everybody)
            seen, action = anchor.draw(settings.rows, rng, device)
            scaled = action / scale
            terms = {
                "reward": reward_loss(discriminator, driven),
                "trajectory": trajectory_loss(driven, batch),
                "safety": 0.5 * (safety_loss(driven) + safety_loss(on_road)),
                "likelihood": negative_log_likelihood(net(seen), scaled),
            }
            total_loss = sum(getattr(settings, name) * term for name, term in terms.items())
            generator_steps.zero_grad(set_to_none=True)
            total_loss.backward()  # type: ignore[union-attr]
            norm = nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            if torch.isfinite(norm):
                generator_steps.step()
            with torch.no_grad():
                net.first.weight[:, NEVER_SET] = 0.0
            record |= {name: float(term.detach()) for name, term in terms.items()}
            record["gradient"] = float(norm)
            record["ended"] = float(1.0 - driven.alive[-1].sum() / batch.used.sum())
            record["ended_on_road"] = float(1.0 - on_road.alive[-1].mean())
        curve.append(record)
        tick(record)
        if checkpoint is not None and (len(curve) % checkpoint_every == 0 or len(curve) == total):
            states = _Checkpoint(
                net.state_dict(),
                discriminator.state_dict(),
                generator_steps.state_dict(),
                discriminator_steps.state_dict(),
                curve,
            )
            stored.save(checkpoint, states)
    return curve


def scenario_starts(rng: np.random.Generator, road: Road, rollouts: int, device: torch.device = CPU) -> State:
    """Six vehicles from the scenario's starts, in half of the rollouts from wider ones."""
    agents = np.stack([standard_starts(rng, road, wide=bool(i % 2)) for i in range(rollouts)])
    columns = (A.X_M, A.Y_M, A.HEADING_RAD, A.SPEED_MPS, A.LENGTH_M, A.WIDTH_M)
    present = np.ones(agents.shape[:2], dtype=bool)
    return state_of(agents[..., columns], present, agents[..., A.STATION].astype(np.int64), device=device)
