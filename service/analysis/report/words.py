"""Numbers and sentences of the report, as plain text with sensible digits."""

import shlex
from collections.abc import Sequence
from typing import Any

from service.analysis.risk import event_of
from service.analysis.wording import count, level, one_in, quantity, told
from service.evaluation.job import Job
from service.evaluation.options import COMMON, FLAGS_OF_CE
from service.world.scenario import built_in_names, load_scenario
from service.world.scenario.measures import measure_kind

METHOD_NAMES = {
    "naive": "naive Monte Carlo",
    "ce": "cross-entropy method",
    "mixture": "mixture importance sampling",
    "splitting": "multilevel splitting",
    "auto": "automatic choice",
    "paths": "splitting of paths",
}
BY_METHOD = METHOD_NAMES | {"ce": "the cross-entropy method"}
ROAD_NAMES = {"i80": "I-80 at Emeryville", "us101": "US-101 in Los Angeles"}
FLAGS = (*COMMON, *FLAGS_OF_CE)  # options that `tailroad estimate` has a flag for


def road_name(job: Job) -> str:
    return ROAD_NAMES.get(job.scenario.network.road, job.scenario.network.road.rsplit("/", 1)[-1])


def apart(job: Job, jobs: Sequence[Job]) -> str:
    """What a job's name needs beside its method, where the run asks for several thresholds or seeds."""
    said = []
    if len({other.gamma for other in jobs}) > 1:
        unit = measure_kind(job.scenario.safety.measure).unit
        said.append(f"f ≤ {quantity(job.gamma, unit)}")
    if len({other.seed for other in jobs}) > 1:
        said.append(f"seed {job.seed}")
    return f" ({', '.join(said)})" if said else ""


def question(job: Job) -> str:
    """The question that the run answers."""
    return (
        f"How probable is {event_of(job)} for ego {job.ego} in a drive of {job.scenario.time.horizon_s:g} s at most on "
        f"{road_name(job)}?"
    )


def answer(summary: dict[str, Any]) -> tuple[str, str]:
    """The estimate in words, and its interval in words."""
    low, high = summary["ci"]
    sure, found = level(summary["confidence"]), told(summary["p"], summary["ci"])
    n = summary["rollouts"]["estimation"]
    if not n:
        return ("p is not known yet.", "No rollout of the estimation has been answered.")
    if not summary["events"]:
        return (
            f"No such event in {count(n)} rollouts.",
            f"{sure} interval: at most {found.high}, or {one_in(high)} rollouts.",
        )
    if low > 0:
        span = f"{one_in(low)} to {one_in(high)} rollouts"
    else:
        span = f"at most {one_in(high)} rollouts"
    return (
        f"In about {one_in(summary['p'])} rollouts.",
        f"{sure} interval: {found.span}, or {span}.",
    )


def commands(jobs: Sequence[Job]) -> list[str]:
    """The command lines that run these jobs: one where their options allow it, else one each."""
    merged: dict[str, Any] = {}
    for job in jobs:
        for option, value in job.options.items():
            if merged.setdefault(option, value) != value:
                return [_command([job], job.options) for job in jobs]
    return [_command(jobs, merged)]


def _command(jobs: Sequence[Job], options: dict[str, Any]) -> str:
    job = jobs[0]
    words = ["tailroad", "estimate", job.scenario.name if is_built_in(job) else f"{job.scenario.name}.toml"]
    words += ["--ego", job.ego, "--gamma", repr(job.gamma)]
    for each in jobs:
        words += ["--method", each.method]
    for option in FLAGS:
        if options.get(option) is not None:
            words += ["--" + option.replace("_", "-"), str(options[option])]
    return shlex.join([*words, "--seed", str(job.seed)])


def options_without_flag(job: Job) -> list[str]:
    """Options of the job that the command line cannot say."""
    return sorted(name for name, value in job.options.items() if value is not None and name not in FLAGS)


def is_built_in(job: Job) -> bool:
    """The job's scenario is one that comes with tailroad, unchanged."""
    name = job.scenario.name
    return name in built_in_names() and load_scenario(name) == job.scenario
