"""The fleet's API as Python methods."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

import msgspec

from service.closing import Closing
from service.remote.api import objects as O
from service.remote.api.requests import Submission
from service.remote.api.routes import READ
from service.remote.client.errors import NoAnswer, Refused
from service.remote.client.line import Line, Subscription
from service.remote.fleet.sessions import is_reader

if TYPE_CHECKING:
    from service.analysis.comparison.objects import Comparison
    from service.analysis.coverage.objects import Coverage
    from service.analysis.failures.objects import Failures
    from service.analysis.learned.objects import Learned
    from service.analysis.learned.scatter_objects import Scatter
    from service.analysis.prevention.objects import Prevention
    from service.analysis.report.objects import Report
    from service.analysis.risk import Risk
    from service.analysis.severity.objects import Severity

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
PREFIX = "tailroad/v1"
PATIENCE_S = 600.0  # for an answer that is being computed
PASSING = ("working", "busy", "too-many-requests")  # problems that pass: the same is asked again
LOOK_S = 5.0  # between two looks at the record while no event comes

T = TypeVar("T")


class Client(Closing):
    """A client of the service at one of the endpoints; a context manager.

    timeout_s: for an answer
    patience_s: for one that the service still computes, and for one that comes late while a job is watched
    read_only: ask as a reader, from whom the service takes no orders; so does the configuration of a reader

    Methods may be called from any thread. They raise Refused where the service refuses, NoAnswer where nobody answers
    in time.
    """

    def __init__(
        self,
        connect: str | Sequence[str] = DEFAULT_ENDPOINT,
        zenoh_config: str | None = None,
        timeout_s: float = 20.0,
        patience_s: float = PATIENCE_S,
        read_only: bool = False,
    ):
        self.read_only = read_only or is_reader(zenoh_config)
        self._prefix = f"{PREFIX}/{READ}" if self.read_only else PREFIX
        where = [connect] if isinstance(connect, str) else list(connect)
        self._line = Line(where, zenoh_config, timeout_s, f"{self._prefix}/about")
        self._patience_s = patience_s
        self._met = False  # whether anybody has answered yet

    def close(self) -> None:
        self._line.close()

    # -- jobs ------------------------------------------------------------------------------------------------

    def submit(self, scenario: str | dict[str, Any], gamma: float, **others: Any) -> O.Job:
        """Submit a job; others: as in `service.remote.api.requests.Submission` (ego, method, budget, rel_error, ...).

        scenario: the name of one that the service lists, or a scenario by value.
        """
        submission = Submission(scenario=scenario, gamma=gamma, **others)
        return self._ask("jobs", O.Job, payload=msgspec.json.encode(submission))

    def jobs(self, after: int = 0, limit: int = 100) -> O.Jobs:
        """A page of jobs."""
        return self._ask("jobs", O.Jobs, after=after, limit=limit)

    def all_jobs(self) -> Iterator[O.Job]:
        """Every job, in the order of submission."""
        after: int | None = 0
        while after is not None:
            page = self.jobs(after, 500)
            yield from page.items
            after = page.next

    def job(self, job: str) -> O.Job:
        return self._ask(f"jobs/{quote(job, safe='')}", O.Job)

    def estimate(self, job: str, gamma: float | None = None, confidence: float | None = None) -> O.Estimate:
        """p from what is complete, at another threshold or confidence where given."""
        return self._of(job, "estimate", O.Estimate, gamma=gamma, confidence=confidence)

    def scenario(self, job: str) -> O.JobScenario:
        """The scenario of a job, as a file that submits it again."""
        return self._of(job, "scenario", O.JobScenario)

    def curve(
        self, job: str, gammas: Sequence[float] | None = None, confidence: float | None = None
    ) -> O.Curve:
        """p at each threshold, from the same rollouts."""
        listed = None if gammas is None else ",".join(repr(float(g)) for g in gammas)
        return self._of(job, "curve", O.Curve, gammas=listed, confidence=confidence)

    def course(self, job: str, points: int = 100) -> O.Course:
        """The estimate as rollouts came in."""
        return self._of(job, "course", O.Course, points=points)

    def iterations(self, job: str, after: int = -1, limit: int = 100) -> O.Iterations:
        return self._of(job, "iterations", O.Iterations, after=after, limit=limit)

    def events(self, job: str, after: int = 0, limit: int = 100) -> O.Events:
        """The events that are kept."""
        return self._of(job, "events", O.Events, after=after, limit=limit)

    def rollouts(self, job: str, after: str = "", limit: int = 10_000) -> O.Rollouts:
        """A page of the rollouts on record."""
        return self._of(job, "rollouts", O.Rollouts, after=after or None, limit=limit)

    def listing(self, job: str, limit: int = 100, **asked: Any) -> O.Listing:
        """Some of the rollouts on record; asked: phase, outcome, low, high, by, offset."""
        return self._of(job, "listing", O.Listing, limit=limit, **asked)

    def all_rollouts(self, job: str) -> Iterator[O.Rollouts]:
        """Every rollout on record, in pages."""
        after: str | None = ""
        while after is not None:
            page = self.rollouts(job, after)
            yield page
            after = page.next

    def failures(
        self, job: str, limit: int = 20, by: str = "likelihood", outcome: str | None = None
    ) -> "Failures":
        """The dangerous rollouts ranked and grouped, or those that ended with `outcome`; waits while the service runs
        them again."""
        from service.analysis.failures.objects import Failures

        return self._of(job, "failures", Failures, limit=limit, by=by, outcome=outcome)

    def rollout(
        self,
        job: str,
        row: int,
        phase: str = "estimate",
        iteration: int | None = None,
        trace: bool = False,
        playback: bool = False,
        camera: int = 0,
        reference: str | None = None,
    ) -> O.RolloutView:
        """One rollout, run once more; what to bring of it as of `service.remote.api.requests.AskRollout`."""
        asked = {
            "phase": phase,
            "iteration": iteration,
            "trace": str(trace).lower(),
            "playback": str(playback).lower(),
            "camera": camera,
            "reference": reference,
        }
        return self._of(job, f"rollouts/{row}", O.RolloutView, **asked)

    def export(
        self, job: str, row: int, form: str, phase: str = "estimate", iteration: int | None = None
    ) -> bytes:
        """One rollout as a file: form is scenario, fcd, mp4, mcap or table."""
        return self._file(job, f"rollouts/{row}/export", format=form, phase=phase, iteration=iteration)

    def severity(self, job: str, examine: int | None = None) -> "Severity":
        """How severe a job's contacts are; waits while the service runs rollouts again."""
        from service.analysis.severity.objects import Severity

        return self._of(job, "severity", Severity, examine=examine)

    def prevention(
        self,
        job: str,
        reference: str | None = None,
        examine: int | None = None,
        onset_ttc_s: float | None = None,
    ) -> "Prevention":
        """What part of p reference drivers would have prevented; waits while the service drives rollouts again."""
        from service.analysis.prevention.objects import Prevention

        return self._of(
            job, "prevention", Prevention, reference=reference, examine=examine, onset_ttc_s=onset_ttc_s
        )

    def coverage(self, job: str) -> "Coverage":
        """Which cells of the operational design domain P0, the rollouts and p lie in."""
        from service.analysis.coverage.objects import Coverage

        return self._of(job, "coverage", Coverage)

    def learned(self, job: str, rollouts: int = 100) -> "Learned":
        """What the search learned; waits while the service runs rollouts again."""
        from service.analysis.learned.objects import Learned

        return self._of(job, "learned", Learned, rollouts=rollouts)

    def scatter(self, job: str, rollouts: int = 100) -> "Scatter":
        """Coordinates of X and what the drivers did against f; waits while the service runs rollouts again."""
        from service.analysis.learned.scatter_objects import Scatter

        return self._of(job, "scatter", Scatter, rollouts=rollouts)

    def comparison(
        self, jobs: Sequence[str], gamma: float | None = None, examine: int | None = None
    ) -> "Comparison":
        """Each of the jobs against each before it; gamma: one threshold for all; examine 0: without failure modes."""
        from service.analysis.comparison.objects import Comparison

        return self._ask("comparison", Comparison, jobs=",".join(jobs), gamma=gamma, examine=examine)

    def risk(self, job: str, baseline: str | float | None = None, source: str | None = None) -> "Risk":
        """p as a rate per million km, beside a baseline: its name, or events per million km."""
        from service.analysis.risk import Risk

        return self._of(job, "risk", Risk, baseline=baseline, source=source)

    def report(self, job: str, baseline: str | float | None = None, source: str | None = None) -> str:
        """The report as one HTML page; the baseline as of `risk`."""
        return self._file(job, "report", baseline=baseline, source=source).decode()

    def report_json(
        self, job: str, baseline: str | float | None = None, source: str | None = None
    ) -> "Report":
        """The report's facts."""
        from service.analysis.report.objects import Report

        return self._of(job, "report.json", Report, baseline=baseline, source=source)

    def cancel(self, job: str) -> O.Done:
        return self._of(job, "cancel", O.Done)

    def pause(self, job: str) -> O.Done:
        return self._of(job, "pause", O.Done)

    def resume(self, job: str) -> O.Done:
        return self._of(job, "resume", O.Done)

    def note(
        self,
        job: str,
        text: str | None = None,
        tags: Sequence[str] | None = None,
        archived: bool | None = None,
    ) -> O.Done:
        """Keep words about the job, tags to find it by, and whether it is left out of lists; None: as it is."""
        words = None if tags is None else ",".join(tags)
        return self._of(job, "note", O.Done, text=text, tags=words, archived=archived)

    def watch(
        self, job: str, after: int = 0, on_silence: Callable[[float], None] = lambda silent_s: None
    ) -> Iterator[O.Event]:
        """The job's events as they happen, kept ones first, until it is over. None is missed and none told twice; what
        is not kept (number 0: progress, iteration) is told while somebody watches. Where a service that has answered
        before is silent, it is asked again for patience_s; on_silence is told for how long it has been, each time."""
        with self.subscribe(job) as live:
            while True:
                page = self._patiently(partial(self.events, job, after), on_silence)
                over = False
                for event in page.items:
                    after, over = event.number, _over(event) or (over and event.kind != "status")
                    yield event
                if page.next is not None:
                    continue
                if over:
                    return
                if not page.items and self._patiently(partial(self.job, job), on_silence).status in O.OVER:
                    return
                while (body := live.get(LOOK_S)) is not None:
                    event = msgspec.json.decode(body, type=O.Event)
                    if event.number > after + 1:
                        break  # one was missed: read the record
                    if event.number in (0, after + 1):
                        after = max(after, event.number)
                        yield event
                        if _over(event):
                            return

    def wait(self, job: str) -> O.Job:
        """The job when it is over."""
        for _ in self.watch(job):
            pass
        return self._patiently(partial(self.job, job))

    def subscribe(self, job: str = "*") -> Subscription:
        """What the job tells from now on, or all jobs do: the JSON of an Event each time."""
        return self._line.subscribe(f"{PREFIX}/jobs/{job if job == '*' else quote(job, safe='')}/events")

    # -- the service -----------------------------------------------------------------------------------------

    def scenarios(self) -> O.Scenarios:
        return self._ask("scenarios", O.Scenarios)

    def egos(self) -> O.Egos:
        return self._ask("egos", O.Egos)

    def workers(self, after: str = "", limit: int = 1000) -> O.Workers:
        return self._ask("workers", O.Workers, after=after or None, limit=limit)

    def tally(self) -> O.Tally:
        """Lost, copied and audited chunks since the scheduler began."""
        return self._ask("tally", O.Tally)

    def health(self) -> O.Health:
        return self._ask("health", O.Health)

    def about(self) -> O.About:
        return self._ask("about", O.About)

    def get(self, selector: str, payload: bytes | None = None) -> bytes:
        """The JSON at any key below tailroad/v1/, with its parameters, as in jobs/ID/estimate?gamma=0.14."""
        return self._wait(selector.removeprefix(PREFIX + "/"), payload)

    # -- inside ----------------------------------------------------------------------------------------------

    def _of(self, job: str, what: str, kind: type[T], **parameters: Any) -> T:
        return self._ask(f"jobs/{quote(job, safe='')}/{what}", kind, **parameters)

    def _file(self, job: str, what: str, **parameters: Any) -> bytes:
        return self._wait(_selector(f"jobs/{quote(job, safe='')}/{what}", parameters), None)

    def _ask(self, key: str, kind: type[T], payload: bytes | None = None, **parameters: Any) -> T:
        return msgspec.json.decode(self._wait(_selector(key, parameters), payload), type=kind)

    def _wait(self, selector: str, payload: bytes | None) -> bytes:
        """The answer; where it is being computed, when it is there."""
        until = time.monotonic() + self._patience_s
        while True:
            ok, body = self._line.ask(f"{self._prefix}/{selector}", payload)
            self._met = True
            if ok:
                return body
            refused = Refused(msgspec.json.decode(body, type=O.Problem))
            if refused.kind not in PASSING or time.monotonic() >= until:
                raise refused
            time.sleep(refused.problem.retry_after_s or 1.0)

    def _patiently(
        self, ask: Callable[[], T], on_silence: Callable[[float], None] = lambda silent_s: None
    ) -> T:
        """The answer to a question that may be asked twice; NoAnswer where nobody has ever answered, or not for
        patience_s."""
        began = time.monotonic()
        while True:
            try:
                return ask()
            except NoAnswer:
                silent_s = time.monotonic() - began
                if not self._met or silent_s >= self._patience_s:
                    raise
                on_silence(silent_s)


def _selector(key: str, parameters: dict[str, Any]) -> str:
    text = ";".join(f"{k}={quote(str(v), safe=',')}" for k, v in parameters.items() if v is not None)
    return key + (f"?{text}" if text else "")


def _over(event: O.Event) -> bool:
    return event.kind == "status" and event.body.get("status") in O.OVER
