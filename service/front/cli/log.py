"""`tailroad log`: who told a service to do what, and what it refused."""

import click
import msgspec

from service.front.cli.export import store_of
from service.front.cli.options import json_option


@click.command()
@click.argument("store")
@click.option("--after", type=click.IntRange(min=0), default=0, help="Only lines after this number.")
@click.option("--head", is_flag=True, help="Only the last line's hash: note it elsewhere, for --has.")
@click.option("--has", metavar="HASH", default="", help="A hash that was noted: its line must be there.")
@json_option()
def command(store: str, after: int, head: bool, has: str, as_json: bool) -> None:
    """Who submitted, cancelled, paused and resumed jobs of STORE, and what was refused: a database's URL, or the --home
    of `tailroad serve`.

    Each line has a hash of all before it. Ends with exit code 2 where a line was changed or is missing, as `tailroad
    verify --store` does. The service may run meanwhile.
    """
    from service.errors import StoreError

    with store_of(store) as opened:
        last = ""
        for entry in opened.log.entries(after):
            last = entry.hash
            if as_json:
                click.echo(msgspec.json.encode(entry))
            elif not head:
                what = f"{entry.did} {entry.job}".strip() + (
                    f": refused, {entry.refused}" if entry.refused else ""
                )
                click.echo(f"{entry.number}  {entry.at}  {entry.who}  {what}")
        if head:
            click.echo(last)
        if wrong := opened.log.wrong(has):
            raise StoreError("; ".join(wrong))
