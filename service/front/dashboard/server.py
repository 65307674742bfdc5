"""The dashboard at an address."""

import asyncio
import logging
import socket
from collections.abc import Sequence
from types import FrameType

import uvicorn

from service.errors import InputError
from service.front.dashboard.app import make_app
from service.front.dashboard.book import Book
from service.front.dashboard.impatient import ImpatientProtocol
from service.front.dashboard.link import Link
from service.front.dashboard.live import Live, Rates
from service.front.dashboard.site import Site
from service.remote.client import Client

log = logging.getLogger("tailroad.dashboard")

DRAIN_S = 1  # for pages that are being answered when it ends


class _Server(uvicorn.Server):
    """Ends the event streams when it is told to stop, so that open pages do not hold it up."""

    def __init__(self, config: uvicorn.Config, live: Live):
        super().__init__(config)
        self._live = live

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self._live.close()
        super().handle_exit(sig, frame)


class Dashboard:
    """Serves browsers at host:port (port 0: any free one; `port` says which) until stopped.

    client: must not wait for long answers (patience_s=0)
    root: path that a proxy has it under, as /tailroad
    """

    def __init__(
        self,
        client: Client,
        host: str,
        port: int,
        names: Sequence[str] = (),
        read_only: bool = False,
        root: str = "",
    ):
        self._socket = _listening(host, port)
        self.port: int = self._socket.getsockname()[1]
        rates = Rates()
        book = Book()
        self._live = Live(client, rates, lambda: self._link.forget_passing(), book.noted)
        self._link = Link(client, self._live.link_changed)
        site = Site(self._link, self._live, rates, read_only, book, root)
        config = uvicorn.Config(
            make_app(site, names),
            log_config=None,
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=DRAIN_S,
            limit_concurrency=500,
            h11_max_incomplete_event_size=65536,
            http=ImpatientProtocol,
        )
        self._server = _Server(config, self._live)

    def run(self) -> None:
        """Until `stop`, or until a signal where this is the main thread."""
        try:
            asyncio.run(self._server.serve(sockets=[self._socket]))
        finally:
            self._live.close()
            self._link.close()
            self._socket.close()

    def stop(self) -> None:
        """From another thread."""
        self._live.close()
        self._server.should_exit = True


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        found = socket.socket(family, kind)
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind(address)
        found.listen(128)
        return found
    except OSError as error:
        text = f"the dashboard cannot be served at {host}:{port}: {error.strerror or error}; give another address"
        raise InputError(text) from error
