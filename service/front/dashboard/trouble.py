"""What a page says when the service refuses or does not answer: what happened, and what to do."""

from dataclasses import dataclass

from service.remote.api.objects import Wrong
from service.remote.client import NoAnswer, Refused

AGAIN_S = 2.0
LONG_S = 3.0  # for what takes long; asking holds one of the service's threads for a while
WORKING = "Rollouts are run once more for this; it shows as soon as they are done."
PASSING = {
    "working": "Being computed",
    "busy": "The service is busy",
    "too-many-requests": "The service is busy",
}


@dataclass(frozen=True)
class Trouble:
    """What an error page says.

    again_s: the same may go well after so many seconds
    working: it only takes a while
    """

    status: int
    title: str
    text: str
    hint: str = ""
    errors: tuple[Wrong, ...] = ()
    again_s: float | None = None
    working: bool = False


def trouble_of(error: Exception) -> Trouble:
    """As a page tells it."""
    if isinstance(error, NoAnswer):
        return Trouble(503, "The service does not answer", str(error),
                       "This page goes on by itself when it is back.", again_s=AGAIN_S)  # fmt: skip
    if not isinstance(error, Refused):
        raise error
    problem, kind = error.problem, error.kind
    if kind in PASSING:
        again_s = problem.retry_after_s or AGAIN_S
        if kind == "working":
            return Trouble(202, PASSING[kind], WORKING, again_s=max(again_s, LONG_S), working=True)
        return Trouble(503, PASSING[kind], problem.detail, again_s=again_s)
    if kind == "no-such-key":
        return Trouble(501, "This service cannot tell that", problem.detail,
                       "It is older than this dashboard: update tailroad where `tailroad serve` runs.")  # fmt: skip
    if kind == "no-such-job":
        return Trouble(404, problem.title, problem.detail, "The page “Jobs” lists those that there are.")
    again = problem.retry_after_s if problem.status in (429, 503) else None
    return Trouble(problem.status, problem.title, problem.detail, errors=problem.errors, again_s=again)


def failed_part(label: str) -> Trouble:
    """What stands in the place of a part that the dashboard could not draw."""
    return Trouble(500, f"“{label}” cannot be shown", "The dashboard failed on this part alone; the jobs go on.",
                   "Load the page again. If it stays, send the dashboard's log, which names the error, with a report "
                   "of it; `tailroad show JOB` tells the same in a terminal.")  # fmt: skip
