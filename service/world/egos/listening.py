"""A service's end of the line: it announces itself, and answers all queries that wait, until it is closed."""

import json
from collections.abc import Sequence
from typing import Protocol

import zenoh

from service.closing import Closing
from service.world.egos import ego_pb2 as pb
from service.world.egos.link import SERVICES
from service.world.egos.settings import DEFAULT_ADDRESS

MAX_REQUEST_BYTES = 64 * 1024 * 1024  # a picture of 4000 x 3000 is 36 MB
WAITING = 4096  # queries at most that wait for an answer


class Answers(Protocol):
    """What a service says."""

    instance: str

    def answer(self, payloads: Sequence[bytes]) -> list[pb.Reply | None]:
        """The reply to each request; None where none is due."""


class Listening(Closing):
    """A service on the network; use as a context manager.

    listen: an address that workers connect to, loopback by default
    connect: a Zenoh router to go through instead
    config: a Zenoh configuration file in place of the addresses
    """

    def __init__(
        self,
        answers: Answers,
        name: str,
        listen: str | None = DEFAULT_ADDRESS,
        connect: str | None = None,
        config: str | None = None,
    ):
        self._answering = answers
        self._key = SERVICES.format(name=name, instance=answers.instance)
        self._session = zenoh.open(_config(listen, connect, config))
        self._queries = self._session.declare_queryable(self._key, zenoh.handlers.FifoChannel(WAITING))
        self._life = self._session.liveliness().declare_token(self._key)

    def close(self) -> None:
        """Leave the network; `run` returns."""
        self._session.close()

    def run(self) -> None:
        """Answer workers until the service is closed: each time all queries that wait."""
        while True:
            try:
                waiting = [self._queries.recv()]
                while (more := self._queries.try_recv()) is not None:
                    waiting.append(more)
            except zenoh.ZError:
                return  # closed
            payloads = [query.payload.to_bytes() if query.payload else b"" for query in waiting]
            for query, reply in zip(waiting, self._answering.answer(payloads), strict=True):
                with query:
                    if reply is not None:
                        query.reply(self._key, reply.SerializeToString())


def _config(listen: str | None, connect: str | None, file: str | None) -> zenoh.Config:
    if file is not None:
        return zenoh.Config.from_file(file)
    config = zenoh.Config()
    if connect is not None:
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([connect]))
    else:
        config.insert_json5("mode", '"router"')  # so that other services and their workers can meet here
        config.insert_json5("listen/endpoints", json.dumps([listen]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/link/rx/max_message_size", str(MAX_REQUEST_BYTES))
    return config
