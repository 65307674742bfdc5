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

import argparse
import hashlib
import inspect
import json
import pickle
import platform
import re
import time
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import Progress

from policies import layout as O
from policies.data.recordings import load_recordings
from policies.data.scenes import summary
from policies.drivers import save_drivers
from service.training import metrics
from service.training.aggregation import visited
from service.training.demonstrations import (
    AGGREGATED,
    Rows,
    held_out_vehicles,
    joined,
    perturbed_rows,
    recorded_rows,
)
from service.training.device import described, device_of
from service.training.ensemble import describe, head_distribution, refit_head, sampling_covariances
from service.training.expert import Expert, evidence, fit, mean_action, noise_sd
from service.training.network import (
    ACTION_SCALE,
    NEVER_SET,
    DriverNet,
    exported,
    input_statistics,
    network_features,
    train,
)
from service.training.torch_world import CPU
from service.training.world import Network
from service.world.sim.road import i80_road

FLAGS = (O.LANE_TO_THE_LEFT, O.LANE_TO_THE_RIGHT, O.INCIDENT)  # a lane keeper needs to know none of them


@dataclass(frozen=True)
class Arguments:
    """Every argument of the training; the defaults made the shipped weights."""

    data: Path  # the data pack's folder, or one of imported tables
    out: Path  # where the weights and their card go
    seed: int = 1
    rounds: int = 5  # of aggregation
    rollouts: int = 150  # of six drivers, in each round
    first_steps: int = 1500  # of AdamW on the recordings alone, before the first round
    round_steps: int = 1200  # in each round
    final_steps: int = 4000  # on all rows
    dropout: float = 0.2  # of hidden units: 80 recorded drivers on I-80 are few
    decay: float = 0.1  # AdamW's weight decay
    batch: int = 1024
    recorded_share: float = 0.4  # of the rows in a batch, before the drivers of US-101 are weighted up
    perturbed_share: float = 0.2
    us101_weight: float = 2.0  # of a US-101 row relative to an I-80 one: faster traffic, fewer rows
    members: int = 24  # resamples of the last layer
    ridge: float = 3e-3  # pulls members to the common head where the data leave weights open
    member_rows: int = 40_000  # rows each resample is drawn from
    check_rollouts: int = 1000  # for the metrics on the whole road
    threads: int = 1
    device: str = "cpu"  # auto, cpu or cuda (service.training.device); the shipped weights are a CPU's


def main() -> None:
    arguments = parse(Arguments, __doc__)
    began = time.time()

    # Randomness: everything below draws from these.
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    device = device_of(arguments.device)
    streams = [np.random.default_rng(s) for s in np.random.SeedSequence(arguments.seed).spawn(7)]
    rows_rng, visit_rng, train_rng, expert_rng, member_rng, xi_rng, check_rng = streams

    stages = Stages(arguments)
    with Progress() as progress:
        recordings = load_recordings(arguments.data)
        scenes = recordings.scenes
        recorded, perturbed = stages.get("rows", lambda: rows_of(scenes, rows_rng))
        found = evidence(recordings.following, scenes, [~held_out_vehicles(scene) for scene in scenes])
        expert = fit(found)
        road = i80_road()

        net, aggregated = stages.get(
            "trunk",
            lambda: train_trunk(
                arguments,
                recorded,
                perturbed,
                expert,
                road,
                visit_rng,
                train_rng,
                progress,
                unused=FLAGS,
                device=device,
            ),
        )
        network = exported(net, aggregated.seen)
        experts, members, shapes, _ = stages.get(
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
        distribution, scores = head_distribution(members, shapes)

        root = np.linalg.cholesky(distribution.covariance)

        def draw(rng: np.random.Generator) -> Network:
            xi = distribution.mean + root @ rng.standard_normal(len(root))
            return network._replace(head=xi.astype(np.float32))

        centre = network._replace(head=distribution.mean.astype(np.float32))
        measured = measure(
            arguments, draw, centre, road, recordings, recorded, aggregated, xi_rng, check_rng, progress
        )

    card = {
        "name": "drivers-bc",
        "what": "distribution of human drivers: network 51-200-100-4, last layer N(mu0, Sigma0)",
        "method": "behaviour cloning (Gaussian likelihood), noise injection, data set aggregation with a fitted "
        "expert; last layer retrained on resampled drivers",
        "command": command("service.training.drivers", arguments),
        "seed": arguments.seed,
        "arguments": public(arguments),
        "data": data_card(arguments, recordings, recorded, perturbed, aggregated),
        "expert": {**expert.as_dict(), "resampled": [e.as_dict() for e in experts]},
        "action_scale": ACTION_SCALE.tolist(),
        "sigma0": {
            **describe(distribution),
            "members": len(members),
            "cross_validated_log_likelihood": {str(a): round(s, 2) for a, s in scores.items()},
            **xi_effects(network, members, distribution, recorded, aggregated),
        },
        "metrics": measured,
        "limits": LIMITS,
        "versions": versions(),
        "device": described(device),
        "training_s": round(time.time() - began),
    }
    arrays = {
        "w1": network.w1, "b1": network.b1, "w2": network.w2, "b2": network.b2,
        "mu0": distribution.mean, "action_scale": ACTION_SCALE,
    }  # fmt: skip
    arrays["sigma0"] = distribution.covariance
    path = save_drivers(arguments.out / "drivers-bc.safetensors", arrays, card)
    stages.clear()
    print(json.dumps({key: card[key] for key in ("metrics", "sigma0")}, indent=1))
    print(f"written: {path} and its card, after {time.time() - began:.0f} s")


LIMITS = [
    "Recorded drivers were seen at a mean of 6 m/s (I-80) and 13 m/s (US-101), in congestion. On the almost empty "
    "road of the i80 scenario most of what a driver does comes from the fitted expert's labels, not from recordings.",
    "Vehicle sizes on I-80 are estimates; widths are assumed.",
    "Action noise is white at 10 Hz. Recorded turn rates are correlated over about a second; their noise was replaced "
    "by the white noise that gives the same spread across the lane, so open-loop likelihoods suffer.",
    "The resampled heads include resampled experts. They know nothing of kinds of drivers that 15 minutes on two roads "
    "do not show: Sigma0 says how uncertain this fit is, not how different people are.",
    "Lane changes are hardly learned: without intentions in the observation they look like noise.",
]


def rows_of(scenes, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Recorded rows and perturbed ones (as many again, training vehicles only)."""
    recorded = joined([recorded_rows(scene) for scene in scenes])
    perturbed = joined([perturbed_rows(scene, rng) for scene in scenes])
    return recorded, perturbed.where(~perturbed.held_out)


def mixture(arguments: Arguments, recorded: Rows, perturbed: Rows, aggregated: Rows | None, expert: Expert):
    """Observations, mean labels, label noise and sampling weights of all training rows."""
    learn = recorded.where(~recorded.held_out)
    parts = [learn, perturbed] + ([aggregated] if aggregated is not None else [])
    shares = [arguments.recorded_share, arguments.perturbed_share]
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
            np.where(part.seen[:, 2] > 9.0, arguments.us101_weight, 1.0)
            if part.kind[0] != AGGREGATED
            else 1.0
        )
        w = np.ones(len(part)) * fast
        weight.append(w / w.sum() * share)
    return seen, action, sd, np.concatenate(weight)


def train_trunk(
    arguments, recorded, perturbed, expert, road, visit_rng, train_rng, progress, *, unused=(NEVER_SET,), seconds=60.0,
    every=12, device=CPU,
):  # fmt: skip
    """The network trained on everything, and the aggregated rows: every `every`-th state of rollouts of `seconds`."""
    learn = recorded.where(~recorded.held_out)
    wide = np.concatenate([learn.seen, perturbed.seen])
    settings = {"batch": arguments.batch, "dropout": arguments.dropout, "decay": arguments.decay}
    aggregated = None
    net = DriverNet(*input_statistics(wide), unused).to(device)
    for turn in range(arguments.rounds + 1):
        seen, action, sd, weight = mixture(arguments, recorded, perturbed, aggregated, expert)
        steps = arguments.first_steps if turn == 0 else arguments.round_steps
        label = f"round {turn} of {arguments.rounds}"
        train(net, seen, action, sd, weight, steps, train_rng, **settings, progress=progress, label=label)
        if turn < arguments.rounds:
            driven = exported(net, seen[-20000:])
            new = visited(driven, road, arguments.rollouts, visit_rng, seconds=seconds, every=every)
            aggregated = new if aggregated is None else joined([aggregated, new])
            if turn == 0:  # inputs of the scenario lie outside the recordings' range: standardise for both
                net = DriverNet(*input_statistics(np.concatenate([wide, new.seen])), unused).to(device)
    seen, action, sd, weight = mixture(arguments, recorded, perturbed, aggregated, expert)
    steps = arguments.final_steps
    train(net, seen, action, sd, weight, steps, train_rng, **settings, progress=progress, label="all rows")
    return net.cpu(), aggregated


def train_members(
    arguments, network, recorded, perturbed, aggregated, expert, found, expert_rng, member_rng, progress
):
    """Experts and heads (members, 404), each from a resample of whole trajectories and of the expert's evidence; the
    shapes of the heads' covariance; and the head (404,) of all trajectories, not resampled."""
    learn = recorded.where(~recorded.held_out)
    parts = [learn, perturbed, aggregated]
    shares = [arguments.recorded_share, arguments.perturbed_share]
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
    experts, members = [], []
    for _ in range(arguments.members):
        by = fit(found, expert, expert_rng)
        weight = []
        drawn = {}
        for part, share in zip(chosen, shares, strict=True):
            # recorded and perturbed rows of a driver are resampled together
            key = "people" if part.kind[0] != AGGREGATED else "visits"
            top = (
                int(max(p.trajectory.max() for p in chosen if (p.kind[0] != AGGREGATED) == (key == "people")))
                + 1
            )
            if key not in drawn:
                present = np.unique(part.trajectory)
                count = np.bincount(member_rng.choice(present, len(present)), minlength=top)
                drawn[key] = np.pad(count, (0, max(0, top - len(count))))
            w = drawn[key][part.trajectory].astype(np.float64)
            weight.append(w / w.sum() * share)
        head = refit_head(everything, labels(by), np.concatenate(weight), common, arguments.ridge)
        experts.append(by)
        members.append(head)
        progress.update(task, advance=1)
    progress.remove_task(task)
    return experts, np.array(members), sampling_covariances(everything, base, common, arguments.ridge), common


def measure(arguments, draw, centre, road, found, recorded, aggregated, xi_rng, check_rng, progress) -> dict:
    """All metrics of the card."""
    task = progress.add_task("whole road", total=arguments.check_rollouts)
    on_road = metrics.whole_road(
        lambda _: draw(xi_rng),
        road,
        arguments.check_rollouts,
        check_rng,
        tick=lambda: progress.update(task, advance=1),
    )
    progress.remove_task(task)
    held = recorded.where(recorded.held_out)
    likelihood = metrics.nll(centre, network_features(centre, held.seen), held.action.astype(np.float64))
    learned = recorded.where(~recorded.held_out)
    train_nll = metrics.nll(centre, network_features(centre, learned.seen), learned.action.astype(np.float64))
    sd = learned.action.std(axis=0) / ACTION_SCALE
    constant = 0.5 * (held.action / ACTION_SCALE / sd) ** 2 + np.log(sd) + 0.5 * np.log(2.0 * np.pi)
    loop = {}
    for name, part in found.sites.items():
        loop[name] = metrics.closed_loop(lambda _: draw(xi_rng), part, (5.0, 10.0, 20.0), check_rng)
    return {
        "p0_whole_road": on_road,
        "behind_a_slower_vehicle": metrics.brakes_for_leader(centre, road, check_rng),
        "held_out_open_loop": {
            "rows": len(held),
            "nll_accel_turn_rate": _rounded(likelihood.mean(axis=0)),
            "nll_on_training_rows": _rounded(train_nll.mean(axis=0)),
            "nll_of_a_constant_normal": _rounded(constant.mean(axis=0)),
            "rmse_accel_mps2": round(float(_mean_error(centre, held)[0]), 4),
            "rmse_turn_rate_radps": round(float(_mean_error(centre, held)[1]), 5),
        },
        "held_out_closed_loop": loop,
    }


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(v), 4) for v in values]


def _mean_error(network: Network, rows: Rows) -> np.ndarray:
    h = np.column_stack([network_features(network, rows.seen), np.ones(len(rows))])
    mean = (h @ network.head.reshape(-1, 4))[:, :2] * ACTION_SCALE
    return np.sqrt(np.mean((mean - rows.action) ** 2, axis=0))


def xi_effects(network, members, distribution, recorded, aggregated) -> dict[str, Any]:
    """What a draw of xi, and a shift of 0.01 in every weight, change in a driver's actions."""
    result: dict[str, Any] = {}
    for name, rows in (("recorded", recorded), ("aggregated", aggregated)):
        pick = np.linspace(0, len(rows) - 1, 4000).astype(int)
        h = np.column_stack([network_features(network, rows.seen[pick]), np.ones(len(pick))])
        sd = []
        for output in range(4):
            block = distribution.covariance[output::4, output::4]
            sd.append(float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", h, block, h)))))
        of_members = np.array([h @ m.reshape(-1, 4) for m in members]).std(axis=0, ddof=1)
        result[f"output_sd_under_xi_{name}"] = {
            "mean_accel_mps2": round(sd[0] * ACTION_SCALE[0], 4),
            "mean_turn_rate_radps": round(sd[1] * ACTION_SCALE[1], 6),
            "log_std": [round(x, 4) for x in sd[2:]],
            "mean_accel_of_members": round(float(np.sqrt((of_members[:, 0] ** 2).mean())), 4),
            "mean_turn_rate_of_members": round(
                float(np.sqrt((of_members[:, 1] ** 2).mean())) * ACTION_SCALE[1], 6
            ),
        }
        shift = float(0.01 * np.abs(h).sum(axis=1).mean())
        result[f"output_shift_of_0.01_in_all_weights_{name}"] = round(shift, 4)
        result[f"activation_{name}"] = {
            "rms": round(float(np.sqrt((h[:, :-1] ** 2).mean())), 4),
            "active_units_mean": round(float((h[:, :-1] > 0).sum(axis=1).mean()), 1),
        }
    return result


def data_card(arguments, recordings, recorded, perturbed, aggregated) -> dict:
    """What the weights learned from, with shares."""
    held = recorded.held_out
    shares = [arguments.recorded_share, arguments.perturbed_share]
    return {
        "files": recordings.files,
        "rows": {
            "recorded": int((~held).sum()),
            "recorded_held_out": int(held.sum()),
            "perturbed": len(perturbed),
            "aggregated": len(aggregated),
        },
        "shares_of_the_training_batches": {
            "recorded": shares[0],
            "perturbed": shares[1],
            "aggregated_with_expert_labels": round(1.0 - sum(shares), 4),
        },
        "held_out_vehicle_id_from": {scene.name: scene.held_out_from for scene in recordings.scenes},
        "scenes": [summary(scene) for scene in recordings.scenes],
    }


class Stages:
    """Finished stages of an interrupted run, kept beside the output until the run is done.

    With each stage's result the state of torch's generator is kept, which networks are initialised from: a run that
    goes on draws what it would have drawn.
    """

    def __init__(self, arguments) -> None:
        decisive = {**public(arguments), "device": getattr(arguments, "device", "cpu"), "form": 2}
        key = hashlib.sha256(repr(sorted(decisive.items())).encode()).hexdigest()[:12]
        self._folder = arguments.out / f".unfinished-{key}"

    def get(self, name: str, make):
        path = self._folder / f"{name}.pickle"
        if path.is_file():
            print(f"stage '{name}' was finished before: taken from {path}")
            value, drawn = pickle.loads(path.read_bytes())
            torch.set_rng_state(drawn)
            return value
        value = make()
        self._folder.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_bytes(pickle.dumps((value, torch.get_rng_state())))
        part.replace(path)
        return value

    def path(self, name: str, suffix: str) -> Path:
        """Where a stage may keep a checkpoint of its own."""
        return self._folder / f"{name}{suffix}"

    def clear(self) -> None:
        for path in self._folder.glob("*"):
            path.unlink()
        if self._folder.is_dir():
            self._folder.rmdir()


MACHINE = ("threads", "device")  # arguments that say where a training runs


def public(arguments) -> dict:
    """The arguments that decide the result: no paths, no thread counts, no device."""
    return {k: v for k, v in asdict(arguments).items() if not isinstance(v, Path) and k not in MACHINE}


def command(module: str, arguments) -> str:
    """The command that repeats a run; only arguments that differ from their defaults are spelled out."""
    words = [f"python -m {module} --data DIR --out DIR --seed {arguments.seed}"]
    for field in fields(arguments):
        value = getattr(arguments, field.name)
        if field.name not in ("data", "out", "seed", *MACHINE) and value != field.default:
            words.append(f"--{field.name.replace('_', '-')} {value}")
    return " ".join(words)


def versions() -> dict[str, str]:
    import numba
    import polars
    import scipy

    return {
        "python": platform.python_version(),
        "torch": torch.__version__.split("+")[0],
        **{m.__name__: m.__version__ for m in (np, scipy, numba, polars)},
    }


def parse(kind, description: str):
    """Command-line arguments as the frozen dataclass `kind`, one option a field; the comment behind a field explains
    it."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    told = dict(re.findall(r"^    (\w+): .*?# (.*)$", inspect.getsource(kind), re.MULTILINE))
    for field in fields(kind):
        required = field.name in ("data", "out")
        words = [told.get(field.name, ""), "" if required else f"[{field.default}]"]
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=Path if required else type(field.default),
            required=required,
            default=None if required else field.default,
            metavar=field.name.upper(),
            help=" ".join(filter(None, words)).replace("%", "%%"),
        )
    return kind(**vars(parser.parse_args()))


if __name__ == "__main__":
    main()
