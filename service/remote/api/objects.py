"""What the API answers, as it goes over the wire. Numbers that are not known, not finite or not there are null."""

from typing import Any, Literal

import msgspec

from service.analysis.estimated import Estimated
from service.remote.api.rollout_objects import CameraPicture, Listing, Rollouts, RolloutView
from service.remote.fleet.views import RunningChunk, Tally

__all__ = [
    "OVER",
    "STATUSES",
    "About",
    "CameraPicture",
    "Course",
    "Curve",
    "CurvePoint",
    "Done",
    "Ego",
    "Egos",
    "Endpoint",
    "Estimate",
    "EstimateStep",
    "Event",
    "Events",
    "Health",
    "Iterations",
    "Job",
    "JobScenario",
    "Jobs",
    "Listing",
    "Parameter",
    "Problem",
    "RolloutView",
    "Rollouts",
    "RunningChunk",
    "ScenarioEntry",
    "Scenarios",
    "SearchStep",
    "Tally",
    "Worker",
    "Workers",
    "Wrong",
]

STATUSES = ("running", "paused", "done", "cancelled", "failed", "needs-restart")
OVER = ("done", "cancelled", "failed", "needs-restart")


class _Body(msgspec.Struct, frozen=True, kw_only=True):
    pass


class Wrong(msgspec.Struct, frozen=True):
    """One thing that is wrong: its name, what was given, what was expected."""

    name: str
    given: str
    expected: str


class Problem(msgspec.Struct, frozen=True, omit_defaults=True):
    """Problem details as of RFC 9457.

    retry_after_s: the same request may succeed after so many seconds
    """

    type: str
    title: str
    status: int
    detail: str
    instance: str = ""
    errors: tuple[Wrong, ...] = ()
    retry_after_s: float | None = None


class Job(_Body, frozen=True):
    """A job and how far it is.

    rollouts: in the record
    leases: chunks that are out now
    refusals: workers that cannot run it, and why
    """

    id: str
    number: int  # in the order of submission
    label: str
    scenario: str
    ego: str
    gamma: float
    method: str
    options: dict[str, Any]
    seed: int
    priority: int
    weight: float
    at: str  # when it was submitted, UTC
    status: Literal["running", "paused", "done", "cancelled", "failed", "needs-restart"]
    reason: str
    rollouts: int | None
    leases: int
    refusals: dict[str, str]
    unit: str = ""  # of gamma: that of the scenario's safety measure
    measure: str = ""
    noise_mode: str = ""
    disputed: bool = False
    max_failed: float = 1.0
    note: str = ""  # what people say of it
    tags: tuple[str, ...] = ()
    archived: bool = False  # put away: left out of lists unless asked for


class Jobs(_Body, frozen=True):
    """A page of jobs.

    next: give it as `after` for the next page; null: this was the last
    """

    items: tuple[Job, ...]
    next: int | None


class Worker(_Body, frozen=True):
    """A worker that is connected, or (quarantine: why) was found wrong.

    now: the chunks that it has
    """

    id: str
    procs: int
    egos: tuple[str, ...]
    camera: bool
    gpu: bool
    host: str
    versions: dict[str, str]
    leases: int
    chunks: int
    rollouts: int
    worker_s: float
    quarantine: str
    now: tuple[RunningChunk, ...]


class Workers(_Body, frozen=True):
    """A page of workers.

    next: give it as `after` for the next page
    """

    items: tuple[Worker, ...]
    next: str | None


class ScenarioEntry(_Body, frozen=True):
    """A scenario that jobs may name."""

    name: str
    description: str
    vehicles: int
    horizon_s: float
    step_s: float
    built_in: bool


class Scenarios(_Body, frozen=True):
    """Scenarios that jobs may name; roads and weights that scenarios given by value may name."""

    items: tuple[ScenarioEntry, ...]
    roads: tuple[str, ...]
    weights: tuple[str, ...]


class JobScenario(_Body, frozen=True):
    """A job's scenario. text: of a scenario file that submits it again; listed: whether its name alone does, with
    measure and noise_mode beside it where they are not null."""

    job: str
    name: str
    listed: bool
    measure: str | None
    noise_mode: str | None
    text: str


class Ego(_Body, frozen=True):
    """An ego that jobs may name.

    kind: built in, a class that the owner permits, or a service on the network
    """

    name: str
    kind: Literal["built-in", "class", "service"]


class Egos(_Body, frozen=True):
    items: tuple[Ego, ...]


class Estimate(Estimated, frozen=True, kw_only=True):
    """p = P0(f(X) <= gamma) from what is complete, a batch's first rows at once; as `tailroad estimate --json` prints
    it."""

    status: str


class CurvePoint(_Body, frozen=True):
    gamma: float
    p: float | None
    std_error: float | None
    ci: tuple[float | None, float | None]
    events: int
    ess: float | None


class Curve(_Body, frozen=True):
    """p for many thresholds from the same rollouts; the intervals are pointwise."""

    job: str
    confidence: float
    points: tuple[CurvePoint, ...]


class Course(_Body, frozen=True):
    """The estimate at the job's gamma as its rollouts came in, in columns of the same length. training: rollouts of the
    search, before all of them; rollouts: after how many of those that followed. Replications have one point, as they
    count only when all of their rollouts are there."""

    job: str
    confidence: float
    training: int
    rollouts: tuple[int, ...]
    p: tuple[float | None, ...]
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]


class SearchStep(_Body, frozen=True, tag_field="phase", tag="train"):
    """One iteration of the search: ce.TrainingRecord."""

    number: int
    iteration: int
    rollouts: int
    gamma_k: float | None
    quantile: float | None
    elites: int
    ess: float | None
    max_weight_share: float | None
    events: int
    infinite: int
    failed: int
    step: float | None
    kl: float | None
    summary: dict[str, float | None]


class EstimateStep(_Body, frozen=True, tag_field="phase", tag="estimate"):
    """The estimate after one more batch: ce.EstimationRecord."""

    number: int
    iteration: int
    rollouts: int
    p: float | None
    std_error: float | None
    low: float | None
    high: float | None
    ess: float | None
    max_weight_share: float | None
    events: int
    failed: int


class Iterations(_Body, frozen=True):
    """A page of what the batches came to."""

    items: tuple[SearchStep | EstimateStep, ...]
    next: int | None


class Event(_Body, frozen=True):
    """Something that a job told. Those with a number are kept and numbered 1, 2, ... for each job; number 0: told once,
    not kept (progress, iteration)."""

    job: str
    number: int
    kind: str
    at: str
    body: dict[str, Any]


class Events(_Body, frozen=True):
    """A page of the kept events."""

    items: tuple[Event, ...]
    next: int | None


class Done(_Body, frozen=True):
    """The order was taken; the job's status event tells when it is carried out."""

    job: str
    order: Literal["cancel", "pause", "resume", "note"]


class Health(_Body, frozen=True):
    """Whether the service can do its work.

    open_jobs: not over
    """

    status: Literal["ok"]
    tailroad: str
    uptime_s: float
    workers: int
    procs: int
    open_jobs: int


class Parameter(_Body, frozen=True):
    name: str
    expected: str
    default: Any


class Endpoint(_Body, frozen=True):
    """A key, below tailroad/v1/.

    body, answer: names of schemas
    media: the answer's media types, where it is a file and not JSON (answer is null)
    """

    key: str
    does: str
    parameters: tuple[Parameter, ...]
    body: str | None
    answer: str | None
    media: tuple[str, ...]


class About(_Body, frozen=True):
    """What this API takes and answers; schemas are at tailroad/v1/schemas/NAME."""

    tailroad: str
    endpoints: tuple[Endpoint, ...]
    schemas: tuple[str, ...]
    limits: dict[str, float]
