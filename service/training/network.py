"""The driver network in torch, and its regression on rows of observations and actions."""

import copy

import numpy as np
import torch
from rich.progress import Progress
from torch import Tensor, nn
from torch.nn import functional as F

from policies import layout as O
from service.training.world import Network

ACTION_SCALE = np.array([1.0, 0.05])  # m/s^2, rad/s: about the spread of a driver's actions
UNSCALED = slice(O.LANE_TO_THE_LEFT, O.INCIDENT + 1)  # flags are 0 or 1 as they are
NEVER_SET = O.INCIDENT  # nobody that is driven by a network has had one: nothing to learn from
LOG_STD_FLOOR = -2.3  # no driver is more certain than 0.1 m/s^2 and 0.005 rad/s


class DriverNet(nn.Module):
    """51 -> 200 -> 100 -> 4 with ReLU; inputs are standardised inside, by mean and spread (51,)."""

    mean: Tensor
    scale: Tensor

    def __init__(self, mean: np.ndarray, spread: np.ndarray, unused: tuple[int, ...] = (NEVER_SET,)):
        """Begin with random weights.

        mean, spread: (51,), of the inputs
        unused: inputs that the network does not see
        """
        super().__init__()
        self.register_buffer("mean", torch.as_tensor(mean, dtype=torch.float32))
        self.register_buffer("scale", torch.as_tensor(1.0 / spread, dtype=torch.float32))
        self.scale[list(unused)] = 0.0
        self.first = nn.Linear(O.OBSERVATION_SIZE, O.HIDDEN_1)
        self.second = nn.Linear(O.HIDDEN_1, O.HIDDEN_2)
        self.head = nn.Linear(O.HIDDEN_2, O.OUTPUTS)
        with torch.no_grad():
            self.first.weight[:, list(unused)] = 0.0
            self.head.weight *= 0.1
            self.head.bias[2:] = -1.0

    def features(self, seen: Tensor, dropout: float = 0.0) -> Tensor:
        x = (seen - self.mean) * self.scale
        x = F.dropout(torch.relu(self.first(x)), dropout, training=dropout > 0.0)
        return F.dropout(torch.relu(self.second(x)), dropout, training=dropout > 0.0)

    def forward(self, seen: Tensor, dropout: float = 0.0) -> Tensor:
        return self.head(self.features(seen, dropout))


def input_statistics(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and spread of each input; inputs that never change get spread 1."""
    mean, spread = seen.mean(axis=0, dtype=np.float64), seen.std(axis=0, dtype=np.float64)
    mean[UNSCALED], spread[UNSCALED] = 0.0, 1.0
    return mean, np.where(spread > 1e-9, spread, 1.0)


def negative_log_likelihood(outputs: Tensor, action: Tensor) -> Tensor:
    """Mean over rows of -log N(action; mean, std) per action dimension in scaled units, log std bounded."""
    mean, log_std = outputs[:, :2], outputs[:, 2:]
    bounded = log_std.clamp(LOG_STD_FLOOR, O.LOG_STD_MAX)
    z = (action - mean) * torch.exp(-bounded)
    outside = (log_std - bounded).square().sum(dim=1)  # pulls a log std back that has left its bounds
    nll = 0.5 * z.square().sum(dim=1) + bounded.sum(dim=1) + np.log(2.0 * np.pi)
    return (nll + outside).mean()


def train(
    net: DriverNet,
    seen: np.ndarray,
    action_mean: np.ndarray,
    action_sd: np.ndarray,
    weight: np.ndarray,
    steps: int,
    rng: np.random.Generator,
    *,
    batch: int = 1024,
    rate: float = 1e-3,
    decay: float = 0.1,
    dropout: float = 0.0,
    progress: Progress | None = None,
    label: str = "training",
    deterministic: bool = False,
) -> list[float]:
    """Fit `net` to rows drawn in proportion to `weight`; labels are action_mean plus white noise of action_sd.

    seen (n, 51), action_mean and action_sd (n, 2) in m/s^2 and rad/s; steps of AdamW with a cosine rate.
    `deterministic`: squared error of the mean instead of the likelihood (for an ego). The training runs on the device
    that `net` lies on. Returns the loss at every 50th step.
    """
    device = net.mean.device
    inputs, labels, spread = (
        torch.as_tensor(table, dtype=torch.float32).to(device)
        for table in (seen, action_mean / ACTION_SCALE, action_sd / ACTION_SCALE)
    )
    generator = torch.Generator().manual_seed(int(rng.integers(2**31)))
    optimizer = torch.optim.AdamW(net.parameters(), lr=rate, weight_decay=decay)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps, eta_min=rate * 0.02)
    share = np.cumsum(weight / weight.sum())
    task = progress.add_task(label, total=steps) if progress else None
    losses = []
    for step in range(steps):
        index = torch.as_tensor(np.minimum(np.searchsorted(share, rng.random(batch)), len(share) - 1)).to(
            device
        )
        white = torch.randn(batch, 2, generator=generator).to(device)
        target = labels[index] + spread[index] * white
        outputs = net(inputs[index], dropout)
        if deterministic:
            loss = (outputs[:, :2] - labels[index]).square().sum(dim=1).mean()
        else:
            loss = negative_log_likelihood(outputs, target)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 2.0)
        optimizer.step()
        schedule.step()
        with torch.no_grad():
            net.first.weight[:, NEVER_SET] = 0.0
        if step % 50 == 0:
            losses.append(float(loss.detach()))
        if progress and task is not None:
            progress.update(task, advance=1, description=f"{label} (loss {losses[-1]:.3f})")
    if progress and task is not None:
        progress.remove_task(task)
    return losses


@torch.no_grad()
def exported(net: DriverNet, seen: np.ndarray) -> Network:
    """The network with the standardisation folded into the first layer and hidden units scaled.

    ReLU units may be rescaled freely: each unit of the last hidden layer is divided by its root mean square over
    `seen` (n, 51) and its head weights multiplied by it, so that a change of 0.01 in any head weight means about the
    same, 0.01 of an action scale. Units that are off (almost) everywhere keep their scale.
    """
    net = on_cpu(net)
    activity = features_of(net, seen)
    level = np.sqrt(np.mean(np.square(activity, dtype=np.float64), axis=0))
    level = np.where(level > 1e-3, level, 1.0)
    scale = net.scale.double().numpy()
    w1 = net.first.weight.double().numpy().T * scale[:, None]
    b1 = net.first.bias.double().numpy() - net.mean.double().numpy() @ w1
    w2 = net.second.weight.double().numpy().T / level
    b2 = net.second.bias.double().numpy() / level
    head = np.vstack([net.head.weight.double().numpy().T * level[:, None], net.head.bias.double().numpy()])
    single = [np.ascontiguousarray(a, dtype=np.float32) for a in (w1, b1, w2, b2, head.reshape(-1))]
    return Network(single[0], single[1], single[2], single[3], single[4], ACTION_SCALE)


def on_cpu(net: DriverNet) -> DriverNet:
    """The network itself, or a copy where it lies on another device."""
    return net if net.mean.device.type == "cpu" else copy.deepcopy(net).cpu()


@torch.no_grad()
def features_of(net: DriverNet, seen: np.ndarray) -> np.ndarray:
    """Last hidden layer (n, 100) for observations (n, 51)."""
    parts = np.array_split(seen, 1 + len(seen) // 20_000)
    return np.concatenate([net.features(torch.as_tensor(part)).numpy() for part in parts])


def network_features(network: Network, seen: np.ndarray) -> np.ndarray:
    """Last hidden layer (n, 100) of an exported network, by numpy (for the regressions of the last layer)."""
    parts = []
    for part in np.array_split(seen.astype(np.float32), 1 + len(seen) // 20000):
        hidden = np.maximum(part @ network.w1 + network.b1, 0.0)
        parts.append(np.maximum(hidden @ network.w2 + network.b2, 0.0))
    return np.concatenate(parts)
