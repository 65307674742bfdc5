"""`tailroad drivers card|rates|fit-noise`"""

import json
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import click
from rich.progress import Progress, TaskID

from service.analysis.run.bars import progress_bar, stderr
from service.errors import InputError
from service.evaluation.cores import core_count
from service.front.cli.main import INTERRUPTED
from service.front.cli.options import (
    FOLDER,
    json_option,
    out_option,
    pages_option,
    seed_option,
    workers_option,
)


@click.group()
def command() -> None:
    """The human-driver model."""


@command.command()
@click.option("--weights", default="drivers-gail", show_default=True,
              help="Shipped weights, or the path of a .safetensors file.")  # fmt: skip
@click.option("--data", required=True, type=click.Path(path_type=Path),
              help="Folder of the data pack, or of tables that 'tailroad data import' wrote.")  # fmt: skip
@click.option("--out", default=Path("."), show_default=True, type=FOLDER,
              help="Folder for NAME-realism.html and NAME-realism.json.")  # fmt: skip
@click.option("--samples", type=click.IntRange(1, 100), default=2, show_default=True,
              help="Rollouts of each recorded window.")  # fmt: skip
@click.option("--krauss/--no-krauss", default=True, show_default=True,
              help="Also measure SUMO's own driver, which takes minutes.")  # fmt: skip
@click.option("--human", default="i80", show_default=True,
              help="Scenario with a human table, which stands around the weights as one more model.")  # fmt: skip
@seed_option()
@json_option()
def card(
    weights: str, data: Path, out: Path, samples: int, krauss: bool, human: str, seed: int, as_json: bool
) -> None:
    """Measure how like people the drivers drive, beside other models, and write the realism card."""
    from policies.data.scenes import DataError
    from service.studies.realism import card as making

    settings = making.Settings(weights, data, seed, samples, krauss, human)
    try:
        with stderr.status("reading recordings") if stderr.is_terminal else nullcontext() as status:
            facts = making.make(settings, lambda text: status.update(text) if status is not None else None)
    except DataError as error:
        raise InputError(str(error)) from error
    try:
        written = making.write(facts, out)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error})") from error
    if as_json:
        click.echo(json.dumps(facts, indent=1))
        return
    for row in facts["targets"]["rows"]:
        reached = row["reached"]["twenty"]
        click.echo(
            f"{row['label']}: {reached['value']:g} (target {row['target']:g}): "
            f"{'met' if reached['met'] else 'not met'}"
        )
    for path in written:
        click.echo(path)


@command.command()
@click.argument("scenarios", nargs=-1)
@click.option("--rollouts", type=click.IntRange(1), default=10_000, show_default=True,
              help="Of each scenario, rounded up to 250.")  # fmt: skip
@click.option("--ego", type=click.Choice(["idm", "lidar"]), default="idm", show_default=True,
              help="Drives the one vehicle that is not counted.")  # fmt: skip
@click.option("--epsilon", type=float, help="In place of the scenario's: the probability that a glance begins in a "
              "conflict.")  # fmt: skip
@click.option("--leaks", type=click.Choice(["forced", "drawn"]), default="forced", show_default=True,
              help="forced: at every glance that a conflict suppresses, also drive on as if it had not; rare contacts "
              "come sooner, for every epsilon at once. drawn: as it happens.")  # fmt: skip
@out_option("runs/driver-rates", "Keeps the counts")
@pages_option("OUT")
@workers_option()
@seed_option()
@json_option()
def rates(
    scenarios: tuple[str, ...], rollouts: int, ego: str, epsilon: float | None, leaks: str, out: Path,
    pages: Path | None, workers: int | None, seed: int, as_json: bool,
) -> None:  # fmt: skip
    """Count contacts and near-crashes of the drivers under P0, beside what people do, and write the page.

    SCENARIOS: built-in names or files; default: i80 and i80-10s. Interrupted, the same command goes on.
    """
    from service.studies.human import campaign
    from service.studies.human import rates as making
    from service.world.scenario.human import with_epsilon
    from service.world.scenario.load import load_scenario

    names = scenarios or ("i80", "i80-10s")
    wanted = [with_epsilon(load_scenario(name), epsilon, name) for name in names]
    asked = [
        campaign.Settings(one, ego, seed, forced=leaks == "forced" and one.human is not None)
        for one in wanted
    ]
    told = []
    try:
        with progress_bar() as bar:
            for settings in asked:
                task = bar.add_task(f"{settings.scenario.name}, chunks", total=None, note="")
                counts = campaign.run(
                    settings,
                    rollouts,
                    out / settings.scenario.name,
                    workers or core_count(),
                    partial(_show, bar, task),
                )
                told.append(making.facts(settings, counts))
    except KeyboardInterrupt:
        click.echo(f"interrupted; the same command goes on from {out}", err=True)
        raise SystemExit(INTERRUPTED) from None
    chosen = "" if epsilon is None else f" --epsilon {epsilon:g}"
    chosen += "" if leaks == "forced" else f" --leaks {leaks}"
    said = f"tailroad drivers rates {' '.join(names)} --rollouts {rollouts} --ego {ego}{chosen} --seed {seed}"
    try:
        path = making.write(told, pages or out, said)
    except OSError as error:
        raise InputError(f"{pages or out}: cannot be written ({error})") from error
    if as_json:
        click.echo(path.with_suffix("").joinpath("results.json").read_text(encoding="utf-8"))
        return
    for one in told:
        found = one["parts"]["together"]
        for name in ("contacts", "involvements", "near_crashes"):
            rate = found[name]
            click.echo(
                f"{one['scenario']}: {name.replace('_', '-')} {rate.rate:.3g} per million vehicle-km "
                f"({rate.low:.3g} to {rate.high:.3g})"
            )
    click.echo(path)


def _show(bar: Progress, task: TaskID, done: int, wanted: int) -> None:
    bar.update(task, completed=done, total=wanted)


@command.command("fit-noise")
@click.option("--data", required=True, type=FOLDER,
              help="Folder of the data pack.")  # fmt: skip
@click.option("--scenario", default="i80-data", show_default=True, help="Whose starts are as recorded.")
@click.option(
    "--rollouts", type=click.IntRange(2), default=60, show_default=True, help="At each amplitude tried."
)
@seed_option()
@json_option()
def fit_noise(data: Path, scenario: str, rollouts: int, seed: int, as_json: bool) -> None:
    """Fit the drivers' action noise to recordings; prints the [human.noise] table of a scenario."""
    import msgspec

    from policies.data.scenes import DataError
    from service.studies.human import noise_fit
    from service.world.scenario.load import load_scenario

    try:
        target = noise_fit.recorded(data)
    except DataError as error:
        raise InputError(str(error)) from error
    with stderr.status("driving") if stderr.is_terminal else nullcontext():
        noise, found = noise_fit.fitted(load_scenario(scenario), target, rollouts, seed)
    if as_json:
        told = {"noise": noise, "recorded": target.__dict__, "driven": found.__dict__}
        click.echo(json.dumps(msgspec.to_builtins(told), indent=1))
        return
    click.echo("[human.noise]")
    for key in noise.__struct_fields__:
        click.echo(f"{key} = {getattr(noise, key):g}")
    for name in noise_fit.Movement.__dataclass_fields__:
        click.echo(f"# {name}: recorded {getattr(target, name):.3g}, driven {getattr(found, name):.3g}")
