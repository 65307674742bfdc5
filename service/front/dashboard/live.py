"""What jobs tell, passed on to browsers as it happens (server-sent events), at most a few times a second each."""

import asyncio
import json
import logging
import secrets
import threading
import time
from collections import defaultdict, deque
from collections.abc import AsyncIterator, Callable

import msgspec

from service.remote.api.objects import Event
from service.remote.client import Client, NoAnswer

log = logging.getLogger("tailroad.dashboard")

GATHER_S = 0.3  # what happens within it is told together
QUIET_S = 15.0  # after which a comment shows that the connection lives
LOOK_S = 1.0
RATE_S = 30.0  # over which rollouts a second are counted
MOST_LISTENERS = 200
REMEMBERED = 10_000  # events, for pages that were drawn before they happened and listen after


class Rates:
    """Rollouts a second of each job, from what it told of its progress."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._seen: dict[str, deque[tuple[float, int]]] = {}

    def hear(self, job: str, rollouts: int) -> None:
        now = self._clock()
        seen = self._seen.setdefault(job, deque())
        if seen and (rollouts < seen[-1][1] or not seen[-1][1]):
            seen.clear()  # some were taken out of the record, or workers were starting until now
        seen.append((now, rollouts))
        while now - seen[0][0] > RATE_S and len(seen) > 2:
            seen.popleft()

    def forget(self, job: str) -> None:
        self._seen.pop(job, None)

    def of(self, job: str) -> float | None:
        """Rollouts a second of late; None: not known."""
        seen = self._seen.get(job)
        if seen is None or len(seen) < 2 or self._clock() - seen[-1][0] > RATE_S:
            return None
        (began, first), (ended, last) = seen[0], seen[-1]
        return (last - first) / (ended - began) if ended > began else None


class Listener:
    """What one browser has not been told yet. all: everything may have changed."""

    def __init__(self) -> None:
        self.jobs: defaultdict[str, set[str]] = defaultdict(set)
        self.all = False
        self.link: bool | None = None
        self.woken = asyncio.Event()


class EventLog:
    """The latest events, numbered, so that a page hears what happened after it was drawn and before it listened.

    A mark names a place among them: in this run, and after how many."""

    def __init__(self) -> None:
        self._run = secrets.token_hex(4)
        self._count = 0
        self._latest: deque[tuple[str, str]] = deque(maxlen=REMEMBERED)

    def add(self, job: str, kind: str) -> None:
        self._count += 1
        self._latest.append((job, kind))

    @property
    def mark(self) -> str:
        return f"{self._run}-{self._count}"

    def since(self, mark: str) -> list[tuple[str, str]] | None:
        """Job and kind of the events after a mark; None where they are not known: a mark of another run, one too long
        ago, or no mark at all."""
        run, _, count = mark.partition("-")
        if run != self._run or not (count.isascii() and count.isdigit() and len(count) < 20):
            return None
        missed = self._count - int(count)
        if not 0 <= missed <= len(self._latest):
            return None
        return list(self._latest)[len(self._latest) - missed :]


class Live:
    """Hears all jobs and tells all listeners.

    changed: called in the loop before they are told of a job's new status or batch
    noted: told of the job that somebody has said something of
    """

    def __init__(
        self,
        client: Client,
        rates: Rates,
        changed: Callable[[], None] = lambda: None,
        noted: Callable[[str], None] = lambda job: None,
    ):
        self._client, self._rates, self._changed, self._noted = client, rates, changed, noted
        self._listeners: set[Listener] = set()
        self._events = EventLog()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._hear, name="dashboard-events", daemon=True)

    def start(self) -> None:
        """To be called in the loop that serves browsers."""
        self._loop = asyncio.get_running_loop()
        self._thread.start()

    def link_changed(self, here: bool) -> None:
        """Tell that the service is there, or is not; from any thread."""
        self._soon(self._tell_link, here)

    def close(self) -> None:
        """End the streams; from any thread, and from a signal's handler."""
        self._stopping.set()
        self._soon(self._wake_all)

    def _wake_all(self) -> None:
        for listener in self._listeners:
            listener.woken.set()

    @property
    def full(self) -> bool:
        return len(self._listeners) >= MOST_LISTENERS

    @property
    def mark(self) -> str:
        """What has been told by now; for `stream`. To be taken before a page is drawn."""
        return self._events.mark

    async def stream(self, job: str | None, here: bool | None, since: str) -> AsyncIterator[bytes]:
        """Events of one job, or of all, as text/event-stream, those after the mark `since` first.

        here: what is known of the service now
        """
        listener = Listener()
        listener.link = here
        missed = self._events.since(since)
        listener.all = missed is None
        for name, kind in missed or ():
            listener.jobs[name].add(kind)
        self._listeners.add(listener)
        try:
            yield b"retry: 2000\n\n"
            while not self._stopping.is_set():
                if listener.link is not None:
                    yield _event("link", {"here": listener.link})
                    listener.link = None
                changed = {
                    name: sorted(kinds) for name, kinds in listener.jobs.items() if job in (None, name)
                }
                everything, listener.all = listener.all, False
                listener.jobs.clear()
                listener.woken.clear()
                if everything:
                    yield _event("all", {}, self.mark)
                elif changed:
                    yield _event("jobs", changed, self.mark)
                try:
                    await asyncio.wait_for(listener.woken.wait(), QUIET_S)
                    await asyncio.sleep(GATHER_S)
                except TimeoutError:
                    yield b": still here\n\n"
        finally:
            self._listeners.discard(listener)

    # -- inside ----------------------------------------------------------------------------------------------

    def _hear(self) -> None:
        while not self._stopping.is_set():
            try:
                with self._client.subscribe() as heard:
                    while not self._stopping.is_set():
                        body = heard.get(LOOK_S)
                        if body is not None:
                            self._heard(body)
            except NoAnswer:
                self._stopping.wait(LOOK_S)  # nobody was there yet

    def _heard(self, body: bytes) -> None:
        try:
            event = msgspec.json.decode(body, type=Event)
        except msgspec.MsgspecError as error:
            log.warning("an event that cannot be read: %s", error)
            return
        if event.kind == "progress" and isinstance(event.body.get("rollouts"), int):
            self._rates.hear(event.job, event.body["rollouts"])
        self._soon(self._tell, event.job, event.kind)

    def _soon(self, what: Callable, *values: object) -> None:
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(what, *values)

    def _tell(self, job: str, kind: str) -> None:
        self._events.add(job, kind)
        if kind == "note":
            self._noted(job)
        if kind != "progress":
            self._changed()
        for listener in self._listeners:
            listener.jobs[job].add(kind)
            listener.woken.set()

    def _tell_link(self, here: bool) -> None:
        for listener in self._listeners:
            listener.link = here
            listener.woken.set()


def _event(name: str, data: object, mark: str = "") -> bytes:
    """A server-sent event as bytes.

    mark: where a browser that loses the connection goes on (Last-Event-ID)
    """
    number = f"id: {mark}\n" if mark else ""
    return f"{number}event: {name}\ndata: {json.dumps(data)}\n\n".encode()
