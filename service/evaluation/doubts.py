"""What a record has to say of an estimate that the estimator cannot know: warnings beside its own."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

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


def not_repeatable(repeated: Iterable[dict[str, Any]]) -> tuple[ce.EstimateWarning, ...]:
    """Of the ego, where rollouts that were run again came to something else; repeated: the job's events of that kind,
    as `service.remote.fleet.repeats` tells them."""
    runs, others = {"same": 0, "other": 0}, {"same": 0, "other": 0}
    for one in repeated:
        runs[one["where"]] += one["repeated"]
        others[one["where"]] += one["differed"]
    if not any(others.values()):
        return ()
    message = (
        f"{sum(others.values())} of {sum(runs.values())} rollouts that were run again came to another f or ending "
        f"({others['same']} of {runs['same']} on the worker that had run them, {others['other']} of {runs['other']} on "
        "another one): f depends on what the ego did before, on its timing, or on numbers of its own"
    )
    remedy = (
        "have the ego forget everything when a rollout begins, and draw from the rollout's seed alone; until then p is "
        "that of whatever state it was in"
    )
    return (ce.EstimateWarning("ego-not-repeatable", message, remedy),)


def told(name: str, message: str, remedy: str) -> str:
    """A doubt as one sentence."""
    return f"{name.replace('-', ' ').capitalize()}: {message}; {remedy}"


def with_doubts(estimate: ce.Estimate, doubts: Sequence[ce.EstimateWarning]) -> ce.Estimate:
    """The estimate with these warnings before its own."""
    return replace(estimate, search_warnings=(*doubts, *estimate.search_warnings)) if doubts else estimate
