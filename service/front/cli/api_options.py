"""Options of `tailroad serve` for its API: what clients may name, how much they may ask, and what is told of it."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from service.front.cli.options import all_of

if TYPE_CHECKING:
    from service.remote.api.limits import Limits
    from service.remote.fleet.service import Fleet


@dataclass(frozen=True)
class ApiSettings:
    """What `tailroad serve` is told of its API.

    offered: scenario files that jobs may name
    limits: NAME=VALUE
    metrics: HOST:PORT
    log_json: objects
    """

    offered: tuple[str, ...]
    limits: tuple[str, ...]
    metrics: str | None
    log_json: bool

    def read_limits(self) -> "Limits":
        """The limits as given; click.BadParameter names one that cannot be."""
        from service.remote.api.limits import Limits

        kinds: dict[str, type] = {name: type(value) for name, value in asdict(Limits()).items()}
        found: dict[str, Any] = {}
        for text in self.limits:
            name, _, value = text.partition("=")
            if name not in kinds:
                raise click.BadParameter(f"{name!r}: there are {', '.join(kinds)}", param_hint="--limit")
            try:
                found[name] = kinds[name](value)
            except ValueError as error:
                wanted = "a whole number" if kinds[name] is int else "a number"
                raise click.BadParameter(f"{text}: give {wanted}", param_hint="--limit") from error
            if not 0 < found[name] < 1e15:
                raise click.BadParameter(f"{text}: give a value above 0", param_hint="--limit")
        return replace(Limits(), **found)


def api_options() -> Callable:
    """`--scenario`, `--limit`, `--metrics` and `--log-json`; the command is given `api`, an ApiSettings."""
    options = all_of(
        click.option("--scenario", "offered", multiple=True, type=click.Path(exists=True, dir_okay=False),
                     help="File of an own scenario that jobs may name; its road and weights must lie at the same path "
                     "on every worker. Once for each."),
        click.option("--limit", "limits", multiple=True, metavar="NAME=VALUE",
                     help="How much clients may ask, as in open_jobs=50 (service/remote/api/limits.py)."),
        click.option("--metrics", metavar="[HOST:]PORT", help="Serve Prometheus metrics over HTTP here; without HOST "
                     "for this machine alone.  [default: none]"),
        click.option("--log-json", is_flag=True, help="Log one JSON object a line."),
    )  # fmt: skip

    def decorate(command: Callable) -> Callable:
        @wraps(command)
        def with_settings(
            *args: Any,
            offered: tuple[str, ...],
            limits: tuple[str, ...],
            metrics: str | None,
            log_json: bool,
            **others: Any,
        ) -> Any:
            return command(*args, api=ApiSettings(offered, limits, metrics, log_json), **others)

        return options(with_settings)

    return decorate


def metrics_of(fleet: "Fleet", address: str | None, stack: ExitStack) -> Callable[[str, int, float], None]:
    """What counts the API's requests; metrics are served at `address`, where there is one, until the stack ends."""
    if address is None:
        return lambda action, status, seconds: None
    from service.remote.api.metrics import Metrics

    metrics = Metrics(fleet)
    stack.callback(metrics.serve(address).close)
    return metrics.seen
