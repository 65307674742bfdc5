"""Train the human-driver model by behaviour cloning with noise injection and data set aggregation.

    tailroad train drivers-bc --data DIR --out DIR --seed 1

DIR of --data is the data pack's folder (its README tells where the recordings come from), or a folder of tables that
`tailroad data import` wrote. Written to --out:
drivers-bc.safetensors with its card drivers-bc.json. Minutes on one core; an interrupted run continues after its last
finished stage when started again with the same arguments.

The stages, in order: rows from the recordings; the expert fitted; the trunk trained in rounds, each on rows aggregated
with the network of the round before; the last layer trained again on resampled drivers; the distribution of its
weights; metrics.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.progress import Progress

from policies import layout as O
from policies.drivers import save_drivers
from service.training.cloning import DriverArguments, train_trunk
from service.training.demonstrations import Rows
from service.training.device import described
from service.training.driver_figures import ESTIMATED_SIZES, SEEN_IN_CONGESTION, measure, origin, xi_effects
from service.training.ensemble import describe, head_distribution
from service.training.expert import fit
from service.training.members import Members, train_members
from service.training.network import ACTION_SCALE, DriverNet, exported
from service.training.run import begin, recorded_people, versions
from service.training.world import drawn_from, weights_of
from service.world.sim.road import i80_road

FLAGS = (O.LANE_TO_THE_LEFT, O.LANE_TO_THE_RIGHT, O.INCIDENT)  # a lane keeper needs to know none of them


@dataclass(frozen=True)
class Arguments(DriverArguments):
    """Every argument of the training; the defaults made the shipped weights."""

    rounds: int = 5
    rollouts: int = 150
    round_steps: int = 1200
    final_steps: int = 4000
    dropout: float = 0.2
    decay: float = 0.1
    recorded_share: float = 0.4
    perturbed_share: float = 0.2
    check_rollouts: int = 1000


def main() -> None:
    run = begin("drivers-bc", Arguments, __doc__)
    arguments, stages = run.arguments, run.stages
    rows_rng, visit_rng, train_rng, expert_rng, member_rng, xi_rng, check_rng = run.generators(7)

    with Progress() as progress:
        people = recorded_people(arguments.data, stages, rows_rng)
        expert = fit(people.evidence)
        road = i80_road()

        net, aggregated = stages.get(
            "trunk",
            tuple[DriverNet, Rows],
            lambda: train_trunk(
                arguments,
                people,
                expert,
                road,
                visit_rng,
                train_rng,
                progress,
                unused=FLAGS,
                device=run.device,
            ),
        )
        network = exported(net, aggregated.seen)
        resampled = partial(
            train_members, arguments, network, people, aggregated, expert, expert_rng, member_rng, progress
        )
        members = stages.get("members", Members, resampled)
        distribution, scores = head_distribution(members.heads, members.shapes)
        draw = drawn_from(network, distribution.mean, distribution.covariance)
        centre = network._replace(head=distribution.mean.astype(np.float32))
        measured = measure(arguments.check_rollouts, draw, centre, road, people, xi_rng, check_rng, progress)

    card = {
        **origin(
            run,
            "drivers-bc",
            "behaviour cloning (Gaussian likelihood), noise injection, data set aggregation with a fitted "
            "expert; last layer retrained on resampled drivers",
            people,
            aggregated,
            expert,
            members,
        ),
        "action_scale": ACTION_SCALE.tolist(),
        "sigma0": {
            **describe(distribution),
            "members": len(members.heads),
            "cross_validated_log_likelihood": {str(a): round(s, 2) for a, s in scores.items()},
            **xi_effects(
                network, members.heads, distribution, {"recorded": people.rows, "aggregated": aggregated}
            ),
        },
        "metrics": measured,
        "limits": LIMITS,
        "versions": versions(),
        "device": described(run.device),
        "training_s": run.elapsed_s(),
    }
    arrays = weights_of(network, distribution.mean, distribution.covariance)
    path = save_drivers(arguments.out / "drivers-bc.safetensors", arrays, card)
    run.finish(path, card, ("metrics", "sigma0"))


LIMITS = [
    SEEN_IN_CONGESTION,
    ESTIMATED_SIZES,
    "Action noise is white at 10 Hz. Recorded turn rates are correlated over about a second; their noise was replaced "
    "by the white noise that gives the same spread across the lane, so open-loop likelihoods suffer.",
    "The resampled heads include resampled experts. They know nothing of kinds of drivers that 15 minutes on two roads "
    "do not show: Sigma0 says how uncertain this fit is, not how different people are.",
    "Lane changes are hardly learned: without intentions in the observation they look like noise.",
]


if __name__ == "__main__":
    main()
