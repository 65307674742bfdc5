"""From a job's record to its failures: rank, run again, group, count."""

from dataclasses import dataclass
from pathlib import Path

import ce
from service.analysis.failures.events import Events, Order, events_of
from service.analysis.failures.examine import EXAMINED, Examined, Watch, examine, look_away, modes_by_position
from service.analysis.failures.objects import Failures
from service.analysis.failures.question import question_of
from service.analysis.failures.rerun import Rerunner
from service.analysis.failures.tell import failure_of, same_bits, sample_causes, sample_modes
from service.evaluation.record import JobRecord


@dataclass(frozen=True)
class Found:
    """The failures of a job, and what they were found from.

    ranking: positions of all dangerous rollouts in the order asked for
    modes: of each that was examined
    """

    failures: Failures
    examined: Examined
    ranking: list[int]
    modes: dict[int, str]


def find_failures(
    run: str,
    record: JobRecord,
    rerunner: Rerunner,
    order: Order = "likelihood",
    limit: int = 20,
    most: int = EXAMINED,
    folder: Path | None = None,
    watch: Watch = look_away,
) -> Found:
    """The failures of a job: its modes, and the first `limit` of its dangerous rollouts in the order asked for.

    run: what the run is called
    folder: where to remember what was run again; the rest as in `examine`
    """
    events = events_of(record)
    rank = events.ranks(order)
    ranking = list(rank)
    examined = examine(events, rerunner, ranking[:limit], most, (), folder, watch)
    (modes,) = modes_by_position([examined])
    job, estimate = record.job, record.estimate
    failures = Failures(
        **question_of(run, record),
        method=job.method,
        outcome=record.outcome or "",
        confidence=estimate.confidence,
        p=estimate.p if estimate.estimation_rollouts else None,
        ci=estimate.ci,
        order=order,
        events=len(events),
        examined=examined.sample.size,
        modes=tuple(sample_modes(examined, modes, rank)),
        failures=tuple(failure_of(events, i, examined.reruns[i], rank[i], modes[i]) for i in ranking[:limit]),
        notes=tuple(notes_on(examined)),
        causes=tuple(sample_causes(examined, rank)),
    )
    return Found(failures, examined, ranking, modes)


def _replications(events: Events) -> int:
    return 0 if events.replicated is None else events.replicated.size


def notes_on(examined: Examined) -> list[str]:
    """What bears on how far an examination can be relied on."""
    events, again = examined.events, examined.reruns
    notes = []
    if not len(events):
        what = "had f <= gamma" if events.record.outcome is None else f"ended with {events.record.outcome}"
        notes.append(f"No rollout of the estimation has {what}.")
    if examined.sample.size < len(events):
        notes.append(
            f"Modes, shares and their p are of {'the first ' if events.replication is None else ''}"
            f"{examined.sample.size} of {len(events)} dangerous rollouts."
        )
    if isinstance(events.record.estimate, ce.PathEstimate):
        notes.append(
            "The rollouts are paths that were kept and split by their importance: each counts with its own weight, and "
            f"the intervals of shares come from the spread over {_replications(events)} independent batches."
        )
    elif isinstance(events.record.estimate, ce.ReplicatedEstimate):
        notes.append(
            "The rollouts come from Markov chains: each counts with its part of the estimate, and the intervals of "
            f"shares come from the spread over {_replications(events)} independent replications."
        )
    differing = sum(not same_bits(a.f, float(events.f[i])) for i, a in again.items())
    if differing:
        notes.append(
            f"{differing} of {len(again)} rollouts did not come out the same to the bit when run again: another "
            "version of tailroad, or of what it uses, made the run."
        )
    return notes
