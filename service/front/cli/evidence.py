"""`tailroad evidence RUN... --out FOLDER`: a folder of evidence that stands alone."""

from pathlib import Path

import click

from service.analysis.prevention.prevent import DEFAULT
from service.evaluation.cores import core_count
from service.front.cli.options import workers_option


@click.command()
@click.argument(
    "runs", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path)
)
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder to write; it must not exist."
)
@click.option("--key", "key_file", type=click.Path(dir_okay=False, path_type=Path), required=True,
              help="Your secret key (Ed25519, PKCS #8); made where there is none.")  # fmt: skip
@click.option("--case", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="An acceptance case (`tailroad accept`) whose verdicts are claimed, too.")  # fmt: skip
@click.option("--reference", "references", multiple=True, default=DEFAULT, show_default=True,
              help="Reference drivers, as of `tailroad prevent`.")  # fmt: skip
@click.option("--films", type=click.IntRange(0, 100), default=2, show_default=True,
              help="Films of the most dangerous rollouts of each job.")  # fmt: skip
@workers_option()
def command(
    runs: tuple[Path, ...],
    out: Path,
    key_file: Path,
    case: Path | None,
    references: tuple[str, ...],
    films: int,
    workers: int | None,
) -> None:
    """Claims on RUNS with what supports them: a goal structure, estimates, records, weights, films, all signed.

    `tailroad verify FOLDER` checks every file and runs a sample of the rollouts again, bit for bit.
    """
    from service.analysis.evidence.gather import gather
    from service.analysis.evidence.material import Wanted
    from service.analysis.evidence.signature import public_key, secret_key

    key, new = secret_key(key_file)
    if new:
        click.echo(f"made a new key: {key_file}; keep it secret", err=True)
    claims = gather(runs, out, key, Wanted(references, films, workers or core_count()), case)
    count = sum(len(group.claims) for group in claims.groups)
    click.echo(f"{out}: {count} claims on {len(claims.groups)} goals, signed with key {public_key(key).name}")
