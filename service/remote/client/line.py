"""The client's line to a service: one Zenoh session, queries and subscriptions as bytes."""

import queue
import threading
from collections.abc import Sequence

import zenoh

from service.errors import InputError
from service.remote.client.errors import NoAnswer
from service.remote.fleet.sessions import SessionError, client_session

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
    """

    def __init__(self, connect: Sequence[str], zenoh_config: str | None, timeout_s: float):
        self._connect, self._config, self._timeout_s = list(connect), zenoh_config, timeout_s
        self._lock = threading.Lock()
        self._open: zenoh.Session | None = None

    def ask(self, selector: str, payload: bytes | None = None) -> tuple[bool, bytes]:
        """Whether it is an answer and not a problem, and the JSON; NoAnswer where none came."""
        session, encoding = self._session(), JSON if payload else None
        try:
            for reply in session.get(selector, payload=payload, encoding=encoding, timeout=self._timeout_s):
                if reply.ok is not None:
                    return True, reply.ok.payload.to_bytes()
                if reply.err is not None and (body := reply.err.payload.to_bytes()).startswith(b"{"):
                    return False, body
        except zenoh.ZError as error:
            raise InputError(f"{selector}: not a key that can be asked for: {error}") from error
        raise NoAnswer(self._hint())

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
                except SessionError as error:
                    raise NoAnswer(self._hint()) from error
            return self._open

    def _hint(self) -> str:
        where = ", ".join(self._connect)
        return (
            f"nobody answers at {where}; is `tailroad serve` running there? Give its address with --connect, and "
            "--zenoh-config where it asks for a certificate or password"
        )
