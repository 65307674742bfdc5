"""`tailroad nets check|plot|build|import`"""

import json
import sys
from pathlib import Path

import click

from service.errors import InputError
from service.world.sim.sumo_check import check_in_sumo
from sumo_nets.build import build_net, write_sources
from sumo_nets.check import check as check_net
from sumo_nets.corridor import load_corridor
from sumo_nets.opendrive import import_opendrive
from sumo_nets.plot import plot as plot_net

EDGES = click.option(
    "--edge", "edges", multiple=True, help="For your own network: the corridor's edges, in order."
)


@click.group()
def command() -> None:
    """Road networks."""


@command.command()
@click.argument("network", default="i80")
@EDGES
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def check(network: str, edges: tuple[str, ...], as_json: bool) -> None:
    """Check a network: length, lanes, smoothness, connections, whether SUMO can use it.

    For built-in roads the distance to surveyed lines, too.
    """
    report = check_net(network, list(edges) or None)
    road = load_corridor(network, list(edges) or None)
    check_in_sumo(road.net_path, road.edges)
    click.echo(json.dumps(report.to_dict(), indent=2) if as_json else str(report))
    if not report.passed:
        sys.exit(2)


@command.command()
@click.argument("network", default="i80")
@click.argument("png", type=click.Path(dir_okay=False, path_type=Path))
@EDGES
def plot(network: str, png: Path, edges: tuple[str, ...]) -> None:
    """Draw a network to a PNG file."""
    click.echo(plot_net(network, png, list(edges) or None))


@command.command()
@click.argument("network", default="i80")
@click.option("--geometry", type=click.Path(exists=True, file_okay=False, path_type=Path),
              help="Folder with the raw geometry: write the plain XML sources anew first.")  # fmt: skip
@click.option("--netconvert", help="SUMO's netconvert.  [default: $NETCONVERT, or on the PATH]")
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the network here instead."
)
def build(network: str, geometry: Path | None, netconvert: str | None, out: Path | None) -> None:
    """Build a network from its plain XML sources with SUMO's netconvert."""
    if geometry is not None:
        for path in write_sources(network, geometry):
            click.echo(path)
    click.echo(build_net(network, netconvert, out))


@command.command("import")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="The .net.xml.")
@click.option("--netconvert", help="SUMO's netconvert.  [default: $NETCONVERT, or on the PATH]")
def import_(file: Path, out: Path, netconvert: str | None) -> None:
    """Make a SUMO network of an ASAM OpenDRIVE file with SUMO's netconvert, and say what is lost.

    Then name its edges in a scenario, and check them: `tailroad nets check OUT --edge A --edge B`.
    """
    try:
        made = import_opendrive(file, out, netconvert)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error})") from error
    for name, lanes, length in made.edges:
        click.echo(f"edge {name}: {lanes} lanes, {length:.1f} m")
    for line in made.lost:
        click.echo(f"lost: {line}")
    click.echo(out)
