"""`tailroad worker`: runs rollouts for a scheduler."""

import os
import secrets
import signal
import socket
import sys
from contextlib import suppress

import click

from service.evaluation.parent import end_with_parent
from service.front.cli.options import connect_option, zenoh_config_option

NAME_LETTERS = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")
DRAIN_HINT = "finishing what is being run; once more to stop at once"


@click.command()
@connect_option("Zenoh endpoint of the scheduler or a router", ("tcp/127.0.0.1:7447",))
@click.option(
    "--procs", type=click.IntRange(1, 1024), help="Rollouts at a time.  [default: one for each core]"
)
@click.option("--name", help="Unique among all workers.  [default: made of the host's name]")
@zenoh_config_option()
@click.option("--parent", type=int, hidden=True, help="End when the process of this id ends.")
def command(
    connect: tuple[str, ...],
    procs: int | None,
    name: str | None,
    zenoh_config: str | None,
    parent: int | None,
) -> None:
    """Run rollouts for the scheduler at the given endpoints until told to stop.

    SIGTERM or Ctrl-C: what is being run is finished and answered first. Exit codes: 0 stopped, 2 bad input or refused
    by the scheduler.
    """
    from service.errors import WorkerError
    from service.evaluation.cores import core_count
    from service.remote.fleet.capabilities import capabilities
    from service.remote.fleet.worker import NotWanted, Worker
    from service.remote.fleet.zenoh_link import WorkerConnection, client_session

    name = name or _default_name()
    if not (1 <= len(name) <= 64 and set(name) <= NAME_LETTERS):
        raise click.BadParameter(f"{name!r}: use up to 64 letters, digits, '-' and '_'", param_hint="--name")

    def report(line: str) -> None:
        click.echo(f"worker {name}: {line}; trying on", err=True)

    with client_session(list(connect), zenoh_config, report=report) as session:
        connection = WorkerConnection(session, name)
        worker = Worker(
            name, capabilities(procs or core_count()), connection, lambda line: click.echo(line, err=True)
        )

        def stop(signum: int, frame: object) -> None:
            signal.signal(signum, signal.SIG_DFL)
            worker.stop()
            with suppress(OSError):  # whoever read it may be gone
                click.echo(f"worker {name}: {DRAIN_HINT}", err=True)

        signal.signal(signal.SIGTERM, stop)
        signal.signal(signal.SIGINT, stop)
        if parent is not None:
            end_with_parent(parent)
        try:
            worker.run()
        except NotWanted as error:
            raise WorkerError(str(error)) from error
        finally:
            connection.close()
    sys.exit(0)


def _default_name() -> str:
    host = "".join(c if c in NAME_LETTERS else "-" for c in socket.gethostname())[:40]
    return f"{host}-{os.getpid()}-{secrets.token_hex(2)}"
