"""Which key, below tailroad/v1/, takes what, does what and answers what."""

from dataclasses import dataclass
from typing import Any

import msgspec

from service.analysis.comparison.objects import Comparison
from service.analysis.coverage.objects import Coverage
from service.analysis.exports import FORMATS
from service.analysis.failures.objects import Failures
from service.analysis.learned.objects import Learned
from service.analysis.learned.scatter_objects import Scatter
from service.analysis.prevention.objects import Prevention
from service.analysis.report.objects import Report
from service.analysis.risk import Risk
from service.analysis.severity.objects import Severity
from service.remote.api import objects as O
from service.remote.api import requests as R
from service.remote.api.problems import ApiError, Wrong, short

PREFIX = "tailroad/v1"
READ = (
    "read"  # below PREFIX/READ every key is answered that changes nothing: all that a read-only role may ask
)
# first parts of the keys
TOPS = (
    "about",
    "health",
    "schemas",
    "scenarios",
    "egos",
    "workers",
    "tally",
    "jobs",
    "comparison",
)


@dataclass(frozen=True)
class Route:
    """A key of the API.

    key: its parts in braces are names
    action: of the application, called with the parameters and those names
    answers: None where it is a file of one of `media`
    body: what a payload must be (None: a payload is refused)
    order: does something, so that only the exact key will do
    """

    key: str
    does: str
    action: str
    takes: type[msgspec.Struct]
    answers: type[msgspec.Struct] | None
    body: type[msgspec.Struct] | None = None
    order: bool = False
    media: tuple[str, ...] = ()


ROUTES = (
    Route("about", "What this API takes and answers.", "about", R.Nothing, O.About),
    Route("health", "Whether the service can do its work.", "health", R.Nothing, O.Health),
    Route("scenarios", "Scenarios, roads and driver weights that jobs may name.", "scenarios", R.Nothing, O.Scenarios),
    Route("egos", "Egos that jobs may name.", "egos", R.Nothing, O.Egos),
    Route("workers", "Workers that are connected, and those in quarantine.", "workers", R.WorkersPage, O.Workers),
    Route("tally", "Lost, copied and audited chunks since the scheduler began.", "tally", R.Nothing, O.Tally),
    Route("jobs", "Jobs in the order of submission.", "jobs", R.Page, O.Jobs),
    Route("jobs", "With a body: submit a job.", "submit", R.Nothing, O.Job, R.Submission, True),
    Route("jobs/{job}", "A job and how far it is.", "job", R.Nothing, O.Job),
    Route("jobs/{job}/scenario", "The scenario of a job, as a file that submits it again.", "scenario", R.Nothing,
          O.JobScenario),
    Route("jobs/{job}/estimate", "p with its interval, from what is complete.", "estimate", R.AskEstimate, O.Estimate),
    Route("jobs/{job}/curve", "p for many thresholds.", "curve", R.AskCurve, O.Curve),
    Route("jobs/{job}/course", "The estimate as rollouts came in.", "course", R.AskCourse, O.Course),
    Route("jobs/{job}/iterations", "What each batch came to.", "iterations", R.IterationsPage, O.Iterations),
    Route("jobs/{job}/events", "Events that are kept; subscribe to this key for all as they happen.", "events", R.Page,
          O.Events),
    Route("jobs/{job}/failures", "Dangerous rollouts ranked and grouped into failure modes.", "failures",
          R.AskFailures, Failures),
    Route("jobs/{job}/severity", "How severe contacts are: changes of velocity, risk of serious injury.", "severity",
          R.AskSeverity, Severity),
    Route("jobs/{job}/prevention", "What part of p reference drivers would have prevented, by failure mode.",
          "prevention", R.AskPrevention, Prevention),
    Route("jobs/{job}/coverage", "Which cells of the operational design domain P0, the rollouts and p lie in.",
          "coverage", R.Nothing, Coverage),
    Route("jobs/{job}/rollouts", "The rollouts on record, in pages.", "rollouts", R.RolloutsPage, O.Rollouts),
    Route("jobs/{job}/listing", "Rollouts on record by phase, ending and f, in order.", "listing", R.AskListing,
          O.Listing),
    Route("jobs/{job}/rollouts/{row}", "One rollout, run once more.", "rollout", R.AskRollout, O.RolloutView),
    Route("jobs/{job}/rollouts/{row}/export", "One rollout as a file for other programs.", "export", R.AskExport, None,
          media=tuple(media for media, _ in FORMATS.values())),
    Route("jobs/{job}/learned", "What the search learned: starts and driving under P0 and under the proposal.",
          "learned", R.AskLearned, Learned),
    Route("jobs/{job}/scatter", "Coordinates of X and what the drivers did, against f.", "scatter", R.AskScatter,
          Scatter),
    Route("jobs/{job}/risk", "p in words and as a rate per million km, beside a baseline.", "risk", R.AskRisk, Risk),
    Route("jobs/{job}/report", "The report as one HTML file.", "report", R.AskReport, None, media=("text/html",)),
    Route("jobs/{job}/report.json", "The same facts for programs.", "report_json", R.AskReport, Report),
    Route("comparison", "Jobs on the same question: differences, ratios, curves, failure modes.", "comparison",
          R.AskComparison, Comparison),
    Route("jobs/{job}/cancel", "End a job for good.", "cancel", R.Nothing, O.Done, order=True),
    Route("jobs/{job}/pause", "Run none of a job's rollouts until it is resumed.", "pause", R.Nothing, O.Done,
          order=True),
    Route("jobs/{job}/note", "Keep words about a job, its tags, and whether it is put away.", "note", R.AskNote, O.Done,
          order=True),
    Route("jobs/{job}/resume", "Go on with a job.", "resume", R.Nothing, O.Done, order=True),
)  # fmt: skip


def find(key: str, payload: bool) -> tuple[Route, dict[str, str]]:
    """The route of a key below PREFIX and what the key names; ApiError where there is none."""
    parts = key.split("/")
    candidates = []
    for route in ROUTES:
        names = _match(route.key.split("/"), parts)
        if names is not None:
            candidates.append((route, names))
    if not candidates:
        raise ApiError(
            "no-such-key", f"there is no key {short(f'{PREFIX}/{key}')}; {PREFIX}/about lists them"
        )
    for route, names in candidates:
        if payload == (route.body is not None):
            return route, names
    text = f"{PREFIX}/{short(key)} takes no body; leave it out"
    raise ApiError("bad-request", text, (Wrong("body", "", "none"),))


def _match(pattern: list[str], parts: list[str]) -> dict[str, str] | None:
    if len(pattern) != len(parts):
        return None
    names: dict[str, str] = {}
    for wanted, part in zip(pattern, parts, strict=True):
        if wanted.startswith("{"):
            names[wanted[1:-1]] = part
        elif wanted != part:
            return None
    return names


def about(version: str, limits: dict[str, float]) -> O.About:
    """The table above as clients read it."""
    endpoints = tuple(
        O.Endpoint(
            key=f"{PREFIX}/{route.key}",
            does=route.does,
            parameters=tuple(_parameters(route.takes)),
            body=None if route.body is None else route.body.__name__,
            answer=None if route.answers is None else route.answers.__name__,
            media=route.media,
        )
        for route in ROUTES
    )
    return O.About(tailroad=version, endpoints=endpoints, schemas=tuple(sorted(wire_types())), limits=limits)


def _parameters(kind: type[msgspec.Struct]) -> list[O.Parameter]:
    components = msgspec.json.schema(kind)["$defs"][kind.__name__].get("properties", {})
    return [
        O.Parameter(name=name, expected=_words(described), default=described.get("default"))
        for name, described in components.items()
    ]


def _words(described: dict[str, Any]) -> str:
    """A schema of one value in words."""
    options = described.get("anyOf", [described])
    choices = []
    for one in options:
        if "enum" in one:
            choices.append(" or ".join(str(v) for v in one["enum"]))
        elif one.get("type") != "null":
            ends = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<",
                    "maxLength": "length <="}  # fmt: skip
            choices.append(
                " ".join([one.get("type", ""), *(f"{sign} {one[k]}" for k, sign in ends.items() if k in one)])
            )
    return " or ".join(choices)


def wire_types() -> dict[str, type[msgspec.Struct]]:
    """Every type that goes over the wire and has a schema, by name."""
    kinds: list[type[msgspec.Struct]] = [O.Event, O.Problem]
    for route in ROUTES:
        kinds += [kind for kind in (route.answers, route.body) if kind is not None]
    return {kind.__name__: kind for kind in kinds}
