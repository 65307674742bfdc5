"""Cloning a driver network from people, people moved off their motion, and states that the network itself reaches."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from rich.progress import Progress

from service.training.aggregation import visited
from service.training.demonstrations import AGGREGATED, Rows, joined
from service.training.expert import Expert, mean_action, noise_sd
from service.training.network import NEVER_SET, DriverNet, exported, input_statistics, train
from service.training.run import People
from service.training.torch_world import CPU
from service.world.sim.road import Road

FAST_MPS = 9.0  # a recorded row above it is taken for one of US-101


@dataclass(frozen=True)
class DriverArguments:
    """What the trainings of drivers take."""

    data: Path  # the data pack's folder, or one of imported tables
    out: Path  # where the weights and their card go
    rounds: int  # of aggregation
    rollouts: int  # of six drivers, in each round
    round_steps: int  # in each round
    final_steps: int  # on all rows
    dropout: float  # of hidden units: 80 recorded drivers on I-80 are few
    decay: float  # AdamW's weight decay
    recorded_share: float  # of the rows in a batch, before faster rows are weighted up
    perturbed_share: float  # of the rows in a batch
    check_rollouts: int  # for the metrics on the whole road
    seed: int = 1
    first_steps: int = 1500  # of AdamW on the recordings alone, before the first round
    batch: int = 1024
    us101_weight: float = 2.0  # of a faster row relative to a slow one: faster traffic, fewer rows
    members: int = 24  # resamples of the last layer
    ridge: float = 3e-3  # pulls members to the common head where the data leave weights open
    member_rows: int = 40_000  # rows each resample is drawn from
    threads: int = 1
    device: str = "cpu"  # auto, cpu or cuda (service.training.device); the shipped weights are a CPU's

    def shares(self) -> tuple[float, float]:
        """Shares of recorded and of perturbed rows in a batch."""
        return self.recorded_share, self.perturbed_share


@dataclass(frozen=True)
class Mixture:
    """n training rows: seen (n, 51), mean labels and the labels' noise (n, 2) in m/s^2 and rad/s, and each row's
    weight (n,) in a batch."""

    seen: np.ndarray
    action: np.ndarray
    sd: np.ndarray
    weight: np.ndarray


def mixture(arguments: DriverArguments, people: People, aggregated: Rows | None, expert: Expert) -> Mixture:
    """Recorded, perturbed and, where there are any, aggregated rows, with their labels and shares."""
    parts = [people.learned_from(), people.perturbed] + ([aggregated] if aggregated is not None else [])
    shares = [*arguments.shares()]
    shares.append(1.0 - sum(shares))
    seen = np.concatenate([part.seen for part in parts])
    action = np.concatenate(
        [part.action if part.kind[0] != AGGREGATED else mean_action(expert, part.seen) for part in parts]
    )
    sd = noise_sd(expert, seen)
    from_people = np.concatenate([part.kind for part in parts]) != AGGREGATED
    sd[from_people, 0] = 0.0  # people's accelerations bring their own spread
    weight = []
    for part, share in zip(parts, shares, strict=False):
        fast = (
            np.where(part.seen[:, 2] > FAST_MPS, arguments.us101_weight, 1.0)
            if part.kind[0] != AGGREGATED
            else 1.0
        )
        w = np.ones(len(part)) * fast
        weight.append(w / w.sum() * share)
    return Mixture(seen, action, sd, np.concatenate(weight))


@dataclass(frozen=True)
class Visits:
    """What is taken from the rollouts of a round: every `every`-th state of `seconds`."""

    seconds: float = 60.0
    every: int = 12


def train_trunk(
    arguments: DriverArguments,
    people: People,
    expert: Expert,
    road: Road,
    visit_rng: np.random.Generator,
    train_rng: np.random.Generator,
    progress: Progress,
    *,
    unused: tuple[int, ...] = (NEVER_SET,),
    visits: Visits = Visits(),
    device: torch.device = CPU,
) -> tuple[DriverNet, Rows]:
    """The network trained on everything, and the aggregated rows."""
    wide = np.concatenate([people.learned_from().seen, people.perturbed.seen])

    def learn(net: DriverNet, aggregated: Rows | None, steps: int, label: str) -> np.ndarray:
        rows = mixture(arguments, people, aggregated, expert)
        train(
            net, rows.seen, rows.action, rows.sd, rows.weight, steps, train_rng, batch=arguments.batch,
            dropout=arguments.dropout, decay=arguments.decay, progress=progress, label=label,
        )  # fmt: skip
        return rows.seen

    aggregated = None
    net = DriverNet(*input_statistics(wide), unused).to(device)
    for turn in range(arguments.rounds + 1):
        steps = arguments.first_steps if turn == 0 else arguments.round_steps
        seen = learn(net, aggregated, steps, f"round {turn} of {arguments.rounds}")
        if turn < arguments.rounds:
            driven = exported(net, seen[-20000:])
            new = visited(
                driven, road, arguments.rollouts, visit_rng, seconds=visits.seconds, every=visits.every
            )
            aggregated = new if aggregated is None else joined([aggregated, new])
            if turn == 0:  # inputs of the scenario lie outside the recordings' range: standardise for both
                net = DriverNet(*input_statistics(np.concatenate([wide, new.seen])), unused).to(device)
    learn(net, aggregated, arguments.final_steps, "all rows")
    assert aggregated is not None  # there is a round
    return net.cpu(), aggregated
