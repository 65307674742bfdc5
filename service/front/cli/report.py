"""`tailroad report`: of a run directory, or of a service's job."""

from pathlib import Path

import click

from service.evaluation.cores import core_count
from service.front.cli.options import workers_option, zenoh_config_option


@click.command()
@click.argument("run")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the report.  [default: RUN; of a service's "
              "job: report-RUN]")  # fmt: skip
@click.option("--baseline", help="What the risk is held against: events per million km, or police-reported, "
              "any-injury, any-crash or near-crash, each per vehicle.  [default: police-reported]")  # fmt: skip
@click.option("--baseline-source", help="Where a number given as --baseline is from.")
@click.option("--connect", multiple=True, help="RUN is a job of the service at this Zenoh endpoint, as in "
              "tcp/127.0.0.1:7447; once for each endpoint.")  # fmt: skip
@zenoh_config_option("With --connect: Zenoh configuration file, for TLS and passwords.")
@workers_option()
def command(
    run: str,
    out: Path | None,
    baseline: str | None,
    baseline_source: str | None,
    connect: tuple[str, ...],
    zenoh_config: str | None,
    workers: int | None,
) -> None:
    """Write the HTML report of RUN, a run directory (or a job, with --connect), and a JSON file beside it."""
    from service.analysis.risk import baseline_of

    against = baseline_of(baseline, baseline_source)
    if connect:
        page = _of_service(
            run, out or Path(f"report-{run}"), baseline, baseline_source, connect, zenoh_config
        )
    else:
        from service.analysis.report import write_report
        from service.evaluation.store import RunDirectory

        with RunDirectory.open(Path(run)) as store:
            page = write_report(store, out, baseline=against, workers=workers or core_count())
    click.echo(page)


def _of_service(
    job: str,
    folder: Path,
    baseline: str | None,
    source: str | None,
    connect: tuple[str, ...],
    zenoh_config: str | None,
) -> Path:
    import msgspec

    from service.errors import StoreError
    from service.remote.client import Client

    with Client(connect, zenoh_config) as client:
        html = client.report(job, baseline, source)
        facts = msgspec.json.encode(client.report_json(job, baseline, source))
    page = folder / "report.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        page.write_text(html, encoding="utf-8")
        (folder / "report.json").write_bytes(msgspec.json.format(facts, indent=1) + b"\n")
    except OSError as error:
        raise StoreError(
            f"cannot write to {folder}: {error.strerror or error}; give another folder with --out"
        ) from error
    return page
