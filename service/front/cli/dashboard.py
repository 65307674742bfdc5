"""`tailroad dashboard`: pages for browsers on what a service does."""

import ipaddress
import re
from typing import Any

import click

from service.front.cli.options import connect_option, zenoh_config_option
from service.remote.client import DEFAULT_ENDPOINT

DEFAULT_ADDRESS = "127.0.0.1:7448"
OFF = "off"


def address_of(text: str) -> tuple[str, int]:
    """Host and port of [HOST:]PORT; without HOST this machine alone. click.BadParameter where it is neither."""
    host, colon, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and len(port) < 6 and int(port) < 65536) or (
        colon and not host
    ):
        raise click.BadParameter(f"{text!r}: give [HOST:]PORT, as in {DEFAULT_ADDRESS}")
    return host.strip("[]") or "127.0.0.1", int(port)


def address_or_off(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    if value is not None and value != OFF:
        address_of(value)
    return value


def _checked(ctx: click.Context, param: click.Parameter, value: str) -> Any:
    return address_of(value)


def _root(ctx: click.Context, param: click.Parameter, value: str) -> str:
    if value and not re.fullmatch(r"(/[A-Za-z0-9._~-]+)+/?", value):
        raise click.BadParameter(f"{value!r}: give a path, as in /tailroad")
    return value.rstrip("/")


@click.command()
@connect_option("Zenoh endpoint of the service or a router", (DEFAULT_ENDPOINT,))
@click.option("--address", default=DEFAULT_ADDRESS, show_default=True, metavar="[HOST:]PORT", callback=_checked,
              help="Where browsers find it; port 0: any that is free.")  # fmt: skip
@click.option("--name", "names", multiple=True, metavar="NAME",
              help="Host name, beside localhost and IP addresses, that browsers may call it by, behind a proxy for "
              "instance; once for each.")  # fmt: skip
@click.option(
    "--read-only",
    is_flag=True,
    help="Show all and change nothing: no submitting, cancelling, pausing. So with the configuration of a reader.",
)
@click.option("--root", default="", metavar="/PATH", callback=_root,
              help="Path that a proxy has it under, as /tailroad; taken off by it or not.")  # fmt: skip
@zenoh_config_option()
@click.option("--timeout", type=click.FloatRange(0.1, 3600), default=20.0, show_default=True,
              help="Seconds to wait for an answer of the service.")  # fmt: skip
@click.option("--parent", type=int, hidden=True, help="End when the process of this id ends.")
def command(
    connect: tuple[str, ...],
    address: tuple[str, int],
    names: tuple[str, ...],
    read_only: bool,
    root: str,
    zenoh_config: str | None,
    timeout: float,
    parent: int | None,
) -> None:
    """Serve pages on the jobs of a service: estimates as they move, failures with their replay, comparisons, workers.

    There is no log-in: whoever reaches the address may use it, so it is this machine alone unless told otherwise. From
    elsewhere go through an SSH tunnel, or a proxy that asks who is there. The service may start and end meanwhile.
    """
    from service.evaluation.parent import end_with_parent
    from service.front.dashboard.server import Dashboard
    from service.logs import log_to_stderr
    from service.remote.client import Client

    log_to_stderr(False)
    host, port = address
    if not _is_loopback(host):
        click.echo(f"warning: whoever reaches {host} may use this dashboard; it has no log-in", err=True)
    with Client(connect, zenoh_config, timeout, patience_s=0.0, read_only=read_only) as client:
        dashboard = Dashboard(client, host, port, names, client.read_only, root)
        if parent is not None:
            end_with_parent(parent)
        shown = f"[{host}]" if ":" in host else host
        click.echo(f"dashboard on http://{shown}:{dashboard.port}{root}/", err=True)
        dashboard.run()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
