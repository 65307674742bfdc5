"""What a record has to say of an estimate that the estimator cannot know: warnings beside its own."""

from collections.abc import Sequence
from dataclasses import replace

import ce

DISPUTED = ce.EstimateWarning(
    "disputed",
    "workers disagree on some of its rollouts",
    "wait: a replay on the service's machine settles it",
)

DOUBTS = (DISPUTED.name, "job-failed")  # under which p is said with the doubt beside it


def failed_job(reason: str) -> ce.EstimateWarning:
    """Of a job that has failed."""
    return ce.EstimateWarning(
        "job-failed", f"the job has failed: {reason}", "mend the cause and submit it again"
    )


def told(name: str, message: str, remedy: str) -> str:
    """A doubt as one sentence."""
    return f"{name.replace('-', ' ').capitalize()}: {message}; {remedy}"


def with_doubts(estimate: ce.Estimate, doubts: Sequence[ce.EstimateWarning]) -> ce.Estimate:
    """The estimate with these warnings before its own."""
    return replace(estimate, search_warnings=(*doubts, *estimate.search_warnings)) if doubts else estimate
