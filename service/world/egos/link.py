"""The worker's end of the line to ego services: Zenoh queries with a deadline, and nothing about what they mean."""

import atexit
import json
import threading
from typing import Protocol

import zenoh

from service.errors import EgoError, InputError
from service.world.egos.settings import EgoSettings

SERVICES = "tailroad/v1/egos/{name}/services/{instance}"  # the key of an ego service
MAX_MESSAGE_BYTES = 4 * 1024 * 1024  # larger ones are dropped by the transport before anything reads them
ALL = zenoh.QueryTarget.ALL


class Line(Protocol):
    """What `service.world.egos.remote` needs of a network."""

    def wait(self, name: str, patience_s: float) -> bool:
        """Wait until a service of that name is there; whether one is."""

    def ask_all(self, name: str, payload: bytes, deadline_s: float) -> list[bytes]:
        """Every service's answer that came before the deadline."""

    def ask(self, name: str, instance: str, payload: bytes) -> bytes:
        """One service's answer; EgoError where it is late or the service is gone."""

    def tell(self, name: str, instance: str, payload: bytes) -> None:
        """Send without waiting for an answer."""

    def close(self) -> None: ...


class ZenohLine:
    """A Zenoh session of this process, opened when first needed."""

    def __init__(self, settings: EgoSettings, patience_s: float):
        """EgoError where nothing listens at the address within `patience_s`."""
        self._settings = settings
        self._session = _open(settings, patience_s)
        atexit.register(self.close)  # an open session keeps the interpreter from ending
        self._asked: tuple[str, zenoh.Querier] | None = None

    def wait(self, name: str, patience_s: float) -> bool:
        there = threading.Event()

        def on_life(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                there.set()

        # only for as long as somebody waits: the thread that calls back would keep the process from ending
        subscriber = self._session.liveliness().declare_subscriber(
            SERVICES.format(name=name, instance="*"), on_life, history=True
        )
        try:
            return there.wait(patience_s)
        finally:
            subscriber.undeclare()

    def ask_all(self, name: str, payload: bytes, deadline_s: float) -> list[bytes]:
        replies = self._session.get(
            SERVICES.format(name=name, instance="*"),
            payload=payload,
            timeout=deadline_s,
            target=ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

    def ask(self, name: str, instance: str, payload: bytes) -> bytes:
        key = SERVICES.format(name=name, instance=instance)
        if self._asked is None or self._asked[0] != key:
            self._asked = key, self._session.declare_querier(key, timeout=self._settings.deadline_s)
        for reply in self._asked[1].get(payload=payload):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
            raise EgoError(
                f"no answer of ego service {name!r} within its deadline of {self._settings.deadline_s:g} s"
            )
        raise EgoError(f"ego service {name!r} is gone")

    def tell(self, name: str, instance: str, payload: bytes) -> None:
        self._session.get(SERVICES.format(name=name, instance=instance), payload=payload, timeout=0.1)

    def close(self) -> None:
        atexit.unregister(self.close)
        self._session.close()


def _open(settings: EgoSettings, patience_s: float) -> zenoh.Session:
    where = settings.config or settings.address
    try:
        config = zenoh.Config.from_file(settings.config) if settings.config else _client(settings, patience_s)
    except zenoh.ZError as error:
        raise InputError(f"{settings.config} is not a Zenoh configuration: {error}") from error
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise EgoError(
            f"no ego service and no Zenoh router can be reached at {where}: start it first"
        ) from error


def _client(settings: EgoSettings, patience_s: float) -> zenoh.Config:
    """A client of one address: nothing listens, nothing is scouted."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"client"'),
        ("connect/endpoints", json.dumps([settings.address])),
        ("connect/timeout_ms", str(int(1000 * patience_s))),
        ("scouting/multicast/enabled", "false"),
        ("transport/link/rx/max_message_size", str(MAX_MESSAGE_BYTES)),
    ):
        config.insert_json5(key, value)
    return config
