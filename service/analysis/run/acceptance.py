"""`tailroad accept`: a case's verdicts from the runs that its file names."""

from pathlib import Path

from service.analysis.acceptance.accept import accept
from service.analysis.acceptance.case import Case, Scenario, load_case
from service.analysis.acceptance.measured import quantity_of
from service.analysis.acceptance.objects import Acceptance
from service.analysis.acceptance.quantity import Quantity
from service.analysis.prevention.objects import Prevention
from service.analysis.run.records import record_of
from service.analysis.run.verdicts import prevention_of, severity_of_run
from service.analysis.severity.objects import Severity
from service.evaluation.record import JobRecord


def accept_case(case: Case | str | Path, workers: int | None = None) -> Acceptance:
    """The verdicts of a case, or of one in a file.

    workers: processes that run contacts again, where a claim is about their severity or preventability
    """
    if not isinstance(case, Case):
        case = load_case(Path(case))
    folder = Path(case.folder)
    records: dict[str, JobRecord] = {}

    def severities(run: Path, job: str | None, delta_v_mps: float) -> Severity:
        return severity_of_run(run, job, (delta_v_mps,), workers=workers)

    def preventions(run: Path, job: str | None, reference: str) -> Prevention:
        return prevention_of(run, job, (reference,), workers=workers)

    def probability(scenario: Scenario, measure: str) -> tuple[Quantity, tuple[str, ...]]:
        if scenario.run and scenario.name not in records:
            records[scenario.name] = record_of(folder / scenario.run, scenario.job)[0]
        return quantity_of(scenario, measure, folder, records.get(scenario.name), severities, preventions)

    return accept(case, probability)
