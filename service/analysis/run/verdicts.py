"""What a run's dangerous rollouts come to beyond their probability: preventable or not, and how severe."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from service.analysis.criticality.critical import SHOWN, criticality_of
from service.analysis.criticality.objects import Criticality
from service.analysis.failures.events import Order, events_of
from service.analysis.failures.examine import EXAMINED, Watch, look_away
from service.analysis.failures.rerun import Rerunner
from service.analysis.prevention.conflict import check_reference
from service.analysis.prevention.kept import keep
from service.analysis.prevention.objects import Prevention
from service.analysis.prevention.onset import TTC_S
from service.analysis.prevention.prevent import DEFAULT, prevent
from service.analysis.run.both_drives import write_both
from service.analysis.run.records import record_of
from service.analysis.severity.masses import masses_of
from service.analysis.severity.objects import Severity
from service.analysis.severity.severe import SPEEDS_MPS, examine_severity, severity_of
from service.analysis.trace import Trace
from service.errors import InputError
from service.evaluation.cores import core_count
from service.world.egos.here import ego_name


def prevention_of(
    run: Path,
    job: str | None = None,
    references: Sequence[str] = DEFAULT,
    order: Order = "likelihood",
    most: int = EXAMINED,
    onset_ttc_s: float = TTC_S,
    workers: int | None = None,
    watch: Watch = look_away,
) -> Prevention:
    """What part of p of a run's job reference drivers would have prevented; the arguments as of `prevent`.

    job: default the one with most dangerous rollouts. InputError for an unknown reference driver.
    """
    names = tuple(dict.fromkeys(ego_name(name) for name in references))
    if not names:
        raise InputError("no reference driver: give one at least")
    if not onset_ttc_s > 0.0:
        raise InputError(
            f"onset_ttc_s = {onset_ttc_s}: give seconds above 0; infinite for the rollout's start"
        )
    for name in names:
        check_reference(name)
    record, _ = record_of(run, job)
    found = prevent(run.name, record, names, order, most, onset_ttc_s, workers or core_count(), watch)
    keep(run, found)
    return found


def film_of(
    run: Path,
    rank: int,
    path: Path,
    job: str | None = None,
    reference: str = DEFAULT[0],
    order: Order = "likelihood",
    onset_ttc_s: float = TTC_S,
) -> tuple[Trace, Trace, float]:
    """Write a film of the dangerous rollout at that rank, as it was and below it with the reference driver; both traces
    and when he takes over (s). InputError where there is no such rank or reference."""
    check_reference(reference)
    record, _ = record_of(run, job)
    events = events_of(record)
    if not 1 <= rank <= len(events):
        raise InputError(f"rank {rank}: {run} has {len(events)} dangerous rollouts, counted from 1")
    ((x, noise_seed),) = events.drawn([int(events.ranking(order)[rank - 1])])
    title = f"{run.name}, rank {rank} by {order}"
    return write_both(record.job, x, noise_seed, reference, onset_ttc_s, path, title)


def severity_of_run(
    run: Path,
    job: str | None = None,
    speeds_mps: Sequence[float] = SPEEDS_MPS,
    masses: Mapping[str, float] | None = None,
    order: Order = "likelihood",
    most: int = EXAMINED,
    workers: int | None = None,
    watch: Watch = look_away,
) -> Severity:
    """How severe the contacts of a run's job are; the arguments as of `severity_of` and `prevention_of`.

    most: dangerous rollouts at most that are run again; of a record that has their contacts only the listed ones are
    """
    record, _ = record_of(run, job)
    masses_of(record.job.scenario, masses)  # wrong ones are told before anything is run
    with Rerunner(record.job, workers or core_count()) as rerunner:
        examined = examine_severity(events_of(record), rerunner, order, most, run, watch, masses)
    return severity_of(run.name, examined, order, speeds_mps, masses)


def criticality_of_run(
    run: Path,
    job: str | None = None,
    order: Order = "likelihood",
    limit: int = SHOWN,
    workers: int | None = None,
) -> Criticality:
    """Criticality of the first dangerous rollouts of a run's job; the arguments as of `criticality_of`."""
    record, _ = record_of(run, job)
    with Rerunner(record.job, workers or core_count()) as rerunner:
        return criticality_of(run.name, record, rerunner, order, limit)
