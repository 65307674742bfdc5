"""Members of the driver model: experts and last layers, each from a resample of the recorded drivers."""

from dataclasses import dataclass

import numpy as np
from rich.progress import Progress

from service.training.cloning import DriverArguments
from service.training.demonstrations import AGGREGATED, Rows
from service.training.ensemble import refit_head, sampling_covariances
from service.training.expert import Expert, fit, mean_action, noise_sd
from service.training.network import ACTION_SCALE, network_features
from service.training.run import People
from service.training.world import Network


@dataclass(frozen=True)
class Members:
    """What resampling gives.

    experts: their parameters, one dict a member
    heads: (members, 404)
    shapes: of the heads' covariance, 4 blocks of (101, 101)
    common: (404,) the head of all trajectories, not resampled
    """

    experts: list[dict[str, float]]
    heads: np.ndarray
    shapes: list[np.ndarray]
    common: np.ndarray


def train_members(
    arguments: DriverArguments,
    network: Network,
    people: People,
    aggregated: Rows,
    expert: Expert,
    expert_rng: np.random.Generator,
    member_rng: np.random.Generator,
    progress: Progress,
) -> Members:
    """Experts and heads, each from a resample of whole trajectories and of the expert's evidence."""
    parts = [people.learned_from(), people.perturbed, aggregated]
    shares = [*arguments.shares()]
    shares.append(1.0 - sum(shares))
    chosen = []
    for part, share in zip(parts, shares, strict=True):
        count = min(len(part), round(share * arguments.member_rows))
        chosen.append(part.where(np.sort(member_rng.choice(len(part), count, replace=False))))
    features = [network_features(network, part.seen) for part in chosen]
    white = [member_rng.standard_normal((len(part), 2)) for part in chosen]

    def labels(by: Expert) -> np.ndarray:
        found_labels = []
        for part, z in zip(chosen, white, strict=True):
            sd = noise_sd(by, part.seen)
            if part.kind[0] == AGGREGATED:
                found_labels.append(mean_action(by, part.seen) + sd * z)
            else:
                found_labels.append(part.action + sd * z * [0.0, 1.0])
        return np.concatenate(found_labels) / ACTION_SCALE

    everything = np.concatenate(features)
    base = np.concatenate([np.full(len(p), s / len(p)) for p, s in zip(chosen, shares, strict=True)])
    common = refit_head(everything, labels(expert), base, network.head.astype(np.float64), arguments.ridge)
    task = progress.add_task("resampled heads", total=arguments.members)
    experts, heads = [], []
    for _ in range(arguments.members):
        by = fit(people.evidence, expert, expert_rng)
        weight = resampled_weight(chosen, shares, member_rng)
        heads.append(refit_head(everything, labels(by), weight, common, arguments.ridge))
        experts.append(by.as_dict())
        progress.update(task, advance=1)
    progress.remove_task(task)
    shapes = sampling_covariances(everything, base, common, arguments.ridge)
    return Members(experts, np.array(heads), shapes, common)


def resampled_weight(chosen: list[Rows], shares: list[float], rng: np.random.Generator) -> np.ndarray:
    """Weights of the rows `chosen` under a bootstrap of trajectories; the parts keep their shares.

    Recorded and perturbed rows of a driver are resampled together.
    """
    weight = []
    drawn: dict[bool, np.ndarray] = {}
    for part, share in zip(chosen, shares, strict=True):
        visits = bool(part.kind[0] == AGGREGATED)
        if visits not in drawn:
            kin = [p for p in chosen if (p.kind[0] == AGGREGATED) == visits]
            top = int(max(p.trajectory.max() for p in kin)) + 1
            present = np.unique(part.trajectory)
            drawn[visits] = np.bincount(rng.choice(present, len(present)), minlength=top)
        w = drawn[visits][part.trajectory].astype(np.float64)
        weight.append(w / w.sum() * share)
    return np.concatenate(weight)
