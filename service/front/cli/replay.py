"""`tailroad replay RUN RANK`: a dangerous rollout once more, in every form that it can be looked at."""

from pathlib import Path

import click

from service.analysis.exports import write_exports
from service.analysis.exports.opendrive import MISSING, netconvert
from service.analysis.failures.events import ORDERS, Order, events_of
from service.analysis.failures.objects import Failure
from service.analysis.failures.tell import failure_of
from service.analysis.run.records import record_of
from service.analysis.wording import quantity
from service.errors import InputError
from service.front.cli.options import echo_json, json_option, require_folder
from service.front.cli.runs import method_option, outcome_option, run_argument
from service.world.scenario.measures import measure_kind, unit_at

FILE = click.Path(dir_okay=False, path_type=Path)
# forms that a rollout is written in, and the option of each
OPTIONS = {
    "mp4": "--video",
    "fcd": "--fcd",
    "table": "--trace",
    "scenario": "--scenario",
    "mcap": "--recording",
    "openscenario": "--openscenario",
}


@click.command()
@run_argument()
@click.argument("rank", type=click.IntRange(1))
@method_option()
@outcome_option()
@click.option("--by", "order", type=click.Choice(ORDERS), default="likelihood", show_default=True,
              help="The order that RANK counts in, as of `tailroad failures`.")  # fmt: skip
@click.option("--video", "mp4", type=FILE, help="Film: from above and from the ego's camera (.mp4).")
@click.option("--fcd", type=FILE, help="SUMO's floating-car data (.xml).")
@click.option("--trace", "table", type=FILE, help="Every vehicle at every step (.parquet).")
@click.option("--scenario", type=FILE, help="A scenario file that holds this one rollout (.toml): "
              "`tailroad rollout FILE` runs it to the same bit.")  # fmt: skip
@click.option(
    "--recording", "mcap", type=FILE, help="A recording (.mcap) for Foxglove and other viewers of robot logs."
)
@click.option("--openscenario", type=FILE, help="ASAM OpenSCENARIO XML 1.3 (.xosc), each vehicle on its trajectory, "
              "for esmini and other players; the road beside it (.xodr) where netconvert is installed.")  # fmt: skip
@json_option()
def command(
    run: Path,
    rank: int,
    method: str | None,
    outcome: str | None,
    order: Order,
    as_json: bool,
    **asked: Path | None,
) -> None:
    """Run the dangerous rollout of RUN at RANK of `tailroad failures` again, and export it."""
    files = {form: path for form in OPTIONS if (path := asked[form]) is not None}
    for form, path in files.items():
        require_folder(path, OPTIONS[form])
    record, _ = record_of(run, method, None, outcome)
    events = events_of(record)
    if not len(events):
        raise InputError(f"{run} has no dangerous rollout by {record.job.method}: there is none to replay")
    if rank > len(events):
        raise InputError(f"rank {rank}: {run} has {len(events)} dangerous rollouts by {record.job.method}")
    position = int(events.ranking(order)[rank - 1])
    ((x, noise_seed),) = events.drawn([position])
    title = f"{run.name}, rank {rank} by {order}" + (f" of those with {outcome}" if outcome else "")
    if openscenario := files.get("openscenario"):
        if netconvert() is None:
            click.echo(f"{openscenario}: {MISSING}", err=True)
        else:
            files["road"] = openscenario.with_suffix(".xodr")
    again = write_exports(record.problem, x, noise_seed, title, files)
    failure = failure_of(events, position, again, rank)
    if as_json:
        echo_json(failure)
        return
    unit = unit_at(measure_kind(record.job.scenario.safety.measure).unit, again.f)
    same = "the same to the bit as on record" if failure.same_to_the_bit else f"on record {failure.f!r}"
    click.echo(
        f"{title}: {failure.mode}\nf = {quantity(again.f, unit)} ({same}), ended with {again.outcome}; "
        f"to {failure.other or 'background traffic'}"
        + (f" {failure.motion.time_s:.1f} s after the start" if failure.motion else "")
        + (f"\n{failure.story}" if failure.story else "")
        + _contact(failure)
    )
    for path in files.values():
        click.echo(path)


def _contact(failure: Failure) -> str:
    """The ego's contact in words, on a line of its own."""
    touched = failure.contact
    if touched is None:
        return ""
    who = "the ego runs into it" if touched.striking == "ego" else "it runs into the ego"
    return (
        f"\ncontact at {touched.speed_mps:.1f} m/s: {who}, the ego's {touched.ego_side} ({touched.ego_part}) and its "
        f"{touched.other_side} ({touched.other_part})"
    )
