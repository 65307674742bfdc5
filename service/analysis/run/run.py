"""A run on this machine: what was estimated, and everything that can be made of its record."""

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import polars as pl

import ce
from service.analysis.coverage.cover import coverage_of
from service.analysis.coverage.domain import load_domain
from service.analysis.coverage.objects import Coverage
from service.analysis.criticality.critical import SHOWN
from service.analysis.criticality.objects import Criticality
from service.analysis.estimated import Estimated
from service.analysis.exports import SUFFIXES, export_bytes
from service.analysis.exposure import exposure_of
from service.analysis.failures.events import Order, events_of
from service.analysis.failures.examine import EXAMINED, Watch, look_away
from service.analysis.failures.find import find_failures
from service.analysis.failures.objects import Failures
from service.analysis.failures.rerun import Open, Rerunner
from service.analysis.notebook import estimates_html
from service.analysis.prevention.objects import Prevention
from service.analysis.prevention.onset import TTC_S
from service.analysis.prevention.prevent import DEFAULT
from service.analysis.report import write_report
from service.analysis.risk import Risk, risk_of
from service.analysis.rollout_files import RolloutFiles
from service.analysis.run.records import record_of, write_file
from service.analysis.run.verdicts import criticality_of_run, prevention_of, severity_of_run
from service.analysis.severity.objects import Severity
from service.analysis.severity.severe import SPEEDS_MPS
from service.errors import InputError
from service.evaluation.endings import endings_of
from service.evaluation.job import Job, Problem
from service.evaluation.path_record import told_of_paths
from service.evaluation.pool import OUTCOME_NAMES
from service.evaluation.record import JobRecord
from service.evaluation.store import RunDirectory
from service.evaluation.store.export import table_of
from service.evaluation.summary import Cost, Ending, comparisons, json_ready, summary_of


class Run:
    """A run directory that has been run to its end.

    path: of the directory; jobs: in it; results, costs: of each by id; workers: processes that runs again use.
    """

    def __init__(
        self,
        path: Path,
        jobs: Sequence[Job],
        results: dict[str, ce.Estimate],
        costs: dict[str, Cost],
        workers: int,
    ):
        self.path, self.jobs, self.workers = path, tuple(jobs), workers
        self.results, self.costs = results, costs

    def __repr__(self) -> str:
        e = self.estimate
        return f"<Run {self.path}: {len(self.jobs)} job(s); {e.job}: {e.in_short}>"

    def _repr_html_(self) -> str:
        return estimates_html(list(self.estimates.values()), str(self.path))

    @cached_property
    def estimates(self) -> dict[str, Estimated]:
        """What each job came to, by id."""
        return {
            job.id: estimated(job, self.results[job.id], self.costs[job.id], self.endings[job.id])
            for job in self.jobs
        }

    @cached_property
    def endings(self) -> dict[str, tuple[Ending, ...]]:
        """How each job's rollouts ended, with probabilities by the weights of its estimate, by id."""
        with RunDirectory.open(self.path) as store:
            return {job.id: _endings(store, job, self.results[job.id]) for job in self.jobs}

    @property
    def estimate(self) -> Estimated:
        """What the run came to; of several jobs, the first."""
        return self.estimates[self.jobs[0].id]

    @property
    def imprecise(self) -> bool:
        """Whether the precision asked for was not reached."""
        return any(e.rel_error is not None and not e.converged for e in self.results.values())

    def save(self, risks: dict[str, Risk]) -> dict[str, Any]:
        """Write result.json into the run directory; what it says: one estimate, or several and their comparison."""
        told = [
            summary_of(job, self.results[job.id], self.costs[job.id], self.endings[job.id])
            | {"risk": json_ready(msgspec.to_builtins(risks.get(job.id)))}
            for job in self.jobs
        ]
        for job, one in zip(self.jobs, told, strict=True):
            if job.name:
                one["job"] = job.id
        compared = comparisons(self.jobs, self.results)
        result = told[0] if len(told) == 1 else {"estimates": told, "comparison": compared}
        (self.path / "result.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
        return result

    def record(
        self, job: str | None = None, gamma: float | None = None, outcome: str | None = None
    ) -> JobRecord:
        """The record of a job, replayed.

        gamma: another threshold than its own
        outcome: the event is that a rollout ends so
        """
        return record_of(self.path, job, gamma, outcome)[0]

    def to_polars(self) -> pl.DataFrame:
        """Every rollout, a row each: job, phase, iteration, row, f, outcome, steps, error, worker, contact."""
        with RunDirectory.open(self.path) as store:
            return table_of({job.id: store.record.with_origins(job.id) for job in store.jobs}, OUTCOME_NAMES)

    def report(self, path: str | Path | None = None, opened: Open | None = None) -> Path:
        """Write the HTML report to `path` (default: report.html in the run directory) and its facts beside it, as
        .json; the page's path.

        opened: rerunners of jobs that are there already
        """
        with RunDirectory.open(self.path) as store:
            page = None if path is None else Path(path)
            return write_report(store, page, workers=self.workers, opened=opened)

    def risks(self, opened: Open = Rerunner) -> dict[str, Risk]:
        """The estimates as rates per million km, by job. WorkerError where no rollout can be run to measure how far the
        ego drives.

        opened: rerunners of jobs that are there already
        """
        job = self.jobs[0]
        with opened(job) as rerunner:
            exposure = exposure_of(job, Problem(job).base, rerunner, folder=self.path)
        if exposure is None:
            return {}
        return {job.id: risk_of(job, self.results[job.id], exposure) for job in self.jobs}

    def failures(
        self,
        limit: int = 20,
        by: Order = "likelihood",
        job: str | None = None,
        examine: int = EXAMINED,
        watch: Watch = look_away,
        outcome: str | None = None,
    ) -> Failures:
        """How the ego fails: the failure modes, and the first `limit` dangerous rollouts in the order asked for.

        by: likelihood, weight or f
        job: default the one with most dangerous rollouts
        examine: dangerous rollouts at most that are run again and grouped
        watch: told of (done, total)
        outcome: the rollouts that ended so ("collision", "off-road", ...), instead of those with f <= gamma
        """
        record, _ = record_of(self.path, job, None, outcome)
        with Rerunner(record.job, self.workers) as rerunner:
            found = find_failures(self.path.name, record, rerunner, by, limit, examine, self.path, watch)
        return found.failures

    def prevent(
        self,
        references: Sequence[Any] = DEFAULT,
        by: Order = "likelihood",
        job: str | None = None,
        examine: int = EXAMINED,
        onset_ttc_s: float = TTC_S,
        watch: Watch = look_away,
    ) -> Prevention:
        """What part of p a competent driver would have prevented: each dangerous rollout is driven again with the same
        draw, the ego replaced from the onset of the conflict on.

        references: reference drivers (`policies.references`) or egos; by, job, examine, watch: as of `failures`;
        onset_ttc_s: time to collision at which a conflict begins, infinite for the rollout's start.
        """
        return prevention_of(self.path, job, references, by, examine, onset_ttc_s, self.workers, watch)

    def severity(
        self,
        delta_v_mps: Sequence[float] = SPEEDS_MPS,
        masses: Mapping[str, float] | None = None,
        by: Order = "likelihood",
        job: str | None = None,
        examine: int = EXAMINED,
        watch: Watch = look_away,
    ) -> Severity:
        """How severe the contacts are: p(contact), p(delta-v at least so much) and p(MAIS3+) by the same weights.

        delta_v_mps: changes of the ego's velocity; masses: of vehicles by name, kg, in place of their class's; by, job,
        examine, watch: as of `failures`.
        """
        return severity_of_run(self.path, job, delta_v_mps, masses, by, examine, self.workers, watch)

    def coverage(self, domain: str | Path | None = None, job: str | None = None) -> Coverage:
        """How the rollouts cover the operational design domain: shares of P0, of rollouts and of p by cell of road,
        weather, light and traffic, and cells never seen. Nothing is run for it.

        domain: a file that declares one (`service.analysis.coverage.domain`); job: as of `failures`.
        """
        declared = None if domain is None else load_domain(Path(domain))
        return coverage_of(self.path.name, record_of(self.path, job)[0], declared)

    def criticality(
        self, limit: int = SHOWN, by: Order = "likelihood", job: str | None = None
    ) -> Criticality:
        """The first `limit` dangerous rollouts by TTC, WTTC, TTB, TTR, BTN, TET and TIT; each is run again.

        by, job: as of `failures`.
        """
        return criticality_of_run(self.path, job, by, limit, self.workers)

    def replay(
        self, rank: int, by: Order = "likelihood", job: str | None = None, outcome: str | None = None
    ) -> "Replay":
        """The dangerous rollout at that rank of `failures` with the same `by`, `job` and `outcome`, to be looked at."""
        return Replay(self.path, record_of(self.path, job, None, outcome)[0], rank, by)


def _endings(store: RunDirectory, job: Job, estimate: ce.Estimate) -> tuple[Ending, ...]:
    told = told_of_paths(store, job.id, estimate) if isinstance(estimate, ce.PathEstimate) else None
    return endings_of(estimate, store.all_chunks(job.id), told)


def estimated(job: Job, estimate: ce.Estimate, cost: Cost, endings: tuple[Ending, ...]) -> Estimated:
    """What a job came to."""
    return msgspec.convert(json_ready(summary_of(job, estimate, cost, endings)) | {"job": job.id}, Estimated)


class Replay(RolloutFiles):
    """A dangerous rollout once more, in every form that it can be looked at. Each method runs it again, in a process of
    its own, writes a file and gives back its path."""

    def __init__(self, run: Path, record: JobRecord, rank: int, by: Order = "likelihood"):
        self.record, self.rank, self.by = record, rank, by
        self.events = events_of(record)
        if not len(self.events):
            raise InputError(f"{run} has no dangerous rollout by {record.job.id}: there is none to replay")
        if not 1 <= rank <= len(self.events):
            raise InputError(
                f"rank {rank}: {run} has {len(self.events)} dangerous rollouts by {record.job.id}, counted from 1"
            )
        self.position = int(self.events.ranking(by)[rank - 1])
        self.title = f"{run.name}, rank {rank} by {by}"

    def __repr__(self) -> str:
        return f"<Replay {self.title}: f = {self.f:.3g}>"

    @property
    def f(self) -> float:
        """Its safety value, on record."""
        return float(self.events.f[self.position])

    def _write(self, form: str, path: str | Path) -> Path:
        return write_file(Path(path), SUFFIXES[form], lambda: self._bytes(form))

    def _bytes(self, form: str) -> bytes:
        ((x, noise_seed),) = self.events.drawn([self.position])
        return export_bytes(self.record.job, x, noise_seed, self.title, form)
