"""How the ego fails: the failure modes of a run, rollouts of them worth drawing, and how far the ego drives."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from service.analysis.coverage.cover import coverage_of
from service.analysis.coverage.objects import Coverage
from service.analysis.exposure import Exposure, exposure_of
from service.analysis.failures.examine import examine
from service.analysis.failures.find import Found, find_failures
from service.analysis.failures.objects import Failure, Failures
from service.analysis.failures.rerun import Open
from service.analysis.failures.tell import failure_of
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned
from service.analysis.prevention.kept import kept
from service.analysis.prevention.objects import Prevention
from service.analysis.severity.objects import Severity
from service.analysis.severity.severe import severity_of
from service.analysis.trace import Trace
from service.evaluation.record import JobRecord

EXAMINED = 200  # dangerous rollouts at most that a report has run again and grouped: shares to within 7% of p


@dataclass(frozen=True)
class ShownRollout:
    """A dangerous rollout, run once more.

    trace: None where the run failed, for which `failure.error` has the reason
    threat: the vehicle that the smallest value is to, a row of the scenario's vehicles, None where it is background
        traffic
    """

    record: JobRecord
    failure: Failure
    trace: Trace | None

    @property
    def threat(self) -> int | None:
        return None if self.failure.motion is None else self.failure.motion.other


@dataclass(frozen=True)
class Findings:
    """What was seen by running rollouts again; nothing of it where none was."""

    failures: Failures | None = None
    rollouts: tuple[ShownRollout, ...] = ()
    exposure: Exposure | None = None
    learned: dict[str, Learned] = field(default_factory=dict)  # by job
    severity: Severity | None = None  # where there were contacts
    prevention: Prevention | None = None  # where `tailroad prevent` was asked before
    coverage: Coverage | None = None


def findings_of(
    run: str,
    record: JobRecord,
    drawn: int,
    opened: Open,
    folder: Path | None,
    confidence: float = 0.95,
) -> Findings:
    """Run dangerous rollouts of a job again, and some of P0; `drawn`: how many to return the traces of.

    opened: rerunners of jobs
    folder: where what was run again is remembered
    """
    with opened(record.job) as rerunner:
        exposure = exposure_of(record.job, record.problem.base, rerunner, confidence, folder)
        found = find_failures(run, record, rerunner, limit=drawn, most=EXAMINED, folder=folder)
        shown = worth_drawing(found, drawn)
        traced = examine(found.examined.events, rerunner, (), 0, shown, folder)
        learned = learned_of(record.job.id, record, rerunner)
    rank = {position: i for i, position in enumerate(found.ranking, start=1)}
    touched = any(found.examined.reruns[i].contact is not None for i in found.examined.sample.tolist())
    asked = None if folder is None else kept(folder, record.job.id, record.estimate.gamma, len(traced.events))
    rollouts = [
        ShownRollout(
            record,
            failure_of(traced.events, i, traced.reruns[i], rank[i], found.modes[i]),
            traced.reruns[i].trace,
        )
        for i in shown
    ]
    return Findings(
        found.failures,
        tuple(rollouts),
        exposure,
        {record.job.id: learned},
        severity_of(run, found.examined) if touched else None,
        None if asked is None else msgspec.structs.replace(asked, rollouts=()),
        coverage_of(run, record),
    )


def worth_drawing(found: Found, count: int) -> list[int]:
    """Positions of an example of each mode, the largest share first, then of the first in rank."""
    examples = [found.ranking[mode.example.rank - 1] for mode in found.failures.modes]
    first = found.ranking[: count + len(examples)]
    return list(dict.fromkeys([*examples[:count], *first]))[:count]


def most_informative(records: Sequence[JobRecord]) -> JobRecord:
    """The job that has met the most dangerous rollouts, in effective numbers; as `tailroad failures` takes it."""
    return max(records, key=lambda record: record.estimate.ess)
