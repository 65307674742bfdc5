"""What is said of one run in a folder of evidence: its record, its estimates, what they are made of, and the claims."""

import json
import shutil
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from policies.drivers import weights_file
from policies.egos import ego_weights
from service.analysis.evidence.objects import Claim, Group
from service.analysis.exports import export_bytes
from service.analysis.failures.events import events_of
from service.analysis.report import words
from service.analysis.run.records import record_of
from service.analysis.run.run import Run
from service.analysis.wording import level, significant
from service.errors import InputError, StoreError
from service.evaluation.record import JobRecord
from service.evaluation.store.directory import RECORD
from service.evaluation.summary import Cost, json_ready, summary_of
from service.world.scenario.fixed import toml_of
from service.world.scenario.measures import IMPACT

CARDS = "cards"


@dataclass(frozen=True)
class Wanted:
    """What a folder is to hold of each run.

    references: drivers whose verdict on preventability is wanted
    films: of the most dangerous rollouts, so many
    workers: processes that run rollouts again
    """

    references: Sequence[str]
    films: int
    workers: int


def add_run(folder: Path, run: Path, number: int, wanted: Wanted) -> list[Group]:
    """Put a run into the folder; the claims on each of its jobs. number: of the run's first goal."""
    name = f"runs/{run.resolve().name}"
    copy_record(run, folder / name)
    jobs = record_of(run)[1]
    return [_job(folder, run, name, job, f"G{number + i}", wanted) for i, job in enumerate(jobs)]


def copy_record(run: Path, to: Path) -> None:
    """A run's record: run.json, and the database as it stands at one moment; nothing else."""
    if to.exists():
        raise InputError(f"two runs are called {to.name!r}: give them folders with names of their own")
    to.mkdir(parents=True)
    if not (run / "run.json").is_file() or not (run / RECORD).is_file():
        raise StoreError(f"{run} is not a run directory; check the path")
    shutil.copyfile(run / "run.json", to / "run.json")
    source, target = sqlite3.connect(run / RECORD), sqlite3.connect(to / RECORD)
    try:
        source.backup(target)
    finally:
        source.close()
        target.close()


def write_json(folder: Path, name: str, content: Any) -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(json_ready(msgspec.to_builtins(content)), indent=1, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")
    return name


def estimate_facts(record: JobRecord) -> dict[str, Any]:
    """What a job's estimate came to, from its record alone."""
    cost = Cost(workers=0)
    cost.add(record.worker_s, record.sim_s, record.in_sumo)
    facts = summary_of(record.job, record.estimate, cost, record.endings)
    del facts["workers"], facts["wall_s"]  # of a sitting, which the record does not know
    found: dict[str, Any] = json_ready(facts)
    return found


def _job(folder: Path, run: Path, name: str, job: str, goal: str, wanted: Wanted) -> Group:
    record, _ = record_of(run, job)
    scenario = record.job.scenario
    if not record.estimate.estimation_rollouts:
        raise InputError(f"{run} has no estimate by {job} yet: nothing can be claimed of it")
    stem = f"{run.resolve().name}-{job}"
    _write_scenario(folder, record)
    facts = estimate_facts(record)
    estimate = write_json(folder, f"estimates/{stem}.json", facts)
    verify = "tailroad verify ."
    claims = [
        Claim(id=f"{goal}.1", says=f"The record of {name} says what it said when it was written, and runs again to the "
              "same bits", file=f"{name}/{RECORD}", command=verify),
        Claim(id=f"{goal}.2", says=f"P(f <= {record.job.gamma:g}) of a rollout: {_p(facts['p'], facts['ci'], facts)}",
              file=estimate, at=("ci",), value=facts["ci"], command=_estimate_again(record)),
    ]  # fmt: skip
    assumptions: tuple[str, ...] = (
        "The scenario's distributions are those of the traffic that the claim is about.",
        "The drivers err as people do in what matters here: see their cards.",
        "The interval holds what sampling leaves open, not what the model leaves open.",
    )
    done = Run(run, [record.job], {}, {}, wanted.workers)
    if len(events_of(record)):
        more, assumed = _of_events(folder, done, record, name, stem, goal, wanted)
        claims += more
        assumptions += assumed
    return Group(
        id=goal,
        says=f"Ego {record.job.ego} in {scenario.name}, by {record.job.method}, seed {record.job.seed}",
        context=(
            f"Scenario {scenario.name}: {scenario.description}",
            f"Measure {scenario.safety.measure}, threshold {record.job.gamma:g}, {record.estimate.rollouts:,} "
            "rollouts.",
            f"Drivers {scenario.drivers.weights}, SHA-256 {record.job.weights_sha256}; ego weights SHA-256 "
            f"{record.job.ego_sha256 or 'none'}.",
        ),
        assumptions=assumptions,
        warnings=tuple(f"{w.name}: {w.message}. {w.remedy}." for w in record.estimate.warnings),
        claims=tuple(claims),
    )


def _estimate_again(record: JobRecord) -> str:
    """The command that runs the job anew, from the folder."""
    scenario = record.job.scenario
    (command,) = words.commands([record.job])
    built_in = words.is_built_in(record.job)
    return (
        command
        if built_in
        else command.replace(f"{scenario.name}.toml", f"scenarios/{scenario.name}.toml", 1)
    )


def _p(p: float | None, ci: Sequence[float], facts: dict[str, Any]) -> str:
    known = "not known" if p is None else significant(p)
    return f"{known}, {level(facts['confidence'])} interval {significant(ci[0])} to {significant(ci[1])}"


def _of_events(
    folder: Path, run: Run, record: JobRecord, name: str, stem: str, goal: str, wanted: Wanted
) -> tuple[list[Claim], tuple[str, ...]]:
    """Claims on how the ego fails, how severe it is and what is preventable, with films of the worst."""
    job = record.job.id
    where = f"--method {job}"
    failures = run.failures(job=job)
    file = write_json(folder, f"failures/{stem}.json", failures)
    claims = [
        Claim(id=f"{goal}.3", says=f"The ways to fail that were met, {len(failures.modes)}, with their shares of p: "
              + "; ".join(f"{mode.name} {mode.share:.0%}" for mode in failures.modes[:3]), file=file, at=("modes",),
              value=json_ready(msgspec.to_builtins(failures.modes)), command=f"tailroad failures {name} {where}"),
    ]  # fmt: skip
    assumed: tuple[str, ...] = ()
    if record.job.scenario.safety.measure == IMPACT:
        severity = run.severity(job=job)
        file = write_json(folder, f"severity/{stem}.json", severity)
        injury = severity.injury
        claims.append(
            Claim(
                id=f"{goal}.4",
                says=f"Serious injury (MAIS3+) in the ego, of a rollout: {significant(injury.p)}, "
                f"{significant(injury.ci[0])} to {significant(injury.ci[1])}",
                file=file,
                at=("injury", "ci"),
                value=list(injury.ci),
                command=f"tailroad severity {name} {where}",
            )
        )
        assumed = severity.assumptions
    prevention = run.prevent(wanted.references, job=job)
    file = write_json(folder, f"prevention/{stem}.json", prevention)
    for i, one in enumerate(prevention.references):
        part = one.unpreventable
        claims.append(
            Claim(
                id=f"{goal}.{5 + i}",
                says=f"Not preventable by {one.reference}: {significant(part.p)}, "
                f"{significant(part.ci[0])} to {significant(part.ci[1])}; preventable share "
                f"{one.preventable.share:.0%}",
                file=file,
                at=("references", i, "unpreventable", "ci"),
                value=list(part.ci),
                command=f"tailroad prevent {name} {where} --reference {one.reference}",
            )
        )
    _films(folder, record, stem, wanted.films)
    return claims, assumed


def _films(folder: Path, record: JobRecord, stem: str, films: int) -> None:
    events = events_of(record)
    (folder / "films").mkdir(exist_ok=True)
    for rank, position in enumerate(events.ranking("f").tolist()[:films], start=1):
        ((x, noise_seed),) = events.drawn([position])
        title = f"{stem}, rank {rank} by f"
        data = export_bytes(record.job, x, noise_seed, title, "mp4")
        (folder / "films" / f"{stem}-rank{rank}.mp4").write_bytes(data)


def _write_scenario(folder: Path, record: JobRecord) -> None:
    """The scenario's file, and the weights that it drives by with their cards."""
    scenario = record.job.scenario
    (folder / "scenarios").mkdir(exist_ok=True)
    (folder / CARDS).mkdir(exist_ok=True)
    (folder / "weights").mkdir(exist_ok=True)
    (folder / "scenarios" / f"{scenario.name}.toml").write_text(toml_of(scenario), encoding="utf-8")
    for path in (weights_file(scenario.drivers.weights), ego_weights(record.job.ego)):
        if path is not None:
            shutil.copyfile(path, folder / "weights" / path.name)
            if (card := path.with_suffix(".json")).is_file():
                shutil.copyfile(card, folder / CARDS / card.name)
