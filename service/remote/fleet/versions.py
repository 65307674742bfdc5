"""What decides a rollout's bits besides its job: the software and the files, as digests that both sides compare."""

import hashlib
from dataclasses import fields
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

import numpy as np

from service.evaluation.job import Problem
from service.evaluation.software import software


@cache
def versions() -> dict[str, str]:
    """What must be the same on workers and scheduler: code and libraries that decide bits, the shipped weights."""
    return software().named() | {"weights": _weights_digest()}


def _weights_digest() -> str:
    digest = hashlib.sha256()
    for file in sorted(_files(files("policies") / "weights"), key=lambda f: f.name):
        digest.update(file.name.encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _files(folder: Traversable) -> list[Traversable]:
    return [f for f in folder.iterdir() if f.is_file() and not f.name.endswith(".md")]


def digests(problem: Problem) -> dict[str, str]:
    """Of a job's own files: its road, as the kernels read it, and its drivers' weights."""
    road = hashlib.sha256()
    for field in fields(problem.corridor):
        value = getattr(problem.corridor, field.name)
        if field.name != "net_path":
            road.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return {"road": road.hexdigest()[:16], "drivers": problem.job.weights_sha256[:16]}


def differing(problem: Problem, theirs: dict[str, str]) -> str:
    """Which of the job's files differ from the scheduler's, "" for none."""
    names = {"road": problem.job.scenario.network.road, "drivers": problem.job.scenario.drivers.weights}
    ours = digests(problem)
    wrong = [f"the {what} {names.get(what, what)!r}" for what in theirs if ours.get(what) != theirs[what]]
    return ", ".join(wrong)
