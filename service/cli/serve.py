"""`tailroad serve`: scheduler, router, local workers and dashboard of one machine, in one command."""

import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.cli.api_options import ApiSettings, api_options, metrics_of
from service.cli.dashboard import DEFAULT_ADDRESS, OFF, address_or_off
from service.cli.options import core_count

if TYPE_CHECKING:
    from service.fleet.kept import Kept

WORKER_DRAIN_S, DASHBOARD_DRAIN_S = 60.0, 5.0  # what each is given to end
LOOPBACK = ("/127.", "/localhost:", "/[::1]")


@click.command()
@click.option("--listen", multiple=True, default=("tcp/127.0.0.1:7447",), show_default=True,
              help="Zenoh endpoint for workers and clients; once for each.")  # fmt: skip
@click.option("--home", type=click.Path(file_okay=False, path_type=Path), default=Path("fleet"), show_default=True,
              help="Folder of the database.")  # fmt: skip
@click.option("--store", "--database", "database", help="URL of the database, for PostgreSQL: "
              "postgresql+psycopg://USER@HOST/NAME.  [default: SQLite in --home]")  # fmt: skip
@click.option("--procs", "--workers", "workers", type=click.IntRange(0, 1024), help="Local worker processes; 0: none.  "
              "[default: one for each core]")  # fmt: skip
@api_options()
@click.option("--audit-share", type=click.FloatRange(0, 1), default=0.02, show_default=True,
              help="Share of the chunks that a second worker runs again, to compare.")  # fmt: skip
@click.option("--chunk-seconds", type=click.FloatRange(0.01, 600), default=1.0, show_default=True,
              help="Work of a chunk: what a lost worker costs, and how often one asks.")  # fmt: skip
@click.option("--dashboard", metavar="[HOST:]PORT|off", callback=address_or_off,
              help="Where browsers find the dashboard.  "
              f"[default: {DEFAULT_ADDRESS}; with --zenoh-config off, as it needs a client's keys]")  # fmt: skip
@click.option("--zenoh-config", type=click.Path(exists=True, dir_okay=False),
              help="Zenoh configuration file, for TLS, passwords and access control.")  # fmt: skip
def command(
    listen: tuple[str, ...],
    home: Path,
    database: str | None,
    workers: int | None,
    audit_share: float,
    chunk_seconds: float,
    dashboard: str | None,
    zenoh_config: str | None,
    api: ApiSettings,
) -> None:
    """Serve jobs: take them, run them on local and connected workers, answer questions, until told to stop.

    What was run is in the database: a serve that was killed goes on where it was.
    """
    from service.api.server import Api
    from service.errors import InputError, TailroadError
    from service.fleet.hub import Hub
    from service.fleet.policy import Policy
    from service.fleet.service import Fleet
    from service.fleet.zenoh_link import HubLink, router_session
    from service.logs import log_to_stderr
    from service.store.database import sqlite_url
    from service.store.jobs import JobStore

    log_to_stderr(api.log_json)
    limits = api.read_limits()
    stopping, died = threading.Event(), threading.Event()

    def on_death() -> None:
        died.set()
        stopping.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stopping.set())
    if zenoh_config is None and any(not any(part in end for part in LOOPBACK) for end in listen):
        click.echo("warning: listening beyond this machine without --zenoh-config lets anybody in", err=True)
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--home {home}: {error.strerror}") from error
    with ExitStack() as stack:
        store = stack.enter_context(JobStore(database or sqlite_url(home / "fleet.sqlite")))
        stack.callback(store.claim().close)
        hub = Hub(
            store,
            Policy(
                audit_share=audit_share,
                chunk_s=chunk_seconds,
                least_chunk_s=0.1 * chunk_seconds,
                open_bytes=limits.open_bytes,
            ),
            on_death=on_death,
        )
        session = stack.enter_context(router_session(list(listen), zenoh_config))
        hub.start()
        stack.callback(hub.stop)
        stack.callback(HubLink(session, hub).close)
        fleet = Fleet(hub)
        seen = metrics_of(fleet, api.metrics, stack)
        stack.callback(Api(session, fleet, api.offered, limits, seen).close)
        procs = core_count() if workers is None else workers
        if procs > 0:
            stack.callback(_local_worker(listen[0], procs, zenoh_config).stop)
        dashboard = dashboard or (DEFAULT_ADDRESS if zenoh_config is None else OFF)
        if dashboard != OFF:
            stack.callback(_dashboard(listen[0], dashboard, zenoh_config).stop)
        click.echo(f"serving on {', '.join(listen)}, {procs} local worker processes", err=True)
        stopping.wait()
        click.echo("stopping: what is being run is finished first", err=True)
    if died.is_set():
        raise TailroadError(
            "the scheduler ended by an error of its own, told above; nothing recorded is lost: start it again"
        )


def _local_worker(endpoint: str, procs: int, zenoh_config: str | None) -> "Kept":
    """Its processes fill the cores themselves, so that the linear algebra of each takes one thread."""
    from service.fleet.kept import Kept

    arguments = ["worker", "--connect", endpoint, "--procs", str(procs), *_configured(zenoh_config)]
    return Kept("the local worker", arguments, WORKER_DRAIN_S, {"OPENBLAS_NUM_THREADS": "1"})


def _dashboard(endpoint: str, address: str, zenoh_config: str | None) -> "Kept":
    from service.fleet.kept import Kept

    arguments = ["dashboard", "--connect", endpoint, "--address", address, *_configured(zenoh_config)]
    return Kept("the dashboard", arguments, DASHBOARD_DRAIN_S, final=(2,))


def _configured(zenoh_config: str | None) -> list[str]:
    return ["--zenoh-config", zenoh_config] if zenoh_config else []
