"""What every training script shares: arguments, seeds, the stages of an interrupted run, recordings, and cards.

run = begin("ego-lidar", Arguments, __doc__, seed_key=(2,))
rows_rng, train_rng = run.generators(2)
people = recorded_people(run.arguments.data, run.stages, rows_rng)
net = run.stages.get("network", DriverNet, lambda: ...)     # made once, read when the run goes on
run.finish(path, card)
"""

import argparse
import hashlib
import inspect
import json
import platform
import re
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
import torch
from rich.progress import Progress

from policies.data.recordings import Recordings, load_recordings
from policies.data.scenes import summary
from service.training.demonstrations import Rows, held_out_vehicles, joined, perturbed_rows, recorded_rows
from service.training.device import device_of
from service.training.expert import Evidence, evidence
from service.training.stored import load, save

MACHINE = ("threads", "device")  # arguments that say where a training runs
PATHS = ("data", "out")
STORED_FORM = 3  # of stages and checkpoints; one more whenever what they hold is arranged otherwise


class Arguments(Protocol):
    """What every script's frozen dataclass of arguments has, each field explained by the comment behind it."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def out(self) -> Path: ...

    @property
    def seed(self) -> int: ...

    @property
    def threads(self) -> int: ...


A = TypeVar("A", bound=Arguments)
T = TypeVar("T")


class Stages:
    """Finished stages of an interrupted run, kept beside the output until the run is done.

    With each stage's result the state of torch's generator is kept, which networks are initialised from: a run that
    goes on draws what it would have drawn.
    """

    def __init__(self, arguments: Arguments) -> None:
        decisive = {**public(arguments), "device": getattr(arguments, "device", "cpu"), "form": STORED_FORM}
        key = hashlib.sha256(repr(sorted(decisive.items())).encode()).hexdigest()[:12]
        self._folder = arguments.out / f".unfinished-{key}"

    def get(self, name: str, form: type[T], make: Callable[[], T]) -> T:
        """The result, of type `form`, of the stage `name`: read where it was finished before, else made and kept."""
        path = self.path(name, ".stage")
        if path.is_file():
            print(f"stage '{name}' was finished before: taken from {path}")
            value, drawn = load(path, types.GenericAlias(tuple, (form, torch.Tensor)))
            torch.set_rng_state(drawn)
            return value
        value = make()
        save(path, (value, torch.get_rng_state()))
        return value

    def path(self, name: str, suffix: str) -> Path:
        """Where a stage may keep a checkpoint of its own."""
        return self._folder / f"{name}{suffix}"

    def clear(self) -> None:
        """Delete everything kept."""
        for path in self._folder.glob("*"):
            path.unlink()
        if self._folder.is_dir():
            self._folder.rmdir()


@dataclass(frozen=True)
class Run(Generic[A]):
    """A training under way.

    what: the WHAT of `tailroad train WHAT`
    entropy: what everything random is seeded from
    began_s: by the clock `time.time`
    """

    what: str
    arguments: A
    device: torch.device
    entropy: list[int]
    stages: Stages
    began_s: float

    def streams(self, count: int) -> list[np.random.SeedSequence]:
        """Independent seeds."""
        return np.random.SeedSequence(self.entropy).spawn(count)

    def generators(self, count: int) -> list[np.random.Generator]:
        """Independent generators."""
        return [np.random.default_rng(stream) for stream in self.streams(count)]

    def repeated_by(self) -> dict[str, Any]:
        """The entries of a card that repeat the run."""
        return {
            "command": command(self.what, self.arguments),
            "seed": self.arguments.seed,
            "arguments": public(self.arguments),
        }

    def elapsed_s(self) -> int:
        return round(time.time() - self.began_s)

    def finish(self, written: Path, card: dict, shown: tuple[str, ...] = ("metrics",)) -> None:
        """The weights lie in `written`: forget the stages, print the card's entries `shown`."""
        self.stages.clear()
        print(json.dumps({key: card[key] for key in shown}, indent=1))
        print(f"written: {written} and its card, after {self.elapsed_s()} s")


def begin(what: str, kind: type[A], description: str | None, *, seed_key: tuple[int, ...] = ()) -> Run[A]:
    """Start `tailroad train WHAT`: read its arguments, an instance of `kind`, and seed everything that is random.

    seed_key: keeps the script's random numbers apart from those of other scripts with the same seed.
    """
    arguments = parse(kind, description)
    began = time.time()
    torch.manual_seed(arguments.seed)
    torch.set_num_threads(arguments.threads)
    device = device_of(getattr(arguments, "device", "cpu"))
    return Run(what, arguments, device, [arguments.seed, *seed_key], Stages(arguments), began)


@contextmanager
def ticks(progress: Progress, label: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar called `label` while the block runs; it moves on by one of `total` at each call of what is given."""
    task = progress.add_task(label, total=total)
    yield lambda: progress.update(task, advance=1)
    progress.remove_task(task)


def parse(kind: type[A], description: str | None) -> A:
    """Command-line arguments as the frozen dataclass `kind`, one option a field; the comment behind a field explains
    it, in the class or in one that it extends."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    explained: dict[str, str] = {}
    for part in reversed([c for c in inspect.getmro(kind) if "__dataclass_fields__" in vars(c)]):
        explained |= dict(re.findall(r"^    (\w+): .*?# (.*)$", inspect.getsource(part), re.MULTILINE))
    for field in fields(kind):
        required = field.name in PATHS
        words = [explained.get(field.name, ""), "" if required else f"[{field.default}]"]
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=Path if required else type(field.default),
            required=required,
            default=None if required else field.default,
            metavar=field.name.upper(),
            help=" ".join(filter(None, words)).replace("%", "%%"),
        )
    return kind(**vars(parser.parse_args()))


def public(arguments: Arguments) -> dict[str, Any]:
    """The arguments that decide the result: no paths, no thread counts, no device."""
    return {k: v for k, v in asdict(arguments).items() if not isinstance(v, Path) and k not in MACHINE}


def command(what: str, arguments: Arguments) -> str:
    """The command that repeats a run; only arguments that differ from their defaults are spelled out."""
    words = [f"tailroad train {what}"]
    for field in fields(arguments):
        value = getattr(arguments, field.name)
        if field.name in PATHS:
            words.append(f"--{field.name} DIR")
        elif field.name != "seed" and field.name not in MACHINE and value != field.default:
            words.append(f"--{field.name.replace('_', '-')} {value}")
    words.insert(1 + sum(word.endswith(" DIR") for word in words), f"--seed {arguments.seed}")
    return " ".join(words)


def versions() -> dict[str, str]:
    """Python's version and those of the libraries whose numbers go into weights."""
    import numba
    import polars
    import scipy

    return {
        "python": platform.python_version(),
        "torch": torch.__version__.split("+")[0],
        **{m.__name__: m.__version__ for m in (np, scipy, numba, polars)},
    }


@dataclass(frozen=True)
class People:
    """Recorded drivers as the networks and experts learn from them.

    rows: everything recorded
    perturbed: the training vehicles moved off their motion (see demonstrations)
    evidence: what an expert is fitted to
    """

    recordings: Recordings
    rows: Rows
    perturbed: Rows
    evidence: Evidence

    def learned_from(self) -> Rows:
        """The rows of drivers who are not held out."""
        return self.rows.where(~self.rows.held_out)

    def held_out(self) -> Rows:
        """The rows of drivers kept from training."""
        return self.rows.where(self.rows.held_out)

    def card(self, shares: tuple[float, float], aggregated: Rows) -> dict[str, Any]:
        """What weights learned from.

        shares: of recorded and of perturbed rows in a batch
        """
        held = self.rows.held_out
        scenes = self.recordings.scenes
        return {
            "files": self.recordings.files,
            "rows": {
                "recorded": int((~held).sum()),
                "recorded_held_out": int(held.sum()),
                "perturbed": len(self.perturbed),
                "aggregated": len(aggregated),
            },
            "shares_of_the_training_batches": {
                "recorded": shares[0],
                "perturbed": shares[1],
                "aggregated_with_expert_labels": round(1.0 - sum(shares), 4),
            },
            "held_out_vehicle_id_from": {scene.name: scene.held_out_from for scene in scenes},
            "scenes": [summary(scene) for scene in scenes],
        }


def recorded_people(data: Path, stages: Stages, rng: np.random.Generator) -> People:
    """The recordings in the folder `data` as rows and evidence; the rows are a stage of their own."""
    recordings = load_recordings(data)
    scenes = recordings.scenes

    def rows() -> tuple[Rows, Rows]:
        perturbed = joined([perturbed_rows(scene, rng) for scene in scenes])
        return joined([recorded_rows(scene) for scene in scenes]), perturbed.where(~perturbed.held_out)

    recorded, perturbed = stages.get("rows", tuple[Rows, Rows], rows)
    found = evidence(recordings.following, scenes, [~held_out_vehicles(scene) for scene in scenes])
    return People(recordings, recorded, perturbed, found)
