"""`tailroad data import|schema|fit-starts|motorway`"""

import json
import re
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from service.analysis.run.bars import stderr
from service.errors import InputError
from service.front.cli.options import FOLDER


@click.group()
def command() -> None:
    """Recorded traffic: import it, and fit scenarios to it."""


@command.command("import")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=FOLDER,
              help="Folder for one Parquet file and one JSON report a recording file.")  # fmt: skip
@click.option("--units", type=click.Choice(["auto", "feet", "metres"]), default="auto", show_default=True,
              help="Of text and CSV files; auto: told by the cars' lengths.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print the reports as JSON.")
def import_(files: tuple[Path, ...], out: Path, units: str, as_json: bool) -> None:
    """Import recordings (NGSIM, DLR Highway Traffic, highD, exiD, I-24 MOTION) into one schema, in metres and seconds.

    Rows that cannot be physical are flagged, never dropped; `tailroad data schema` explains columns and flags.
    """
    from policies.data.ngsim_import import import_file
    from policies.data.scenes import DataError

    names = [path.stem for path in files]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"two files are named {', '.join(twice)}; their tables would be too: import them apart"
        )
    reports = []
    for path in files:
        try:
            with stderr.status(f"reading {path.name}") if stderr.is_terminal else nullcontext():
                report = import_file(path, out, units)
        except DataError as error:
            raise InputError(str(error)) from error
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error})") from error
        reports.append(report)
        if not as_json:
            _print(report, out / f"{path.stem}.parquet")
    if as_json:
        click.echo(json.dumps(reports, indent=2))


@command.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def schema(as_json: bool) -> None:
    """The columns, flags and layouts of imported recordings."""
    from policies.data import ngsim_schema

    if as_json:
        described = {
            "columns": {name: str(kind) for name, kind in ngsim_schema.SCHEMA.items()},
            "flags": {name: {"bit": bit, "meaning": m} for name, (bit, m) in ngsim_schema.FLAGS.items()},
            "layouts": ngsim_schema.LAYOUTS,
        }
        click.echo(json.dumps(described, indent=2))
        return
    click.echo((ngsim_schema.__doc__ or "").strip())
    click.echo("\nFlags:")
    for name, (bit, meaning) in ngsim_schema.FLAGS.items():
        click.echo(f"  {bit:5d}  {name:16s} {meaning}")
    click.echo("\nLayouts:")
    for name, meaning in ngsim_schema.LAYOUTS.items():
        click.echo(f"  {name:12s} {meaning}")


@command.command("fit-starts")
@click.option("--data", required=True, type=FOLDER,
              help="Folder of the data pack, or of imported tables (their first road).")  # fmt: skip
@click.option("--out", required=True, type=FOLDER,
              help="Folder for the pictures and i80-data.json.")  # fmt: skip
@click.option(
    "--resamples", type=click.IntRange(20), default=400, show_default=True, help="Of the bootstrap."
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Print the fits as JSON.")
def fit_starts(data: Path, out: Path, resamples: int, seed: int, as_json: bool) -> None:
    """Fit the starts of scenario i80-data to recordings; prints the scenario's TOML and how well each marginal fits.

    From the data pack also the speeds across the lane, jointly with offset and speed, of I-80 and of US-101.
    """
    from policies.data import lateral_fit, start_fit, start_fit_report
    from policies.data.scenes import DataError
    from policies.data.tables import is_table

    try:
        found = start_fit.samples(data)
        fits = {
            name: start_fit.fit_beta(found[name], bounds, resamples, seed)
            for name, bounds in start_fit.BOUNDS.items()
        }
        ignored = start_fit.dependence(data)
        sites = () if is_table(data) else lateral_fit.sites(data)
        lateral = {site: lateral_fit.fit(lateral_fit.sample(data, site), resamples, seed) for site in sites}
    except DataError as error:
        raise InputError(str(error)) from error
    report = {
        "command": f"tailroad data fit-starts --data DIR --out DIR --resamples {resamples} --seed {seed}",
        "training_vehicles_below": start_fit.TRAIN_BELOW,
        "fits": {name: start_fit_report.as_dict(fit) for name, fit in fits.items()},
        "rank_correlations_ignored": ignored,
        "lateral": {site: asdict(found) for site, found in lateral.items()},
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, fit in fits.items():
            picture = f"i80-data-{name.replace('_', '-')}.png"
            start_fit_report.draw(name, fit, out / picture)
        (out / "i80-data.json").write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error})") from error
    if as_json:
        click.echo(json.dumps(report, indent=2))
        return
    click.echo(start_fit_report.toml(fits))
    for site, one in lateral.items():
        rows = f"{one.rows:,} rows of {one.vehicles} vehicles"
        click.echo(f"\n# speeds across the lane, {site}: {rows}, KS distance {one.ks:.3f}")
        for what, low, high, count, recorded, told in one.bands:
            spread = f"standard deviation {recorded:.3f}, fitted {told:.3f} m/s"
            click.echo(f"#   {what} {low:g} to {high:g}: {spread} ({count} rows)")
        click.echo(lateral_fit.lateral_toml(one))
    table = Table("marginal", "rows", "vehicles", "outside", "KS distance", "alpha (95%)", "beta (95%)")
    for name, fit in fits.items():
        alpha, beta = (
            f"{value:.2f} ({low:.2f} to {high:.2f})"
            for value, (low, high) in ((fit.alpha, fit.alpha_interval), (fit.beta, fit.beta_interval))
        )
        outside = f"{100.0 * fit.outside:.1f}%"
        table.add_row(name, f"{len(fit.x):,}", str(fit.vehicles), outside, f"{fit.ks:.3f}", alpha, beta)
    stderr.print(table)
    stderr.print(f"pictures and i80-data.json: {out}")


@command.command()
@click.argument("tables", type=FOLDER)
@click.option("--name", default="motorway", show_default=True, help="Of the scenario and its road.")
@click.option("--site", help="Which carriageway.  [default: the one with the most rows]")
@click.option("--weights", help="The drivers' weights, by name or path.  [default: those of i80-10s]")
@click.option("--out", required=True, type=FOLDER, help="Folder for NAME.net.xml and NAME.toml.")
def motorway(tables: Path, name: str, site: str | None, weights: str | None, out: Path) -> None:
    """Make the road and a scenario in free flow from an imported recording that knows its road (DLR's, exiD).

    TABLES: the folder that 'tailroad data import' wrote. Needs SUMO's netconvert.
    """
    from service.studies.motorway import make_motorway

    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9-]*", name):
        raise InputError(f"--name {name!r}: letters, digits and hyphens, such as a39")
    try:
        out.mkdir(parents=True, exist_ok=True)
        made = make_motorway(tables, name, out, site, weights)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error})") from error
    stderr.print(f"carriageway {made.site}")
    for path in (made.network, made.scenario):
        click.echo(path)


def _print(report: dict[str, Any], path: Path) -> None:
    table = Table(
        title=f"{report['file']}: {report['source']}, in {report['units_found']}", show_header=False
    )
    table.add_row("rows", f"{report['rows']:,} ({report['rows_without_flag']:,} without a flag)")
    table.add_row("vehicles, frames", f"{report['vehicles']:,}, {report['frames']:,}")
    for note in report["notes"]:
        table.add_row("note", note)
    table.add_row("recordings, time", f"{len(report['recordings'])}, {report['span_s']:,.1f} s")
    table.add_row("rows by lane", ", ".join(f"{lane}: {n:,}" for lane, n in report["rows_by_lane"].items()))
    speeds = {k: v for k, v in report["speed_percentiles_mps"].items() if v is not None}
    table.add_row("speed percentiles, m/s", ", ".join(f"{k}%: {v:.1f}" for k, v in speeds.items()))
    for name, n in report["flagged_rows"].items():
        if n:
            table.add_row(f"flagged {name}", f"{n:,}")
    table.add_row("not in this source", ", ".join(report["columns_without_values"]) or "nothing")
    table.add_row("written", str(path))
    Console().print(table)
