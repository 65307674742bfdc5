"""`tailroad serve`: scheduler, router, local workers and dashboard of one machine, in one command."""

import signal
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.evaluation.cores import core_count
from service.front.cli.api_options import ApiSettings, api_options, metrics_of
from service.front.cli.dashboard import DEFAULT_ADDRESS, OFF, address_or_off
from service.front.cli.options import FOLDER, zenoh_config_option

if TYPE_CHECKING:
    from service.remote.fleet.supervised import SupervisedProcess

WORKER_DRAIN_S, DASHBOARD_DRAIN_S = 60.0, 5.0  # what each is given to end
ANYWHERE = ("0.0.0.0", "[::]")
LOOPBACK = ("/127.", "/localhost:", "/[::1]")


@click.command()
@click.option("--listen", multiple=True, default=("tcp/127.0.0.1:7447",), show_default=True,
              help="Zenoh endpoint for workers and clients; once for each.")  # fmt: skip
@click.option("--home", type=FOLDER, default=Path("fleet"), show_default=True,
              help="Folder of the database.")  # fmt: skip
@click.option("--store", "--database", "database", help="URL of the database, for PostgreSQL: "
              "postgresql+psycopg://USER@HOST/NAME.  [default: SQLite in --home]")  # fmt: skip
@click.option("--procs", "--workers", "workers", type=click.IntRange(0, 1024), help="Local worker processes; 0: none.  "
              "[default: one for each core]")  # fmt: skip
@api_options()
@click.option("--audit-share", type=click.FloatRange(0, 1), default=0.02, show_default=True,
              help="Share of the chunks that a second worker runs again, to compare.")  # fmt: skip
@click.option("--verify-seconds", type=click.FloatRange(0, 3600), default=5.0, show_default=True,
              help="How long the record is checked before the start; `tailroad verify` checks all.")  # fmt: skip
@click.option("--chunk-seconds", type=click.FloatRange(0.01, 600), default=1.0, show_default=True,
              help="Work of a chunk: what a lost worker costs, and how often one asks.")  # fmt: skip
@click.option("--dashboard", metavar="[HOST:]PORT|off", callback=address_or_off,
              help="Where browsers find the dashboard.  "
              f"[default: {DEFAULT_ADDRESS}; with --zenoh-config off: whoever reaches it acts with a client's "
              "keys]")  # fmt: skip
@zenoh_config_option("Zenoh configuration file, for TLS, passwords and access control.")
@click.option("--worker-config", type=click.Path(exists=True, dir_okay=False),
              help="With --zenoh-config: the configuration of the local workers.  [default: worker.json5 beside it; "
              "where there is none, no local workers]")  # fmt: skip
@click.option(
    "--dashboard-config",
    type=click.Path(exists=True, dir_okay=False),
    help="With --zenoh-config: the configuration of the dashboard, a client, or a reader for one that changes "
    "nothing.  [default: client.json5 beside it]",
)
def command(
    listen: tuple[str, ...],
    home: Path,
    database: str | None,
    workers: int | None,
    audit_share: float,
    verify_seconds: float,
    chunk_seconds: float,
    dashboard: str | None,
    zenoh_config: str | None,
    worker_config: str | None,
    dashboard_config: str | None,
    api: ApiSettings,
) -> None:
    """Serve jobs: take them, run them on local and connected workers, answer questions, until told to stop.

    What was run is in the database: a serve that was killed goes on where it was.
    """
    from service.errors import InputError, TailroadError
    from service.evaluation.store.database import sqlite_url
    from service.evaluation.store.jobs import JobStore
    from service.logs import log_to_stderr
    from service.remote.api.server import Api
    from service.remote.fleet.first_look import first_look, log_look
    from service.remote.fleet.hub import Hub
    from service.remote.fleet.policy import Policy
    from service.remote.fleet.service import Fleet
    from service.remote.fleet.zenoh_link import HubLink, router_session

    log_to_stderr(api.log_json)
    limits = api.read_limits()
    worker_config = worker_config or _beside(zenoh_config, "worker.json5")
    dashboard_config = dashboard_config or _beside(zenoh_config, "client.json5")
    procs = _checked_procs(workers, zenoh_config, worker_config)
    dashboard = dashboard or (DEFAULT_ADDRESS if zenoh_config is None else OFF)
    if dashboard != OFF and zenoh_config is not None and dashboard_config is None:
        raise click.BadParameter(
            f"there is no client.json5 beside {zenoh_config}: name the configuration of a client with "
            "--dashboard-config", param_hint="--dashboard")  # fmt: skip
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
        if verify_seconds > 0.0:
            log_look(first_look(store, verify_seconds))
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
        here = from_here(listen[0])
        helpers = [_local_worker(here, procs, worker_config)] if procs > 0 else []
        if dashboard != OFF:
            helpers.append(_dashboard(here, dashboard, dashboard_config))
        for helper in helpers:
            stack.callback(helper.stop)
        click.echo(f"serving on {', '.join(listen)}, {procs} local worker processes", err=True)
        stopping.wait()
        click.echo("stopping: what is being run is finished first", err=True)
        for helper in helpers:
            helper.begin_to_stop()
    if died.is_set():
        raise TailroadError(
            "the scheduler ended, for the reason told above; nothing recorded is lost: start it again"
        )


def from_here(endpoint: str) -> str:
    """Where this machine itself reaches what listens at the endpoint: by a name that a certificate can hold."""
    scheme, _, rest = endpoint.partition("/")
    host, colon, port = rest.rpartition(":")
    return f"{scheme}/localhost:{port}" if colon and scheme != "tcp" and host in ANYWHERE else endpoint


def _beside(zenoh_config: str | None, name: str) -> str | None:
    """The configuration of that name that lies with the scheduler's, as make-security writes them."""
    if zenoh_config is None:
        return None
    found = Path(zenoh_config).parent / name
    return str(found) if found.is_file() else None


def _checked_procs(workers: int | None, zenoh_config: str | None, worker_config: str | None) -> int:
    """How many local worker processes there are to be."""
    if zenoh_config is None or worker_config is not None:
        return core_count() if workers is None else workers
    if workers:
        raise click.BadParameter(
            f"there is no worker.json5 beside {zenoh_config}: name the configuration of a worker with "
            "--worker-config, or run the workers elsewhere (--workers 0)", param_hint="--workers")  # fmt: skip
    return 0


def _local_worker(endpoint: str, procs: int, zenoh_config: str | None) -> "SupervisedProcess":
    """Its processes fill the cores themselves, so that the linear algebra of each takes one thread."""
    from service.remote.fleet.supervised import SupervisedProcess

    arguments = ["worker", "--connect", endpoint, "--procs", str(procs), *_configured(zenoh_config)]
    return SupervisedProcess("the local worker", arguments, WORKER_DRAIN_S, {"OPENBLAS_NUM_THREADS": "1"})


def _dashboard(endpoint: str, address: str, zenoh_config: str | None) -> "SupervisedProcess":
    from service.remote.fleet.supervised import SupervisedProcess

    arguments = ["dashboard", "--connect", endpoint, "--address", address, *_configured(zenoh_config)]
    return SupervisedProcess("the dashboard", arguments, DASHBOARD_DRAIN_S, final=(2,))


def _configured(zenoh_config: str | None) -> list[str]:
    return ["--zenoh-config", zenoh_config] if zenoh_config else []
