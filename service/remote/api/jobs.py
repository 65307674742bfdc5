"""Jobs over the API: submitted, listed, told what to do."""

import difflib
from dataclasses import fields
from typing import Any

import msgspec

import ce
from service.evaluation.job import held_bytes, make_job
from service.remote.api.catalogue import Catalogue
from service.remote.api.limits import Limits
from service.remote.api.objects import OVER, Done, Job, Jobs, JobScenario
from service.remote.api.problems import ApiError, Wrong, short
from service.remote.api.requests import AskNote, Nothing, Page, Submission
from service.remote.fleet.service import Fleet
from service.remote.fleet.views import JobView
from service.world.safety.measure import with_measure
from service.world.scenario.noise_mode import with_noise_mode

MOST_TAGS, LONGEST_TAG = 20, 40
COMMON = ("budget", "rel_error", "confidence")  # options that have a place of their own in a submission
# that may be as large as it; other whole numbers are sizes of batches
OF_THE_BUDGET = ("estimation_rollouts",)


class JobAnswers:
    """What is answered on jobs and jobs/ID."""

    def __init__(self, fleet: Fleet, catalogue: Catalogue, limits: Limits):
        self._fleet, self._catalogue, self._limits = fleet, catalogue, limits

    def jobs(self, asked: Page) -> Jobs:
        items = tuple(wire(view) for view in self._fleet.jobs(asked.after, asked.limit + 1))
        more = len(items) > asked.limit
        items = items[: asked.limit]
        return Jobs(items=items, next=items[-1].number if more else None)

    def job(self, asked: Nothing, job: str) -> Job:
        return wire(self._fleet.job(job))

    def scenario(self, asked: Nothing, job: str) -> JobScenario:
        """What the job runs, for who submits it again."""
        found = self._fleet.scenario(job)
        again = self._catalogue.again(found)
        return JobScenario(
            job=job,
            name=found.name,
            listed=again is not None,
            measure=None if again is None else again[0],
            noise_mode=None if again is None else again[1],
            text=self._catalogue.text_of(found),
        )

    def submit(self, asked: Submission) -> Job:
        if isinstance(asked.scenario, str):
            scenario = self._catalogue.named(asked.scenario)
        else:
            scenario = self._catalogue.by_value(asked.scenario)
        if asked.measure is not None:
            scenario = with_measure(scenario, asked.measure)
        scenario = with_noise_mode(scenario, asked.noise_mode)
        if asked.budget > self._limits.budget:
            raise _too_much("budget", asked.budget, self._limits.budget)
        self._check_options(asked)
        common = {"budget": asked.budget, "rel_error": asked.rel_error, "confidence": asked.confidence}
        job = make_job(scenario, asked.ego, asked.gamma, asked.method, asked.seed, common | asked.options)
        if (held := held_bytes(job)) > self._limits.open_bytes:
            raise _too_heavy(held, self._limits.open_bytes)
        if self._fleet.open_jobs() >= self._limits.open_jobs:
            raise ApiError(
                "too-many-jobs",
                f"there are {self._limits.open_jobs} open jobs; wait for some to end, or cancel some",
                retry_after_s=60.0,
            )
        return wire(self._fleet.submit(job, asked.priority, asked.weight, asked.label, asked.max_failed))

    def cancel(self, asked: Nothing, job: str) -> Done:
        self._fleet.cancel(job)
        return Done(job=job, order="cancel")

    def pause(self, asked: Nothing, job: str) -> Done:
        self._refuse_over(job, "paused")
        self._fleet.pause(job)
        return Done(job=job, order="pause")

    def resume(self, asked: Nothing, job: str) -> Done:
        self._refuse_over(job, "resumed")
        self._fleet.resume(job)
        return Done(job=job, order="resume")

    def note(self, asked: AskNote, job: str) -> Done:
        tags = None if asked.tags is None else _tags(asked.tags)
        self._fleet.note(job, asked.text, tags, asked.archived)
        return Done(job=job, order="note")

    def _refuse_over(self, job: str, what: str) -> None:
        status = self._fleet.job(job).status
        if status in OVER:
            raise ApiError("bad-request", f"the job is {status}; only one that is not over can be {what}")

    def _check_options(self, asked: Submission) -> None:
        """Options by name, type and size; what values mean is checked by ce."""
        kind = ce.OPTIONS[asked.method]
        known = [f.name for f in fields(kind) if f.name not in COMMON]
        try:
            options = ce.present_options(asked.method, asked.options)
        except TypeError as error:
            raise ApiError("bad-body", f"options: {error}") from error
        for name, value in options.items():
            where = f"options.{short(name)}"
            if name in COMMON:
                raise ApiError(
                    "bad-body", f"{where}: give it as {name!r} beside options", (Wrong(where, "", name),)
                )
            if name not in known:
                close = difflib.get_close_matches(name, known, 1)
                hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known)}"
                raise ApiError(
                    "bad-body",
                    f"{where}: method {asked.method} has no such option; {hint}",
                    (Wrong(where, "", hint),),
                )
            most = self._limits.budget if name in OF_THE_BUDGET else self._limits.batch_rows
            if isinstance(value, int) and value > most:
                raise _too_much(where, value, most)
        try:
            msgspec.convert(options, kind)
        except msgspec.ValidationError as error:
            raise ApiError("bad-body", f"options of method {asked.method}: {short(str(error))}") from error


def _tags(given: str) -> tuple[str, ...]:
    """Each once, in order; ApiError where they are too many or too long."""
    tags = tuple(dict.fromkeys(tag for word in given.split(",") if (tag := word.strip())))
    if len(tags) > MOST_TAGS or any(len(tag) > LONGEST_TAG for tag in tags):
        expected = f"at most {MOST_TAGS} words of at most {LONGEST_TAG} characters, separated by commas"
        wrong = Wrong("tags", short(given), expected)
        raise ApiError("bad-parameter", f"tags is {short(given)!r}: give {expected}", (wrong,))
    return tags


def wire(view: JobView) -> Job:
    """As it goes over the wire."""
    return msgspec.convert(view, Job, from_attributes=True)


def _too_heavy(held: int, most: int) -> ApiError:
    text = (
        f"the scheduler would hold up to {held / 1e6:,.0f} MB for this job, and this service takes jobs of at most "
        f"{most / 1e6:,.0f} MB; give a smaller budget, smaller batches in options, or a scenario with fewer random "
        "numbers"
    )
    return ApiError("bad-job", text, (Wrong("options", f"{held} bytes", f"at most {most} bytes"),))


def _too_much(where: str, given: Any, most: int) -> ApiError:
    wrong = Wrong(where, str(given), f"at most {most}")
    return ApiError("bad-body", f"{where} is {given}: this service takes at most {most}", (wrong,))
