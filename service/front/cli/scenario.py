"""`tailroad scenario list|show|check|measure`"""

import json
from pathlib import Path

import click
import msgspec
from rich.console import Console
from rich.table import Table

from policies.drivers import load_drivers
from service.world.safety.measure import open_monitor
from service.world.scenario.base import STARTS, base_distribution
from service.world.scenario.check import check_road
from service.world.scenario.load import FOLDER, built_in_names, load_scenario
from service.world.scenario.renamed import to_written
from service.world.sim.sumo_check import check_in_sumo


@click.group()
def command() -> None:
    """Scenarios: which road, which vehicles, which distribution, which measure."""


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_(as_json: bool) -> None:
    """The scenarios that come with tailroad."""
    scenarios = [load_scenario(name) for name in built_in_names()]
    if as_json:
        click.echo(json.dumps([{"name": s.name, "description": s.description} for s in scenarios], indent=2))
        return
    table = Table("scenario", "vehicles", "horizon", "description")
    for s in scenarios:
        table.add_row(s.name, str(len(s.vehicles)), f"{s.time.horizon_s:g} s", s.description)
    Console().print(table)


@command.command()
@click.argument("scenario")
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, with every default filled in.")
def show(scenario: str, as_json: bool) -> None:
    """Print a scenario's file."""
    loaded = load_scenario(scenario)
    if as_json:
        click.echo(
            msgspec.json.format(
                msgspec.json.encode(to_written(msgspec.to_builtins(loaded))), indent=2
            ).decode()
        )
        return
    path = FOLDER / f"{scenario}.toml" if scenario in built_in_names() else Path(scenario)
    click.echo(path.read_text(encoding="utf-8"), nl=False)


@command.command()
@click.argument("scenarios", nargs=-1, required=True)
def check(scenarios: tuple[str, ...]) -> None:
    """Check scenarios: the file, its values, the road (SUMO loads it), the drivers' weights.

    Exit code 2 names what is wrong.
    """
    for name in scenarios:
        scenario = load_scenario(name)
        road = check_road(scenario, name)
        check_in_sumo(road.net_path, road.edges)
        base = base_distribution(scenario, load_drivers(scenario.drivers.weights))
        open_monitor(scenario, len(scenario.vehicles))
        click.echo(
            f"{name}: good. {len(scenario.vehicles)} vehicles on {road.name}, {road.length_m:.0f} m, "
            f"{road.lane_left.shape[0]} lanes; at most {scenario.steps} steps of {scenario.time.step_s:g} s; "
            f"X has {base.dim} dimensions ({STARTS} a vehicle and the driver weights)"
        )


@command.command()
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--measure", default="ttc-impact", show_default=True, help="One that needs no lanes.")
@click.option("--ego", help="The ego's name.  [default: the vehicle that is called ego]")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def measure(file: Path, measure: str, ego: str | None, as_json: bool) -> None:
    """f of an ASAM OpenSCENARIO XML file in which every vehicle follows a trajectory, tailroad's own or another's.

    Other actions are refused by their name; the drive ends with the ego's first contact.
    """
    from service.analysis.exports.openscenario_in import STEP_S, f_of, read_openscenario

    drive = read_openscenario(file, ego)
    f, values = f_of(drive, measure)
    worst = float(values.argmin() * STEP_S)
    if as_json:
        told = {"file": file.name, "measure": measure, "f": f, "at_s": worst, "vehicles": list(drive.names),
                "ego": drive.names[drive.ego], "states": len(values)}  # fmt: skip
        click.echo(json.dumps(told, indent=2))
        return
    click.echo(f"{file}: f = {f:.6g} by {measure}, at {worst:.1f} s of {(len(values) - 1) * STEP_S:.1f} s")
