"""What a job came to, over the API: estimate, curve, iterations, events."""

import math
from typing import Any

import msgspec
import numpy as np

from service.evaluation.store.jobs import Event as StoredEvent
from service.remote.api.background import Background
from service.remote.api.objects import (
    Course,
    Curve,
    CurvePoint,
    Estimate,
    EstimateStep,
    Event,
    Events,
    Iterations,
    SearchStep,
)
from service.remote.api.problems import ApiError, Wrong, short
from service.remote.api.requests import MAX_PAGE, AskCourse, AskCurve, AskEstimate, IterationsPage, Page
from service.remote.fleet.service import Fleet
from service.world.scenario.measures import span


class ResultAnswers:
    """What is answered on jobs/ID/estimate, curve, iterations and events."""

    def __init__(self, fleet: Fleet, replays: Background):
        self._fleet, self._replays = fleet, replays

    def estimate(self, asked: AskEstimate, job: str) -> Estimate:
        status = self._fleet.job(job).status
        self._make_ready(job)
        found = self._fleet.estimate(job, asked.gamma, asked.confidence)
        return msgspec.convert(finite(found) | {"job": job, "status": status}, Estimate)

    def curve(self, asked: AskCurve, job: str) -> Curve:
        view = self._fleet.job(job)
        gammas = _thresholds(asked, view.unit, view.gamma)
        self._make_ready(job)
        curve = self._fleet.curve(job, gammas, asked.confidence)
        points = zip(
            curve.gammas,
            curve.p,
            curve.std_error,
            curve.low,
            curve.high,
            curve.events,
            curve.ess,
            strict=True,
        )
        confidence = asked.confidence or float(view.options.get("confidence", 0.95))
        return Curve(
            job=job,
            confidence=confidence,
            points=tuple(
                CurvePoint(gamma=float(g), p=_finite(p), std_error=_finite(s), ci=(_finite(low), _finite(high)),
                           events=int(n), ess=_finite(ess))
                for g, p, s, low, high, n, ess in points
            ),
        )  # fmt: skip

    def course(self, asked: AskCourse, job: str) -> Course:
        view = self._fleet.job(job)
        self._make_ready(job)
        training, trace = self._fleet.course(job, asked.points, asked.confidence)
        columns = {
            name: tuple(finite(getattr(trace, name).tolist())) for name in ("rollouts", "p", "low", "high")
        }
        confidence = asked.confidence or float(view.options.get("confidence", 0.95))
        return Course(job=job, confidence=confidence, training=training, **columns)

    def _make_ready(self, job: str) -> None:
        """Have the job's record replayed where it is not at hand; ApiError "working" while that takes."""
        if not self._fleet.at_hand(job):
            key = ("replay", job)
            self._replays.get(key, lambda: self._fleet.make_ready(job))
            self._replays.forget(key)  # the job may be put away again

    def iterations(self, asked: IterationsPage, job: str) -> Iterations:
        rows = self._fleet.iterations(job, asked.after, asked.limit + 1)
        items = msgspec.convert(
            [finite(row) for row in rows[: asked.limit]], tuple[SearchStep | EstimateStep, ...]
        )
        more = len(rows) > asked.limit
        return Iterations(items=items, next=items[-1].number if more else None)

    def events(self, asked: Page, job: str) -> Events:
        rows = self._fleet.events(job, asked.after, asked.limit + 1)
        items = tuple(wire_event(row) for row in rows[: asked.limit])
        return Events(items=items, next=items[-1].number if len(rows) > asked.limit else None)


def wire_event(event: StoredEvent) -> Event:
    """As it goes over the wire."""
    return Event(job=event.job, number=event.number, kind=event.kind, at=event.at, body=event.body)


def finite(value: Any) -> Any:
    """The same with None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return _finite(value) if isinstance(value, float) else value


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _thresholds(asked: AskCurve, unit: str, gamma: float) -> list[float]:
    if asked.gammas is None:
        usual = span(unit, gamma)
        low = asked.low if asked.low is not None else usual[0]
        high = asked.high if asked.high is not None else usual[1]
        if not low < high:
            wrong = Wrong("low", str(low), f"below high ({high:g})")
            raise ApiError("bad-parameter", f"low is {low:g}: it must lie below high ({high:g})", (wrong,))
        return np.linspace(low, high, asked.steps).tolist()
    if asked.low is not None or asked.high is not None:
        raise ApiError("bad-parameter", "give either gammas or low, high and steps")
    try:
        gammas = [float(text) for text in asked.gammas.split(",")]
    except ValueError as error:
        raise _not_numbers(asked.gammas) from error
    if len(gammas) > MAX_PAGE or not all(math.isfinite(g) for g in gammas):
        raise _not_numbers(asked.gammas)
    return gammas


def _not_numbers(given: str) -> ApiError:
    expected = f"1 to {MAX_PAGE} finite numbers separated by commas"
    return ApiError(
        "bad-parameter",
        f"gammas is {short(given)!r}: give {expected}",
        (Wrong("gammas", short(given), expected),),
    )
