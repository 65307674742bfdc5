"""What is answered when something is wrong: problem details (RFC 9457), and which error becomes which."""

import msgspec

from ce import CeError
from policies.drivers import WeightsError
from service.errors import InputError, ScenarioError, StoreError, TailroadError
from service.remote.api.objects import Problem, Wrong
from service.remote.fleet.errors import NoSuchJob
from sumo_nets.errors import NetworkError

URN = "urn:tailroad:problem:"
TITLES = {  # kind -> HTTP status, title
    "bad-request": (400, "The request cannot be understood"),
    "bad-parameter": (400, "A parameter is not as it must be"),
    "bad-body": (400, "The body is not as it must be"),
    "bad-scenario": (422, "The scenario cannot be used"),
    "bad-job": (422, "The job cannot be run as asked"),
    "forbidden": (403, "This side may only read"),
    "no-such-key": (404, "There is no such key"),
    "no-such-job": (404, "There is no such job"),
    "not-found": (404, "There is no such thing"),
    "too-large": (413, "The request is too large"),
    "too-many-requests": (429, "Too many requests"),
    "too-many-jobs": (429, "Too many open jobs"),
    "working": (503, "The answer is being computed"),
    "busy": (503, "Too much is asked at once"),
    "unavailable": (503, "The service cannot answer now"),
    "internal": (500, "The service failed"),
}
MAX_DETAIL = 2000  # characters


class ApiError(TailroadError):
    """A request that is answered with a problem. kind: one of TITLES."""

    def __init__(
        self,
        kind: str,
        detail: str,
        errors: tuple[Wrong, ...] = (),
        retry_after_s: float | None = None,
    ):
        super().__init__(detail)
        status, title = TITLES[kind]
        self.problem = Problem(URN + kind, title, status, detail[:MAX_DETAIL], "", errors, retry_after_s)


def problem_of(error: Exception, instance: str) -> Problem:
    """The problem that an error is told as; a defect of ours says nothing of its inside."""
    return msgspec.structs.replace(_problem_of(error), instance=instance)


def _problem_of(error: Exception) -> Problem:
    if isinstance(error, ApiError):
        return error.problem
    if isinstance(error, NoSuchJob):
        return ApiError("no-such-job", str(error)).problem
    if isinstance(error, ScenarioError):
        wrong = Wrong(error.key, short(repr(error.given)), error.remedy)
        return ApiError("bad-scenario", str(error), (wrong,)).problem
    if isinstance(error, StoreError):
        return ApiError("unavailable", str(error), retry_after_s=1.0).problem
    if isinstance(error, InputError | CeError | WeightsError | NetworkError):
        return ApiError("bad-job", str(error)).problem
    return ApiError("internal", "the service failed on this request; its log tells more").problem


def short(text: str, longest: int = 200) -> str:
    """A value as given, cut where it is long."""
    return text if len(text) <= longest else f"{text[:longest]}..."
