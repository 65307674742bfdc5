"""The API on Zenoh: queries are answered by a few threads, events are published as they happen."""

import logging
import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import msgspec
import zenoh

from service.evaluation.store.jobs import Event
from service.remote.api.application import Answer, Application
from service.remote.api.catalogue import Catalogue
from service.remote.api.limits import Limits
from service.remote.api.problems import ApiError
from service.remote.api.results import finite, wire_event
from service.remote.api.routes import PREFIX, READ, TOPS
from service.remote.fleet.service import Fleet
from service.remote.fleet.zenoh_link import Links

log = logging.getLogger("tailroad.api")

JSON = zenoh.Encoding.APPLICATION_JSON
EVENTS_WAITING = 10_000  # to be published; more are left out, and can be read from the record
SERVICES = f"{PREFIX}/egos/*/services/*"  # tokens of ego services
LOOK_S = 1.0  # for them


class Api:
    """Answers for the fleet on a session until closed. offered: scenario files that jobs may name."""

    def __init__(
        self,
        session: zenoh.Session,
        fleet: Fleet,
        offered: Sequence[str] = (),
        limits: Limits | None = None,
        seen: Callable[[str, int, float], None] = lambda action, status, seconds: None,
    ):
        self._session = session
        self._links = Links(session)
        self._limits = limits or Limits()
        self.application = Application(fleet, Catalogue(offered, self._ego_services), self._limits, seen)
        self._pool = ThreadPoolExecutor(self._limits.threads, thread_name_prefix="api")
        self._free = threading.BoundedSemaphore(self._limits.pending)
        self._events: queue.Queue[Event | None] = queue.Queue(EVENTS_WAITING)
        self._closed = False
        self._publisher = threading.Thread(target=self._publish, name="api-events", daemon=True)
        self._publisher.start()
        fleet.listen(self._on_event)
        keys = [f"{PREFIX}/{top}" for top in TOPS if top not in ("jobs", "schemas")]
        keys += [f"{PREFIX}/jobs/**", f"{PREFIX}/schemas/*", f"{PREFIX}/{READ}/**"]
        self._queryables = [session.declare_queryable(key, self._on_query) for key in keys]
        self._queryables.append(session.declare_queryable(f"{PREFIX}/*", self._on_any))

    def close(self) -> None:
        """Answer what is being answered, and no more."""
        for queryable in self._queryables:
            queryable.undeclare()
        self._closed = True
        self._pool.shutdown(wait=True, cancel_futures=True)
        self.application.close()
        self._events.put(None)
        self._publisher.join()

    # -- queries ---------------------------------------------------------------------------------------------

    def _on_query(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        below = key.removeprefix(f"{PREFIX}/")
        payload = query.payload
        size = 0 if payload is None else len(payload)
        if size > self._limits.body_bytes:
            text = f"a body of {size} bytes; this service takes at most {self._limits.body_bytes}"
            _reply(query, self.application.refuse(below, ApiError("too-large", text)))
        elif not self._free.acquire(blocking=False):
            error = ApiError("busy", f"{self._limits.pending} requests wait for an answer", retry_after_s=1.0)
            _reply(query, self.application.refuse(below, error))
        else:
            body = None if payload is None else payload.to_bytes()
            who = self._links.peer(query).told
            self._pool.submit(self._answer, query, below, str(query.parameters), body, who)

    def _on_any(self, query: zenoh.Query) -> None:
        """Answers what no other key of the API matches, with the problem that says so."""
        top = str(query.key_expr).removeprefix(f"{PREFIX}/")
        if top in TOPS or "*" in top or "$" in top:
            query.drop()
        else:
            self._on_query(query)

    def _answer(self, query: zenoh.Query, key: str, parameters: str, payload: bytes | None, who: str) -> None:
        try:
            _reply(query, self.application.answer(key, parameters, payload, who))
        finally:
            self._free.release()

    # -- events ----------------------------------------------------------------------------------------------

    def _on_event(self, event: Event) -> None:
        if event.kind != "progress":
            fields = {"job": event.job, "event": event.kind, "body": event.body}
            log.info("job %s: %s", event.job, event.kind, extra={"fields": fields})
        if not self._closed:
            try:
                self._events.put_nowait(event)
            except queue.Full:
                log.warning("events of job %s are not published: too many wait", event.job)

    def _publish(self) -> None:
        while (event := self._events.get()) is not None:
            try:
                body = msgspec.json.encode(finite(msgspec.to_builtins(wire_event(event))))
                self._session.put(f"{PREFIX}/jobs/{event.job}/events", body, encoding=JSON)
            except zenoh.ZError as error:
                log.warning("an event of job %s could not be published: %s", event.job, error)

    def _ego_services(self) -> list[str]:
        """Names of the ego services that are there now."""
        replies = self._session.liveliness().get(SERVICES, timeout=LOOK_S)
        return [str(reply.ok.key_expr).split("/")[3] for reply in replies if reply.ok is not None]


def _reply(query: zenoh.Query, answer: Answer) -> None:
    try:
        if answer.ok:
            query.reply(query.key_expr, answer.body, encoding=zenoh.Encoding(answer.media))
        else:
            query.reply_err(answer.body, encoding=JSON)
    except zenoh.ZError:
        pass  # whoever asked is gone
    finally:
        query.drop()
