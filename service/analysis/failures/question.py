"""What every finding on a run says first: which run, and what was asked."""

from typing import Any

from service.evaluation.record import JobRecord
from service.world.scenario.measures import measure_kind


def question_of(run: str, record: JobRecord) -> dict[str, Any]:
    """Run, job, scenario, ego, threshold and its unit.

    run: what the run is called
    """
    job = record.job
    return {
        "run": run,
        "job": job.id,
        "scenario": job.scenario.name,
        "ego": job.ego,
        # of a record of rollouts that ended in one way, the estimate's is that of another event
        "gamma": record.estimate.gamma if record.outcome is None else job.gamma,
        "unit": measure_kind(job.scenario.safety.measure).unit,
    }
