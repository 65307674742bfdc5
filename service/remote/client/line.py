"""The client's line to a service: one Zenoh session, queries and subscriptions as bytes."""

import queue
import threading
import time
from collections.abc import Sequence

import zenoh

from service.errors import InputError
from service.remote.client.errors import NoAnswer
from service.remote.fleet.sessions import NotAdmitted, SessionError, client_session

AGAIN_S = (0.2, 0.5, 1.0)  # pauses before a question is asked again that got an empty answer
QUIET_S = 5.0  # after which a line may be broken unnoticed
JSON = zenoh.Encoding.APPLICATION_JSON


class Subscription:
    """What is published on a key, in order, until closed."""

    def __init__(self, session: zenoh.Session, key: str):
        self._samples: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._subscriber = session.declare_subscriber(key, lambda s: self._samples.put(s.payload.to_bytes()))

    def get(self, timeout_s: float) -> bytes | None:
        """The next body; None where none came in time."""
        try:
            return self._samples.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def __enter__(self) -> "Subscription":
        return self

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()


class Line:
    """A session with the service at one of the endpoints, opened when first needed.

    timeout_s: for a connection, and for an answer
    about: a key that is always answered
    """

    def __init__(
        self,
        connect: Sequence[str],
        zenoh_config: str | None,
        timeout_s: float,
        about: str = "tailroad/v1/about",
    ):
        self._connect, self._config, self._timeout_s = list(connect), zenoh_config, timeout_s
        self._about = about
        self._lock = threading.Lock()
        self._open: zenoh.Session | None = None
        # queries say which session they are of, by any entity of it
        self._source: zenoh.SourceInfo | None = None
        self._heard = float("-inf")  # when an answer came last

    def ask(self, selector: str, payload: bytes | None = None) -> tuple[bool, bytes]:
        """Whether it is an answer and not a problem, and the JSON; NoAnswer where none came."""
        session = self._session()
        if payload is not None and time.monotonic() - self._heard > QUIET_S:
            # an order is given once, so over a line that is known to live
            self._asked(session, self._about, None)
        found = self._asked(session, selector, payload)
        self._heard = time.monotonic()
        return found

    def _asked(self, session: zenoh.Session, selector: str, payload: bytes | None) -> tuple[bool, bytes]:
        """The answer. An empty one comes at once over a line that was broken and is mended: it is asked for again, an
        order excepted."""
        until = time.monotonic() + self._timeout_s
        for pause_s in (*(AGAIN_S if payload is None else ()), None):
            found = self._once(session, selector, payload, max(until - time.monotonic(), 0.1))
            if found is not None:
                return found
            if pause_s is None or time.monotonic() + pause_s >= until:
                break
            time.sleep(pause_s)
        raise NoAnswer(self._hint(session))

    def _once(
        self, session: zenoh.Session, selector: str, payload: bytes | None, limit_s: float
    ) -> tuple[bool, bytes] | None:
        encoding = JSON if payload else None
        try:
            replies = session.get(
                selector, payload=payload, encoding=encoding, timeout=limit_s, source_info=self._source
            )
            for reply in replies:
                if reply.ok is not None:
                    return True, reply.ok.payload.to_bytes()
                if reply.err is not None and (body := reply.err.payload.to_bytes()).startswith(b"{"):
                    return False, body
        except zenoh.ZError as error:
            raise InputError(f"{selector}: not a key that can be asked for: {error}") from error
        return None

    def subscribe(self, key: str) -> Subscription:
        return Subscription(self._session(), key)

    def close(self) -> None:
        if self._open is not None:
            self._open.close()

    def _session(self) -> zenoh.Session:
        with self._lock:
            if self._open is None:
                try:
                    self._open = client_session(self._connect, self._config, self._timeout_s)
                    self._source = zenoh.SourceInfo(self._open.declare_querier(self._about).id, 0)
                except NotAdmitted as error:
                    raise NoAnswer(str(error)) from error
                except SessionError as error:
                    raise NoAnswer(self._hint()) from error
            return self._open

    def _hint(self, session: zenoh.Session | None = None) -> str:
        where = ", ".join(self._connect)
        if session is not None and list(session.info.routers_zid()):
            return (
                f"{where} is connected, and nobody answers there: the rights of this certificate or password do not "
                "reach so far (see --zenoh-config), or no `tailroad serve` works behind this router"
            )
        return (
            f"nobody answers at {where}; is `tailroad serve` running there? Give its address with --connect, and "
            "--zenoh-config where it asks for a certificate or password"
        )
