r"""Train the vision ego: it learns from pictures of I-80 to drive as an expert does who knows where the lanes are.

    tailroad train ego-vision --out DIR --seed 1

No recordings are needed. The demonstrator keeps its lane, follows carefully, gives way to a neighbour who comes too
close and avoids conflicts that it sees coming (service.training.demonstrator). It labels moments scattered over the
road, then moments that the network itself reaches while it drives among a scenario's drivers (data set aggregation,
Ross et al. 2011). Pictures are rendered while it learns, in a weather drawn anew each time, so no picture is seen
twice. Besides the action the features learn to tell lane offset, heading and curvature; that part is not exported.
Beside the exported network stand braking and moving over in an emergency, from the lidar (policies.egos.emergency); it
learns without them. Written to --out: ego-NAME.onnx and its card ego-NAME.json. Half an hour on a free core; an
interrupted run goes on after its last finished round, and within a round at its last checkpoint.

The ego of the paper's scenarios learned there, from the careful part of that demonstrator alone, and is the network
alone:

    tailroad train ego-vision --out DIR --seed 1 --name vision-paper --demonstrator careful --emergency 0 \
      --scenario i80-paper-10s --weather-scenario i80-paper-data --check-drives 120
"""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import Progress
from torch.nn.functional import smooth_l1_loss

from policies import layout
from policies.egos.vision import VisionEgo, beside
from service.training import stored
from service.training.demonstrator import demonstrated, is_attentive
from service.training.ego_vision_figures import figures
from service.training.ego_vision_network import ACTION_SCALE, CHANNELS, HINT_SCALE, VisionNet, export
from service.training.ego_vision_world import WEATHER_KINDS, States, VisionWorld
from service.training.lane_changes import KeepingExpert
from service.training.run import Stages, begin, ticks, versions

EXPERT = KeepingExpert(
    time_headway_s=1.2,
    comfort_mps2=1.5,
    acceleration_mps2=1.0,
    desired_speed_mps=21.0,
    lateral_rate_per_s=0.6,
)
HINTS = [layout.LANE_OFFSET_M, layout.LANE_HEADING_RAD, layout.LANE_CURVATURE_PER_M]
HINT_WEIGHT = 0.3
CHECKPOINT_STEPS = 100


@dataclass(frozen=True)
class Arguments:
    """Every argument of the training; the defaults made the shipped weights."""

    out: Path  # where the weights and their card go
    seed: int = 1
    name: str = "vision"  # of the ego: the weights are ego-NAME
    demonstrator: str = "attentive"  # who labels what it sees: attentive, or careful (vision-paper's)
    emergency: int = 1  # 1: what it does in an emergency stands beside the network; 0: the network alone
    scenario: str = "i80"  # that it drives in
    weather_scenario: str = "i80-data"  # that it drives in half of the time, and whose weather it sees
    drivers: str = "drivers-gail"  # weights of the drivers around the ego
    scattered: int = 30_000  # moments to begin with
    rounds: int = 2  # of aggregation
    drives: int = 60  # in each round
    drive_steps: int = 220
    first_steps: int = 1400  # of AdamW on the scattered moments
    round_steps: int = 400  # in each round
    final_steps: int = 900
    batch: int = 64
    rate: float = 1.2e-3  # of learning, at its height
    check_drives: int = 20  # of the final check, in each weather
    threads: int = 1


def main() -> None:
    run = begin("ego-vision", Arguments, __doc__, seed_key=(5,))
    arguments, stages = run.arguments, run.stages
    streams = run.streams(2 * arguments.rounds + 4)

    world = VisionWorld(
        arguments.drivers,
        (arguments.scenario, arguments.weather_scenario),
        is_attentive(arguments.demonstrator),
    )
    net = VisionNet().to(memory_format=torch.channels_last)
    states = stages.get(
        "scattered", States, lambda: world.scattered(arguments.scattered, np.random.default_rng(streams[0]))
    )
    onnx = stages.path("network", ".onnx")
    with Progress() as progress:
        for turn in range(arguments.rounds + 1):
            last = turn == arguments.rounds
            steps = (
                arguments.final_steps if last else (arguments.round_steps if turn else arguments.first_steps)
            )
            learn(net, world, states, steps, turn, arguments, stages, streams[1 + turn], progress)
            export(net, onnx, emergency=last and bool(arguments.emergency))
            if not last:
                rng = np.random.default_rng(streams[arguments.rounds + 2 + turn])
                states = States.joined(
                    [
                        states,
                        stages.get(f"visited-{turn}", States, partial(visited, world, onnx, arguments, rng)),
                    ]
                )
        measured: dict[str, Any] = {}
        with ticks(progress, "figures", len(WEATHER_KINDS)) as tick:
            for (name, weather), stream in zip(
                WEATHER_KINDS.items(), streams[-1].spawn(len(WEATHER_KINDS)), strict=True
            ):
                rng = np.random.default_rng(stream)
                made = partial(figures, world, VisionEgo(onnx), EXPERT, weather, arguments.check_drives, rng)
                measured[name] = stages.get(f"figures, {name}".replace("/", " per "), dict[str, Any], made)
                tick()

    card = {
        "name": f"ego-{arguments.name}",
        "what": "ego policy under test: camera 200 x 66 RGB, speed and 20-beam lidar -> acceleration and turn rate",
        "method": "imitation of a lane-keeping, careful expert in our world, data set aggregation over all weathers"
        + ("; braking and moving over in an emergency beside it, from its lidar" if arguments.emergency else ""),
        **run.repeated_by(),
        "network": {"convolutions": list(CHANNELS), "parameters": sum(p.numel() for p in net.parameters()),
                    "action_scale": list(ACTION_SCALE)},
        "expert": EXPERT.as_dict(),
        "states": {"scattered": arguments.scattered, "visited": len(states) - arguments.scattered},
        "metrics": measured,
        "limits": [
            "It has seen one road, I-80 at Emeryville as the renderer draws it, and cars as the renderer draws them.",
            "Its expert keeps its lane; nothing teaches it to change lanes or to brake for what only the camera shows.",
            "Twenty beams: a vehicle between two beams is not in the lidar.",
        ],
        "versions": versions(),
        "training_s": run.elapsed_s(),
    }  # fmt: skip
    arguments.out.mkdir(parents=True, exist_ok=True)
    weights = arguments.out / f"ego-{arguments.name}.onnx"
    weights.write_bytes(onnx.read_bytes())
    weights.with_suffix(".json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    run.finish(weights, card)


@dataclass(frozen=True)
class _Checkpoint:
    """Where an interrupted round goes on: states of network, optimiser and schedule, and steps done."""

    net: dict[str, torch.Tensor]
    optimiser: dict[str, Any]
    schedule: dict[str, Any]
    done: int


def learn(
    net: VisionNet,
    world: VisionWorld,
    states: States,
    steps: int,
    turn: int,
    arguments: Arguments,
    stages: Stages,
    stream: np.random.SeedSequence,
    progress: Progress,
) -> None:
    """Train for `steps` batches of moments drawn from `states`, or take up a run of them that was interrupted."""
    optimiser = torch.optim.AdamW(net.parameters(), lr=arguments.rate, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, arguments.rate * (1.0 if turn == 0 else 0.5), steps, pct_start=0.1
    )
    done, loss_mean = 0, None
    checkpoint = stages.path(f"round-{turn}", ".checkpoint")
    if checkpoint.is_file():
        kept = stored.load(checkpoint, _Checkpoint)
        net.load_state_dict(kept.net)
        optimiser.load_state_dict(kept.optimiser)
        schedule.load_state_dict(kept.schedule)
        done = kept.done
    labels = demonstrated(EXPERT, states.seen, states.avoidance) / ACTION_SCALE
    hints = states.seen[:, HINTS] / HINT_SCALE
    values = beside(states.seen)
    task = progress.add_task(f"round {turn} of {arguments.rounds}", total=steps, completed=done)
    net.train()
    for k in range(done, steps):
        rng = np.random.default_rng(
            [*stream.generate_state(2).tolist(), k]
        )  # a resumed run draws the same batches
        rows = rng.integers(0, len(states), arguments.batch)
        frames = torch.from_numpy(world.pictures(states, rows, rng))
        action, told = net.both(frames, torch.from_numpy(values[rows]))
        loss = smooth_l1_loss(action, torch.from_numpy(labels[rows]).float(), beta=0.5)
        loss = loss + HINT_WEIGHT * smooth_l1_loss(told, torch.from_numpy(hints[rows]).float(), beta=0.5)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        value = float(loss.detach())
        loss_mean = value if loss_mean is None else 0.98 * loss_mean + 0.02 * value
        progress.update(
            task, advance=1, description=f"round {turn} of {arguments.rounds}, loss {loss_mean:.4f}"
        )
        if (k + 1) % CHECKPOINT_STEPS == 0 or k + 1 == steps:
            print(f"round {turn}, step {k + 1} of {steps}: loss {loss_mean:.4f}", flush=True)
            states_now = (net.state_dict(), optimiser.state_dict(), schedule.state_dict())
            stored.save(checkpoint, _Checkpoint(*states_now, k + 1))


def visited(world: VisionWorld, onnx: Path, arguments: Arguments, rng: np.random.Generator) -> States:
    """Moments that the exported network reaches in drives with disturbed actions, in all weathers."""
    ego, parts = VisionEgo(onnx), []
    for number in range(arguments.drives):
        scenario = world.names[number % 2]
        sway = float(rng.choice([0.5, 1.0, 2.0]))
        drive = world.drive(ego, world.weather(rng), scenario, arguments.drive_steps, rng, sway, every=2)
        parts.append(drive.states)
    states = States.joined(parts)
    return states.where(states.seen[:, layout.INCIDENT] == 0.0)


if __name__ == "__main__":
    main()
