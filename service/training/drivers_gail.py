"""Train the human-driver model by model-based adversarial imitation, with lane changes.

    tailroad train drivers --data DIR --out DIR --seed 1

DIR of --data is the data pack's folder or one of imported tables. Written to --out: drivers-gail.safetensors with its
card drivers-gail.json. Half an hour on one core; an interrupted run continues after its last finished stage, and within
the adversarial training after its last checkpoint, when started again with the same arguments.

The stages, in order: rows from the recordings; the expert with lane changes fitted; a network cloned from both, with
aggregation; adversarial training through the differentiable world; the last layer trained again on resampled drivers;
the distribution of its weights; metrics.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from rich.progress import Progress

from policies.drivers import save_drivers
from service.training import metrics
from service.training.adversary import GailSettings, Sampled, train_adversarially
from service.training.cloning import DriverArguments, Visits, mixture, train_trunk
from service.training.demonstrations import Rows
from service.training.device import described
from service.training.driver_figures import ESTIMATED_SIZES, SEEN_IN_CONGESTION, measure, origin, xi_effects
from service.training.ensemble import describe
from service.training.expert import Expert, fit, noise_sd
from service.training.head_spread import Spread, spreads
from service.training.lane_changes import ChangingExpert
from service.training.members import Members, train_members
from service.training.network import ACTION_SCALE, DriverNet, exported
from service.training.run import People, Stages, begin, recorded_people, ticks, versions
from service.training.windows import Windows
from service.training.world import Network, drawn_from, weights_of
from service.world.sim.road import Road, i80_road


@dataclass(frozen=True)
class Arguments(DriverArguments):
    """Every argument of the training; the defaults made the shipped weights."""

    rounds: int = 4
    rollouts: int = 250
    visit_seconds: float = 30.0  # of each of them: neighbours are together at the start
    visit_every: int = 8  # steps between the states taken
    round_steps: int = 1500
    final_steps: int = 11_000
    dropout: float = 0.0
    decay: float = 0.05
    recorded_share: float = 0.3
    perturbed_share: float = 0.15
    horizons: str = "20,50,100,200"  # of the adversarial training, in steps
    updates: int = 120  # for each horizon
    spread: str = "whitened"  # estimator of Sigma0 (service.training.head_spread)
    check_rollouts: int = 400


def main() -> None:
    run = begin("drivers", Arguments, __doc__, seed_key=(4,))
    arguments, stages, device = run.arguments, run.stages, run.device
    rows_rng, visit_rng, train_rng, expert_rng, member_rng, xi_rng, check_rng = run.generators(7)

    with Progress() as progress:
        people = recorded_people(arguments.data, stages, rows_rng)
        expert = fit(people.evidence, ChangingExpert())
        road = i80_road()
        visits = Visits(arguments.visit_seconds, arguments.visit_every)
        cloned, aggregated = stages.get(
            "trunk",
            tuple[DriverNet, Rows],
            lambda: train_trunk(
                arguments, people, expert, road, visit_rng, train_rng, progress, visits=visits, device=device
            ),
        )
        net, curve = stages.get(
            "gail",
            tuple[DriverNet, list[dict[str, Any]]],
            lambda: against(arguments, cloned, people, aggregated, expert, stages, progress, device),
        )
        network = exported(net, aggregated.seen)
        resampled = partial(
            train_members, arguments, network, people, aggregated, expert, expert_rng, member_rng, progress
        )
        members = stages.get("members", Members, resampled)
        # what a resample changes in the last layer, around the adversarially trained one
        heads = network.head.astype(np.float64) + (members.heads - members.common)
        estimates = stages.get("spread", dict[str, Spread], lambda: spreads(heads, members.shapes))
        chosen = estimates[arguments.spread].distribution
        centre = network._replace(head=chosen.mean.astype(np.float32))
        driving = stages.get(
            "driving",
            dict[str, Any],
            lambda: how_they_drive(network, heads, estimates, road, arguments.seed, progress),
        )
        draw = drawn_from(network, chosen.mean, chosen.covariance)
        measured = stages.get(
            "metrics",
            dict[str, Any],
            lambda: measure(
                arguments.check_rollouts, draw, centre, road, people, xi_rng, check_rng, progress
            ),
        )

    card = {
        **origin(
            run,
            "drivers-gail",
            "model-based generative adversarial imitation through a differentiable world, from a network cloned "
            "from recordings and a fitted expert with lane changes (aggregation); last layer retrained on resamples",
            people,
            aggregated,
            expert,
            members,
        ),
        "learning_curve": thinned(curve),
        "action_scale": ACTION_SCALE.tolist(),
        "sigma0": {
            **describe(chosen),
            "members": len(heads),
            "estimator": arguments.spread,
            "estimators": {name: _reported(one) for name, one in estimates.items()},
            "how_they_drive": driving,
            **xi_effects(network, heads, chosen, {"recorded": people.rows, "aggregated": aggregated}),
        },
        "metrics": measured,
        "limits": LIMITS,
        "versions": versions(),
        "device": described(device),
    }
    arrays = weights_of(network, chosen.mean, chosen.covariance)
    path = save_drivers(arguments.out / "drivers-gail.safetensors", arrays, card)
    run.finish(path, card, ("metrics", "sigma0"))


LIMITS = [
    SEEN_IN_CONGESTION,
    "A driver has no memory: a lane change starts when noise or the start's heading carries it over a threshold, and "
    "may be broken off. Why people change lanes (exits, ramps) is not modelled; left and right are alike.",
    ESTIMATED_SIZES,
    "Action noise is white at 10 Hz. Recorded turn rates are correlated over about a second; their noise was replaced "
    "by white noise of a spread that gives the recorded lane keeping and rate of lane changes.",
    "Sigma0 says how uncertain this fit is, not how different people are.",
    "Twenty beams: a vehicle further than about 14 m away in the next lane lies between two of them and is not seen.",
]


def against(
    arguments: Arguments,
    net: DriverNet,
    people: People,
    aggregated: Rows,
    expert: Expert,
    stages: Stages,
    progress: Progress,
    device: torch.device,
) -> tuple[DriverNet, list[dict[str, Any]]]:
    """The adversarially trained network and its learning curve."""
    learn = people.learned_from()
    sd = noise_sd(expert, learn.seen)
    sd[:, 0] = 0.0  # people's accelerations bring their own spread; their turn rates were smoothed
    even = np.full(len(learn), 1.0 / len(learn))
    real = Sampled(learn.seen, learn.action.astype(np.float64), sd, even)
    rows = mixture(arguments, people, aggregated, expert)
    anchor = Sampled(rows.seen, rows.action, rows.sd, rows.weight / rows.weight.sum())
    sites = [Windows(scenes, device=device) for scenes in people.recordings.sites.values()]
    horizons = tuple(int(word) for word in arguments.horizons.split(","))
    settings = GailSettings(horizons=horizons, updates=arguments.updates)
    task = progress.add_task(
        "adversarial training", total=settings.warm_up + len(horizons) * settings.updates
    )
    net = net.to(device)
    curve = train_adversarially(
        net, sites, real, anchor, i80_road(), settings, arguments.seed,
        checkpoint=stages.path("gail", ".checkpoint"),
        tick=lambda record: progress.update(task, completed=record["update"] + 1),
    )  # fmt: skip
    progress.remove_task(task)
    return net.cpu(), curve


def how_they_drive(
    network: Network,
    members: np.ndarray,
    estimates: dict[str, Spread],
    road: Road,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Members and drivers drawn from each estimate on the whole road: the same starts and noise for all."""
    rollouts = 60

    def of(draw: Callable[[np.random.Generator], Network]) -> dict[str, Any]:
        with ticks(progress, "estimators", rollouts) as tick:
            return metrics.whole_road(draw, road, rollouts, np.random.default_rng(seed), tick=tick)

    def of_members(rng: np.random.Generator) -> Network:
        return network._replace(head=members[rng.integers(len(members))].astype(np.float32))

    result = {"members": of(of_members)}
    for name, one in estimates.items():
        result[name] = of(drawn_from(network, one.distribution.mean, one.distribution.covariance))
    return result


def _reported(one: Spread) -> dict[str, Any]:
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
