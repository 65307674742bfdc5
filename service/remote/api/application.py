"""The API without a network: a key, parameters and a body in; an answer or a problem out."""

import logging
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import version

import msgspec

from service.remote.api import reading, routes, schemas
from service.remote.api.background import Background
from service.remote.api.catalogue import Catalogue
from service.remote.api.dangerous import DangerousAnswers
from service.remote.api.files import JSON, File
from service.remote.api.findings import FindingAnswers
from service.remote.api.jobs import JobAnswers
from service.remote.api.limits import Bucket, Limits
from service.remote.api.objects import About
from service.remote.api.orders import Orders
from service.remote.api.problems import ApiError, problem_of, short
from service.remote.api.quotas import Quotas
from service.remote.api.records import Records
from service.remote.api.requests import Nothing
from service.remote.api.reruns import Reruns
from service.remote.api.results import ResultAnswers
from service.remote.api.rollouts import RolloutAnswers
from service.remote.api.state import StateAnswers
from service.remote.api.verdicts import VerdictAnswers
from service.remote.fleet.service import Fleet

log = logging.getLogger("tailroad.api")


@dataclass(frozen=True)
class Answer:
    """JSON or a file, and whether it is what was asked for (status 200) or a problem."""

    status: int
    body: bytes
    media: str = JSON

    @property
    def ok(self) -> bool:
        return self.status < 400


class Application:
    """Answers for a fleet; may be called from any thread. seen: told of (action, status, seconds) of each request."""

    def __init__(
        self,
        fleet: Fleet,
        catalogue: Catalogue,
        limits: Limits,
        seen: Callable[[str, int, float], None] = lambda action, status, seconds: None,
    ):
        self.limits = limits
        self._seen = seen
        self._background = Background(limits.wait_s)
        # records read again: not behind the long ones
        self._replays = Background(limits.wait_s, most=limits.pending)
        self._state = StateAnswers(fleet, catalogue)
        jobs, results = JobAnswers(fleet, catalogue, limits), ResultAnswers(fleet, self._replays)
        records = Records(fleet)
        self._reruns = Reruns(limits.rerun_procs, limits.rerun_jobs, limits.rerun_idle_s)
        dangerous = DangerousAnswers(records, self._background, limits, self._reruns)
        findings = FindingAnswers(records, self._background, limits, self._reruns)
        verdicts = VerdictAnswers(records, self._background, limits, self._reruns)
        self._parts = (self, self._state, jobs, results, RolloutAnswers(fleet), dangerous, findings, verdicts)
        self._requests = Bucket(limits.requests_per_s, limits.burst)
        self._submissions = Bucket(limits.submissions_per_s, limits.burst)
        self._quotas = Quotas(fleet, limits)
        self._orders = Orders(fleet)

    def answer(self, key: str, parameters: str, payload: bytes | None, who: str = "unknown") -> Answer:
        """The answer to a query of `who` on `key`, below tailroad/v1/; never raises."""
        began, action = time.perf_counter(), "none"
        try:
            self._pass(self._requests)
            self._quotas.ask(who)
            if payload is not None and len(payload) > self.limits.body_bytes:
                text = f"a body of {len(payload)} bytes; this service takes at most {self.limits.body_bytes}"
                raise ApiError("too-large", text)
            own = key.removeprefix(f"{routes.READ}/")
            if (name := own.removeprefix("schemas/")) != own:
                action = "schema"
                answer = Answer(200, self._schema(name))
            else:
                route, names = routes.find(own, bool(payload))
                action = route.action
                if route.order:
                    answer = self._ordered(own, own != key, route, names, parameters, payload, who)
                else:
                    answer = self._encoded(self._do(route, names, parameters, payload))
        except Exception as error:
            problem = problem_of(error, f"{routes.PREFIX}/{short(key)}")
            if problem.status == 500:
                log.exception("request on %s", short(key))
            answer = Answer(problem.status, msgspec.json.encode(problem))
        self._seen(action, answer.status, time.perf_counter() - began)
        return answer

    def refuse(self, key: str, error: ApiError) -> Answer:
        """The problem of a request that is not looked at."""
        problem = problem_of(error, f"{routes.PREFIX}/{short(key)}")
        self._seen("none", problem.status, 0.0)
        return Answer(problem.status, msgspec.json.encode(problem))

    def about(self, asked: Nothing) -> About:
        return routes.about(version("tailroad"), {k: float(v) for k, v in asdict(self.limits).items()})

    def close(self) -> None:
        self._background.close()
        self._reruns.close()
        self._replays.close()
        self._state.close()

    def _encoded(self, found: msgspec.Struct | File) -> Answer:
        """As it goes over the wire; ApiError for a file that is larger than this service sends."""
        if not isinstance(found, File):
            return Answer(200, msgspec.json.encode(found))
        if len(found.body) > self.limits.answer_bytes:
            raise ApiError(
                "too-large",
                f"a file of {len(found.body)} bytes; this service sends at most {self.limits.answer_bytes}",
            )
        return Answer(200, found.body, found.media)

    def _do(
        self, route: routes.Route, names: dict[str, str], parameters: str, payload: bytes | None
    ) -> msgspec.Struct | File:
        if any("*" in name or "$" in name for name in names.values()):
            raise ApiError("bad-request", f"wildcards are not answered; name one {' and one '.join(names)}")
        asked = reading.checked(route.takes, reading.parameters(parameters))
        handler = next(getattr(part, route.action) for part in self._parts if hasattr(part, route.action))
        if route.body is not None:
            self._pass(self._submissions)
            return handler(reading.body(route.body, payload or b""))
        return handler(asked, **names)

    def _ordered(
        self,
        key: str,
        reads: bool,
        route: routes.Route,
        names: dict[str, str],
        parameters: str,
        payload: bytes | None,
        who: str,
    ) -> Answer:
        """The answer to something that is to be done, which is written down with who wanted it.

        reads: whether a reader asks, who may not
        """
        with self._orders.written(who, route.action, names.get("job", "")) as order:
            if reads:
                raise ApiError(
                    "forbidden",
                    f"the read-only role may not {route.action}: {routes.PREFIX}/{routes.READ} takes no orders; use "
                    f"the keys of a client, and {routes.PREFIX}/{short(key)}",
                )
            if route.body is None:
                return self._encoded(self._do(route, names, parameters, payload))
            self._quotas.submit(who)
            found = self._do(route, names, parameters, payload)
            order.job = str(getattr(found, "id", ""))
            return self._encoded(found)

    def _schema(self, name: str) -> bytes:
        if name not in self._schemas:
            raise ApiError(
                "not-found", f"there is no schema {short(name)!r}; there are {', '.join(self._schemas)}"
            )
        return self._schemas[name]

    @cached_property
    def _schemas(self) -> dict[str, bytes]:
        return schemas.published()

    def _pass(self, bucket: Bucket) -> None:
        wait_s = bucket.wait_s()
        if wait_s > 0.0:
            raise ApiError(
                "too-many-requests", f"try again in {wait_s:.2g} s", retry_after_s=round(wait_s, 3)
            )
