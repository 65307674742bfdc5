"""What the commands that talk to a service share: where it is, and how its answers are printed."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from service.front.cli.options import all_of, connect_option, zenoh_config_option
from service.remote.client import DEFAULT_ENDPOINT, Client


def client_options() -> Callable:
    """`--connect`, `--zenoh-config` and `--timeout`; the command is given `client`, which it must use as a context."""
    options = all_of(
        connect_option("Zenoh endpoint of the service or a router", (DEFAULT_ENDPOINT,)),
        zenoh_config_option(),
        click.option("--timeout", type=click.FloatRange(0.1, 3600), default=20.0, show_default=True,
                     help="Seconds to wait for an answer."),
    )  # fmt: skip

    def decorate(command: Callable) -> Callable:
        @wraps(command)
        def with_client(
            *args: Any, connect: tuple[str, ...], zenoh_config: str | None, timeout: float, **others: Any
        ) -> Any:
            with Client(connect, zenoh_config, timeout) as client:
                return command(*args, client=client, **others)

        return options(with_client)

    return decorate
