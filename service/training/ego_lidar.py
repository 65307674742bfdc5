"""Train the lidar ego: an imitation network on the same 51 values, driven by its mean action.

    tailroad train ego-lidar --data DIR --out DIR --seed 1

It learns from the same recordings as the drivers, lane changes left out, by squared error, and from states that it
reaches itself: on the I-80 road, alone with its like, and among the drivers of a scenario, half of the time with a
vehicle that straddles the marking or is about to. They are labelled by a demonstrator that keeps its lane,
gives way to a neighbour who comes too close, follows more carefully than the recorded average (CAREFUL below) and
avoids conflicts that it sees coming (service.training.demonstrator). What its lidar cannot tell apart it learns on
average; so braking and moving over in an emergency stand beside the network (policies.egos.emergency). Written to
--out: ego-NAME.safetensors with its card ego-NAME.json. Minutes on one core; an interrupted run continues after its
last finished stage.

The ego of the paper's scenarios learned from the careful part of that demonstrator alone:

    tailroad train ego-lidar --data DIR --out DIR --seed 1 --name lidar-paper --demonstrator careful --swerving 0 \
      --emergency 0 --scenario i80-paper-10s
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from rich.progress import Progress

from policies.drivers import load_drivers, save_drivers
from policies.layout import HEAD_SIZE, LANE_CURVATURE_PER_M, OUTPUTS, SPEED_MPS
from service.training import metrics
from service.training.aggregation import visited, visited_among
from service.training.demonstrations import AGGREGATED, Rows, joined
from service.training.demonstrator import is_attentive
from service.training.device import described
from service.training.driver_figures import HORIZONS_S, mean_errors
from service.training.expert import Expert, fit, lateral_speed, mean_action
from service.training.lane_changes import KeepingExpert
from service.training.network import ACTION_SCALE, DriverNet, exported, input_statistics, train
from service.training.run import People, begin, recorded_people, ticks, versions
from service.training.traffic import Traffic, policy_of
from service.training.world import Network, drawn_from, network_of, weights_of
from service.world.sim.road import Road, i80_road

# What the ego's expert does otherwise than the fitted average driver (Treiber and Kesting 2013, table 11.2: freeway).
CAREFUL = {
    "time_headway_s": 1.2,
    "comfort_mps2": 1.5,
    "acceleration_mps2": 1.0,
    "lateral_rate_per_s": 0.6,
}
# What the demonstrator did not teach.
SHOWN = {
    "careful": "Its expert keeps its lane, follows its leader and moves over for a neighbour who comes too close; "
    "it does not brake for a vehicle that is about to change into its lane.",
    "attentive": "Its demonstrator saw every vehicle; the ego does what was right on average of what its lidar shows.",
}
EMERGENCY = "; braking and moving over in an emergency beside it (policies.egos.emergency)"
CHANGING_MPS = (
    0.3  # recorded rows with more lateral speed belong to lane changes, which this ego does not make
)
EXPLORATION_LOG_STD = -2.0  # of the action noise while states are collected


@dataclass(frozen=True)
class Arguments:
    """Every argument of the training; the defaults made the shipped weights."""

    data: Path  # the data pack's folder, or one of imported tables
    out: Path  # where the weights and their card go
    seed: int = 1
    name: str = "lidar"  # of the ego: the weights are ego-NAME
    demonstrator: str = (
        "attentive"  # who labels what it sees among drivers: attentive, or careful (lidar-paper's)
    )
    scenario: str = "i80-10s"  # whose drivers are around it while it learns from the attentive demonstrator
    emergency: int = (
        1  # 1: what it does in an emergency stands beside the network; 0: the network alone (lidar-paper)
    )
    drivers: str = "drivers-gail"  # weights of the drivers around it while it learns from the careful one
    rounds: int = 4  # of aggregation
    rollouts: int = 80  # of six egos, in each round
    among: int = 1200  # rollouts of one ego among drivers, in each round
    urgency: float = 2.0  # added weight of a visited state for each m/s^2 that its expert brakes
    swerving: float = 3.0  # added weight for each m/s^2 that it accelerates across the lane
    first_steps: int = 1500  # of AdamW on the recordings alone, before the first round
    round_steps: int = 1500  # in each round
    final_steps: int = 8_000  # on all rows
    batch: int = 1024
    recorded_share: float = 0.15  # of the rows in a batch
    perturbed_share: float = 0.15
    check_rollouts: int = 2_000  # of the final check on the whole road, with lidar-paper's starts and drivers
    contact_rollouts: int = 2_000  # of the final check in the scenario
    threads: int = 1
    device: str = "cpu"  # auto, cpu or cuda (service.training.device); the shipped weights are a CPU's


def main() -> None:
    run = begin("ego-lidar", Arguments, __doc__, seed_key=(2,))
    arguments, stages = run.arguments, run.stages
    rows_rng, visit_rng, train_rng, check_rng = run.generators(4)

    model = load_drivers(arguments.drivers)
    with Progress() as progress:
        people = recorded_people(arguments.data, stages, rows_rng)
        expert = replace(fit(people.evidence, KeepingExpert()), **CAREFUL)
        road = i80_road()
        draw = drawn_from(network_of(model), model.mu0, model.sigma0)
        visit = visits_of(arguments, expert, road, draw)
        net, aggregated = stages.get(
            "network",
            tuple[DriverNet, Rows],
            lambda: train_network(
                arguments, people, expert, road, visit, visit_rng, train_rng, progress, run.device
            ),
        )
        network = exported(net, aggregated.seen)
        with ticks(progress, "whole road", arguments.check_rollouts) as tick:
            on_road = metrics.whole_road(
                draw, road, arguments.check_rollouts, check_rng, ego=network, tick=tick
            )
        loop = {
            name: metrics.closed_loop(lambda _: network, part, HORIZONS_S, check_rng, samples=1, ego=True)
            for name, part in people.recordings.sites.items()
        }
        with ticks(progress, "contacts", arguments.contact_rollouts) as tick:
            contacts = Traffic(arguments.scenario).contacts(
                policy_of(network, bool(arguments.emergency)),
                arguments.contact_rollouts,
                arguments.seed,
                tick,
            )
        held = people.held_out()
        behind = metrics.brakes_for_leader(quiet(network), road, check_rng)

    card = {
        "name": f"ego-{arguments.name}",
        "what": "ego policy under test: network 51-200-100-2 on lidar and lane position, mean action, no noise"
        + (EMERGENCY if arguments.emergency else ""),
        "method": "behaviour cloning (squared error), noise injection, data set aggregation; demonstrator: "
        + arguments.demonstrator,
        **run.repeated_by(),
        "data": people.card((arguments.recorded_share, arguments.perturbed_share), aggregated),
        "expert": expert.as_dict(),
        "action_scale": ACTION_SCALE.tolist(),
        "metrics": {
            "contacts": contacts,
            "p0_whole_road_among_drivers": {"drivers": arguments.drivers, **on_road},
            "behind_a_slower_vehicle": behind,
            "held_out_open_loop": {"rows": len(held), **mean_errors(network, held)},
            "held_out_closed_loop": loop,
        },
        "limits": [
            "Most of what it does on the almost empty road of the i80 scenario comes from the expert's labels.",
            SHOWN[arguments.demonstrator],
            "Twenty beams: a vehicle between two beams is not seen.",
        ],
        "versions": versions(),
        "device": described(run.device),
        "training_s": run.elapsed_s(),
    }
    arrays = weights_of(network, quiet(network).head, np.zeros((HEAD_SIZE, HEAD_SIZE)))
    path = save_drivers(
        arguments.out / f"ego-{arguments.name}.safetensors", arrays, card, bool(arguments.emergency)
    )
    run.finish(path, card)


def visits_of(
    arguments: Arguments, expert: Expert, road: Road, draw: Callable[[np.random.Generator], Network]
) -> Callable[[Network, np.random.Generator], Rows]:
    """What gives labelled moments that a network reaches among drivers; `draw` gives the careful one's drivers."""
    if is_attentive(arguments.demonstrator):
        traffic = Traffic(arguments.scenario)
        return lambda network, rng: traffic.visited(network, expert, arguments.among, rng)
    return lambda network, rng: labelled(visited_among(network, draw, road, arguments.among, rng), expert)


def quiet(network: Network, log_std: float = -5.0) -> Network:
    """The network with the same small log standard deviations everywhere."""
    head = network.head.reshape(-1, OUTPUTS).copy()
    head[:, 2:] = 0.0
    head[-1, 2:] = log_std
    return network._replace(head=head.reshape(-1))


def urgency(arguments: Arguments, rows: Rows) -> np.ndarray:
    """Shares (n,) of rows in a batch, adding to 1: states that call for hard braking or a swerve are few and matter."""
    weight = np.ones(len(rows))
    if rows.kind[0] == AGGREGATED:
        weight += arguments.urgency * np.clip(-rows.action[:, 0], 0.0, None)
        speed = rows.seen[:, SPEED_MPS].astype(np.float64)
        across = rows.action[:, 1] * speed - rows.seen[:, LANE_CURVATURE_PER_M] * speed**2
        weight += arguments.swerving * np.abs(across)
    return weight / weight.sum()


def labelled(rows: Rows, expert: Expert) -> Rows:
    """The rows with the expert's actions."""
    return replace(rows, action=mean_action(expert, rows.seen))


def lane_keeping(rows: Rows) -> Rows:
    """The rows of drivers who are not changing lanes."""
    return rows.where(np.abs(lateral_speed(rows.seen)) < CHANGING_MPS)


def train_network(
    arguments: Arguments,
    people: People,
    expert: Expert,
    road: Road,
    visit: Callable[[Network, np.random.Generator], Rows],
    visit_rng: np.random.Generator,
    train_rng: np.random.Generator,
    progress: Progress,
    device: torch.device,
) -> tuple[DriverNet, Rows]:
    """The network trained on everything, and the rows aggregated on the way.

    visit: labelled moments that a network reaches among drivers.
    """
    learn, perturbed = lane_keeping(people.learned_from()), lane_keeping(people.perturbed)
    wide = np.concatenate([learn.seen, perturbed.seen])
    net, aggregated = DriverNet(*input_statistics(wide)).to(device), None
    for turn in range(arguments.rounds + 1):
        last = turn == arguments.rounds
        steps = arguments.final_steps if last else (arguments.round_steps if turn else arguments.first_steps)
        parts = [learn, perturbed] + ([aggregated] if aggregated is not None else [])
        seen = np.concatenate([part.seen for part in parts])
        action = np.concatenate([part.action for part in parts])
        shares = [arguments.recorded_share, arguments.perturbed_share]
        shares.append(1.0 - sum(shares))
        weight = np.concatenate(
            [s * urgency(arguments, part) for part, s in zip(parts, shares, strict=False)]
        )
        train(net, seen, action, np.zeros_like(action), weight, steps, train_rng, batch=arguments.batch,
              progress=progress, label=f"round {turn} of {arguments.rounds}", deterministic=True)  # fmt: skip
        if not last:
            exploring = quiet(exported(net, seen[-20000:]), EXPLORATION_LOG_STD)
            new = labelled(visited(exploring, road, arguments.rollouts, visit_rng), expert)
            among = visit(exploring, visit_rng)
            aggregated = joined([part for part in (aggregated, new, among) if part is not None])
            if turn == 0:  # inputs of the scenario lie outside the recordings' range: standardise for both
                net = DriverNet(*input_statistics(np.concatenate([wide, new.seen]))).to(device)
    assert aggregated is not None  # there is a round
    return net.cpu(), aggregated


if __name__ == "__main__":
    main()
