"""`tailroad bench`: rollouts a second, x real time, and where the time goes."""

import json
import platform

import click
from rich.console import Console
from rich.table import Table

from policies.egos import ego_digest, ego_names
from service.analysis.run.bars import stderr
from service.evaluation.cores import core_count
from service.front.cli.options import json_option
from service.studies import bench
from service.world.scenario import load_scenario


@click.command()
@click.argument("scenario", default="i80-10s")
@click.option(
    "--ego",
    "egos",
    multiple=True,
    type=click.Choice(ego_names()),
    help="Once for each.  [default: all, of egos with the same weights the first]",
)
@click.option(
    "--rollouts", type=click.IntRange(1), default=100, show_default=True, help="A round of a measurement."
)
@click.option("--memory-rollouts", type=click.IntRange(200), default=1000, show_default=True,
              help="Rollouts over which a worker's memory is watched.")  # fmt: skip
@json_option()
def command(scenario: str, egos: tuple[str, ...], rollouts: int, memory_rollouts: int, as_json: bool) -> None:
    """Measure the world's speed on this machine, beside the bare libsumo loop of the same vehicles and steps."""
    loaded = load_scenario(scenario)
    cores = core_count()
    result: dict = {"scenario": loaded.name, "cores": cores, "processor": platform.processor() or platform.machine(),
                    "egos": {}}  # fmt: skip
    for ego in egos or distinct_egos():
        stderr.print(f"measuring {ego} ...")
        measured = bench.speed(loaded, ego, rollouts)
        result["egos"][ego] = measured | {"parts_us_per_step": bench.parts(loaded, ego, measured)}
    first = next(iter(result["egos"]))
    stderr.print("measuring processes ...")
    result["scaling"] = bench.scaling(loaded, first, 4 * rollouts, [1, *({2, cores} - {1})])
    stderr.print("measuring memory ...")
    result["memory"] = bench.memory(loaded, first, memory_rollouts)
    if as_json:
        click.echo(json.dumps(result, indent=2))
    else:
        _print(result)


def distinct_egos() -> list[str]:
    """The built-in egos, of those that drive by the same weights the first alone."""
    by_weights: dict[str, str] = {}
    for name in ego_names():
        by_weights.setdefault(ego_digest(name) or name, name)
    return list(by_weights.values())


def _print(result: dict) -> None:
    console = Console()
    speeds = Table("ego", "rollouts/s", "x real time", "of processor time", "us a step", "bare SUMO loop", "ratio",
                   title=f"{result['scenario']}, one core")  # fmt: skip
    for ego, m in result["egos"].items():
        speeds.add_row(
            ego,
            f"{m['rollouts_per_s']:.0f}",
            f"{m['x_realtime']:.0f} (best {m['x_realtime_best']:.0f})",
            f"{m['x_realtime_of_processor']:.0f}",
            f"{m['us_per_step']:.1f}",
            f"{m['bare_us_per_step']:.1f} us",
            f"{m['ratio_to_bare']:.2f}",
        )
    console.print(speeds)
    ways = Table("ego", "rollouts", "processor, us a step", "wall, us a step", "processor, ms a rollout",
                 "driven by SUMO", title="each way of running them")  # fmt: skip
    for ego, m in result["egos"].items():
        for way, of in m["ways"].items():
            ways.add_row(
                ego,
                "in SUMO" if way == "sumo" else "as one compiled call",
                f"{of['processor_us_per_step']:.1f}",
                f"{of['wall_us_per_step']:.1f}",
                f"{of['processor_ms_per_rollout']:.2f}",
                f"{of['share_in_sumo']:.1%}",
            )
    console.print(ways)
    parts = Table("us a step", *result["egos"])
    for part in next(iter(result["egos"].values()))["parts_us_per_step"]:
        parts.add_row(part, *[f"{m['parts_us_per_step'][part]:.1f}" for m in result["egos"].values()])
    console.print(parts)
    scaling = Table("workers", "rollouts/s", "efficiency")
    for row in result["scaling"]:
        scaling.add_row(str(row["workers"]), f"{row['rollouts_per_s']:.0f}", f"{row['efficiency']:.2f}")
    console.print(scaling)
    m = result["memory"]
    console.print(
        f"memory of a worker: {m['after_200_mb']:.0f} MB after 200 rollouts, "
        f"{m['after_all_mb']:.0f} MB after {m['rollouts']:.0f}"
    )
