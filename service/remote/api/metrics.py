"""Prometheus metrics of a service, by choice (`tailroad serve --metrics HOST:PORT`)."""

import socket
import threading
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler, WSGIServer, make_server

from prometheus_client import CollectorRegistry, Counter, Histogram, make_wsgi_app
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.exposition import ThreadingWSGIServer
from prometheus_client.registry import Collector

from service.errors import InputError
from service.evaluation.store.jobs import Event
from service.remote.api.hosts import host_name, is_address
from service.remote.fleet.service import Fleet

REQUEST_S = 10.0  # in which a request must have come
SCRAPE_S = 5.0  # in which a scheduler that is well answers


class Metrics(Collector):
    """Counts requests and events, and reads the fleet's state when scraped."""

    def __init__(self, fleet: Fleet):
        self._fleet = fleet
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="metrics")
        self.registry = CollectorRegistry()
        self._requests = Counter(
            "tailroad_api_requests", "Requests, by what was asked and HTTP status.", ("action", "status"),
            registry=self.registry,
        )  # fmt: skip
        self._seconds = Histogram(
            "tailroad_api_request_seconds", "Time to answer a request.", ("action",), registry=self.registry
        )
        self._ended = Counter(
            "tailroad_jobs_ended", "Jobs that ended, by status.", ("status",), registry=self.registry
        )
        self._found_wrong = Counter(
            "tailroad_quarantines", "Times that a job lost rollouts of a worker that was found wrong.",
            registry=self.registry,
        )  # fmt: skip
        self.registry.register(self)
        fleet.listen(self._on_event)

    def seen(self, action: str, status: int, seconds: float) -> None:
        """Count a request."""
        self._requests.labels(action, str(status)).inc()
        self._seconds.labels(action).observe(seconds)

    def _on_event(self, event: Event) -> None:
        if event.kind == "status" and event.body["status"] not in ("running", "paused"):
            self._ended.labels(event.body["status"]).inc()
        elif event.kind == "quarantine":
            self._found_wrong.inc()

    def describe(self) -> Iterable[GaugeMetricFamily]:
        return ()  # registering asks nothing of the fleet

    def collect(self) -> Iterable[GaugeMetricFamily]:
        try:
            workers = self._pool.submit(self._fleet.workers).result(SCRAPE_S)
            open_jobs = self._pool.submit(self._fleet.open_jobs).result(SCRAPE_S)
        except TimeoutError:
            yield GaugeMetricFamily("tailroad_scheduler_up", "Whether the scheduler answers.", 0.0)
            return
        here = [w for w in workers if not w.quarantine]
        yield GaugeMetricFamily("tailroad_scheduler_up", "Whether the scheduler answers.", 1.0)
        yield GaugeMetricFamily("tailroad_open_jobs", "Jobs that are not over.", open_jobs)
        yield GaugeMetricFamily("tailroad_workers", "Connected workers.", len(here))
        yield GaugeMetricFamily("tailroad_worker_procs", "Their processes.", sum(w.procs for w in here))
        yield GaugeMetricFamily("tailroad_leases", "Chunks that are out now.", sum(w.leases for w in here))
        yield GaugeMetricFamily(
            "tailroad_rollouts",
            "Rollouts that the connected workers have answered.",
            sum(w.rollouts for w in here),
        )
        yield GaugeMetricFamily(
            "tailroad_quarantined_workers", "Workers in quarantine.", len(workers) - len(here)
        )

    def serve(self, address: str) -> "Server":
        """Answer scrapes at HOST:PORT, or PORT of the loopback; InputError where that cannot be."""
        host, _, port = address.rpartition(":")
        if not (port.isascii() and port.isdigit() and 0 < int(port) < 65536):
            raise InputError(f"--metrics {address}: give HOST:PORT, or PORT for this machine alone")
        try:
            return Server(_listening(int(port), host.strip("[]") or "127.0.0.1", self.registry))
        except OSError as error:
            raise InputError(f"--metrics {address}: {error.strerror or error}") from error


class Server:
    """The HTTP server of the metrics."""

    def __init__(self, server: WSGIServer):
        self._server = server
        self._thread = threading.Thread(target=server.serve_forever, name="metrics", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Handler(WSGIRequestHandler):
    """Writes no lines, and gives up on a request that does not come."""

    timeout = REQUEST_S

    def log_message(self, format: str, *args: Any) -> None:
        pass


def _listening(port: int, host: str, registry: CollectorRegistry) -> WSGIServer:
    """A server that answers scrapes by an IP address, this machine's names, or the host that it was given."""
    scrape = make_wsgi_app(registry)
    names = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}

    def application(environ: dict[str, Any], start_response: Any) -> Any:
        name = host_name(environ.get("HTTP_HOST", ""))
        if name is None or not (name in names or is_address(name)):
            start_response("421 Misdirected Request", [("Content-Type", "text/plain")])
            return [b"Metrics are not served by this name: use the machine's IP address or its own name.\n"]
        return scrape(environ, start_response)

    class Listening(ThreadingWSGIServer):
        address_family = socket.AF_INET6 if ":" in host else socket.AF_INET

    return make_server(host, port, application, Listening, _Handler)
