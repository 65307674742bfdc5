"""Train the human-driver model by model-based adversarial imitation, with lane changes.

    tailroad train drivers --data DIR --out DIR --seed 1

DIR of --data is the data pack's folder or one of imported tables. Written to --out: drivers-gail.safetensors with its
card drivers-gail.json. Half an hour on one core; an interrupted run continues after its last finished stage, and within
the adversarial training after its last checkpoint, when started again with the same arguments.

The stages, in order: rows from the recordings; the expert with lane changes fitted; a network cloned from both, with
aggregation; adversarial training through the differentiable world; the last layer trained again on resampled drivers;
the distribution of its weights; metrics.
"""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import Progress

from policies.data.recordings import load_recordings
from policies.drivers import save_drivers
from service.training import metrics
from service.training.adversary import GailSettings, Rows, train_adversarially
from service.training.demonstrations import held_out_vehicles
from service.training.device import described, device_of
from service.training.drivers import (
    Stages,
    command,
    data_card,
    measure,
    mixture,
    parse,
    public,
    rows_of,
    train_members,
    train_trunk,
    versions,
    xi_effects,
)
from service.training.ensemble import describe
from service.training.expert import evidence, fit, noise_sd
from service.training.head_spread import Spread, spreads
from service.training.lane_changes import ChangingExpert
from service.training.network import ACTION_SCALE, exported
from service.training.windows import Windows
from service.training.world import Network
from service.world.sim.road import i80_road


@dataclass(frozen=True)
class Arguments:
    """Every argument of the training; the defaults made the shipped weights."""

    data: Path  # the data pack's folder, or one of imported tables
    out: Path  # where the weights and their card go
    seed: int = 1
    rounds: int = 4  # of aggregation
    rollouts: int = 250  # of six drivers, in each round
    visit_seconds: float = 30.0  # of each of them: neighbours are together at the start
    visit_every: int = 8  # steps between the states taken
    first_steps: int = 1500  # of AdamW on the recordings alone, before the first round
    round_steps: int = 1500  # in each round
    final_steps: int = 11_000  # on all rows
    dropout: float = 0.0
    decay: float = 0.05  # AdamW's weight decay
    batch: int = 1024
    recorded_share: float = 0.3  # of the rows in a batch
    perturbed_share: float = 0.15
    us101_weight: float = 2.0  # of a faster row relative to a slow one
    horizons: str = "20,50,100,200"  # of the adversarial training, in steps
    updates: int = 120  # for each horizon
    members: int = 24  # resamples of the last layer
    ridge: float = 3e-3  # pulls members to the common head where the data leave weights open
    member_rows: int = 40_000  # rows each resample is drawn from
    spread: str = "whitened"  # estimator of Sigma0 (service.training.head_spread)
    check_rollouts: int = 400  # for the metrics on the whole road
    threads: int = 1
    device: str = "cpu"  # auto, cpu or cuda (service.training.device); the shipped weights are a CPU's


def main() -> None:
    arguments = parse(Arguments, __doc__)
    began = time.time()

    # Randomness: everything below draws from these.
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    device = device_of(arguments.device)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence([arguments.seed, 4]).spawn(7)]
    rows_rng, visit_rng, train_rng, expert_rng, member_rng, xi_rng, check_rng = streams

    stages = Stages(arguments)
    with Progress() as progress:
        recordings = load_recordings(arguments.data)
        scenes = recordings.scenes
        recorded, perturbed = stages.get("rows", lambda: rows_of(scenes, rows_rng))
        found = evidence(recordings.following, scenes, [~held_out_vehicles(scene) for scene in scenes])
        expert = fit(found, ChangingExpert())
        road = i80_road()
        visits: dict[str, Any] = {
            "seconds": arguments.visit_seconds,
            "every": arguments.visit_every,
            "device": device,
        }
        cloned, aggregated = stages.get(
            "trunk",
            lambda: train_trunk(
                arguments, recorded, perturbed, expert, road, visit_rng, train_rng, progress, **visits
            ),
        )
        net, curve = stages.get(
            "gail",
            lambda: against(
                arguments,
                cloned,
                recordings,
                recorded,
                perturbed,
                aggregated,
                expert,
                stages,
                progress,
                device,
            ),
        )
        network = exported(net, aggregated.seen)
        experts, refitted, shapes, common = stages.get(
            "members",
            lambda: train_members(
                arguments,
                network,
                recorded,
                perturbed,
                aggregated,
                expert,
                found,
                expert_rng,
                member_rng,
                progress,
            ),
        )
        # what a resample changes in the last layer, around the adversarially trained one
        members = network.head.astype(np.float64) + (refitted - common)
        estimates = stages.get("spread", lambda: spreads(members, shapes))
        chosen = estimates[arguments.spread].distribution
        centre = network._replace(head=chosen.mean.astype(np.float32))
        driving = stages.get(
            "driving", lambda: how_they_drive(network, members, estimates, road, arguments.seed, progress)
        )
        root = np.linalg.cholesky(chosen.covariance)

        def draw(rng: np.random.Generator) -> Network:
            xi = chosen.mean + root @ rng.standard_normal(len(root))
            return network._replace(head=xi.astype(np.float32))

        measured = stages.get(
            "metrics",
            lambda: measure(
                arguments, draw, centre, road, recordings, recorded, aggregated, xi_rng, check_rng, progress
            ),
        )

    card = {
        "name": "drivers-gail",
        "what": "distribution of human drivers: network 51-200-100-4, last layer N(mu0, Sigma0)",
        "method": "model-based generative adversarial imitation through a differentiable world, from a network cloned "
        "from recordings and a fitted expert with lane changes (aggregation); last layer retrained on resamples",
        "command": command("service.training.drivers_gail", arguments),
        "seed": arguments.seed,
        "arguments": public(arguments),
        "data": data_card(arguments, recordings, recorded, perturbed, aggregated),
        "expert": {**expert.as_dict(), "resampled": [e.as_dict() for e in experts]},
        "learning_curve": thinned(curve),
        "action_scale": ACTION_SCALE.tolist(),
        "sigma0": {
            **describe(chosen),
            "members": len(members),
            "estimator": arguments.spread,
            "estimators": {name: _reported(one) for name, one in estimates.items()},
            "how_they_drive": driving,
            **xi_effects(network, members, chosen, recorded, aggregated),
        },
        "metrics": measured,
        "limits": LIMITS,
        "versions": versions(),
        "device": described(device),
    }
    arrays = {
        "w1": network.w1, "b1": network.b1, "w2": network.w2, "b2": network.b2,
        "mu0": chosen.mean, "sigma0": chosen.covariance, "action_scale": ACTION_SCALE,
    }  # fmt: skip
    path = save_drivers(arguments.out / "drivers-gail.safetensors", arrays, card)
    stages.clear()
    print(json.dumps({key: card[key] for key in ("metrics", "sigma0")}, indent=1))
    print(f"written: {path} and its card, after {time.time() - began:.0f} s")


LIMITS = [
    "Recorded drivers were seen at a mean of 6 m/s (I-80) and 13 m/s (US-101), in congestion. On the almost empty "
    "road of the i80 scenario most of what a driver does comes from the fitted expert's labels, not from recordings.",
    "A driver has no memory: a lane change starts when noise or the start's heading carries it over a threshold, and "
    "may be broken off. Why people change lanes (exits, ramps) is not modelled; left and right are alike.",
    "Vehicle sizes on I-80 are estimates; widths are assumed.",
    "Action noise is white at 10 Hz. Recorded turn rates are correlated over about a second; their noise was replaced "
    "by white noise of a spread that gives the recorded lane keeping and rate of lane changes.",
    "Sigma0 says how uncertain this fit is, not how different people are.",
    "Twenty beams: a vehicle further than about 14 m away in the next lane lies between two of them and is not seen.",
]


def against(arguments, net, recordings, recorded, perturbed, aggregated, expert, stages, progress, device):
    """The adversarially trained network and its learning curve."""
    learn = recorded.where(~recorded.held_out)
    sd = noise_sd(expert, learn.seen)
    sd[:, 0] = 0.0  # people's accelerations bring their own spread; their turn rates were smoothed
    even = np.full(len(learn), 1.0 / len(learn))
    real = Rows(learn.seen, learn.action.astype(np.float64), sd, even)
    seen, action, sd, weight = mixture(arguments, recorded, perturbed, aggregated, expert)
    anchor = Rows(seen, action, sd, weight / weight.sum())
    sites = [Windows(scenes, device=device) for scenes in recordings.sites.values()]
    horizons = tuple(int(word) for word in arguments.horizons.split(","))
    settings = GailSettings(horizons=horizons, updates=arguments.updates)
    task = progress.add_task(
        "adversarial training", total=settings.warm_up + len(horizons) * settings.updates
    )
    net = net.to(device)
    curve = train_adversarially(
        net, sites, real, anchor, i80_road(), settings, arguments.seed,
        checkpoint=stages.path("gail", ".pt"),
        tick=lambda record: progress.update(task, completed=record["update"] + 1),
    )  # fmt: skip
    progress.remove_task(task)
    return net.cpu(), curve


def how_they_drive(
    network: Network, members, estimates: dict[str, Spread], road, seed: int, progress
) -> dict:
    """Members and drivers drawn from each estimate on the whole road: the same starts and noise for all."""
    rollouts = 60

    def of(rng, pick) -> dict:
        task = progress.add_task("estimators", total=rollouts)
        found = metrics.whole_road(
            lambda r: network._replace(head=pick(r).astype(np.float32)), road, rollouts, rng,
            tick=lambda: progress.update(task, advance=1),
        )  # fmt: skip
        progress.remove_task(task)
        return found

    result = {"members": of(np.random.default_rng(seed), lambda r: members[r.integers(len(members))])}
    for name, one in estimates.items():
        root = np.linalg.cholesky(one.distribution.covariance)
        centre = one.distribution.mean
        result[name] = of(
            np.random.default_rng(seed), lambda r, c=centre, a=root: c + a @ r.standard_normal(len(c))
        )
    return result


def _reported(one: Spread) -> dict:
    return {
        **describe(one.distribution),
        "left_out_log_likelihood": {str(key): round(value, 2) for key, value in one.scores.items()},
        **one.report,
    }


def thinned(curve: list[dict], points: int = 60) -> list[dict]:
    """Means of the learning curve over `points` equal stretches."""
    result = []
    for part in np.array_split(np.arange(len(curve)), min(points, len(curve))):
        names = sorted(set().union(*(curve[i] for i in part)))
        rows = [curve[i] for i in part]
        means = {n: float(np.mean([r[n] for r in rows if n in r])) for n in names}
        result.append({n: round(value, 4) for n, value in means.items()})
    return result


if __name__ == "__main__":
    main()
