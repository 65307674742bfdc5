"""`tailroad rollout`: one rollout, seen in every way."""

import json
import math
from pathlib import Path

import click
import msgspec

import ce
from service.analysis.trace import record, write_table
from service.errors import SimulationError
from service.evaluation.job import Problem, make_job
from service.front.cli.ego_options import ego_option
from service.front.cli.options import FOLDER, json_option, measure_option, require_folder, seed_option
from service.world import agents as A
from service.world.safety.measure import with_measure
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.fixed import fixed_draw, released
from service.world.scenario.measures import measure_kind, unit_at
from service.world.scenario.noise import Noise

FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("scenario", default="i80")
@ego_option()
@measure_option()
@seed_option()
@click.option(
    "--row",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Which of the seed's draws: that row of a naive run.",
)
@click.option("--video", type=FILE, help="Film: from above and from the ego's camera (.mp4).")
@click.option("--frames", type=FOLDER, help="The film's pictures, into a folder.")
@click.option("--trace", "table", type=FILE, help="Every vehicle at every step (.parquet).")
@click.option("--fcd", type=FILE, help="SUMO's floating-car data (.xml).")
@click.option(
    "--sumo-gui", is_flag=True, help="Show it in SUMO's own GUI, at real time, where one is installed."
)
@json_option()
def command(
    scenario: str,
    ego: str,
    measure: str | None,
    seed: int,
    row: int,
    video: Path | None,
    frames: Path | None,
    table: Path | None,
    fcd: Path | None,
    sumo_gui: bool,
    as_json: bool,
) -> None:
    """Run one rollout drawn from the base distribution of SCENARIO, or the one that its file holds ([fixed])."""
    for path, what in ((video, "--video"), (frames, "--frames"), (table, "--trace"), (fcd, "--fcd")):
        require_folder(path, what)
    loaded = load_scenario(scenario)
    if measure is not None:
        loaded = with_measure(loaded, measure)
    check_road(loaded, scenario)
    fixed = loaded.fixed
    if fixed is not None and fixed.ego is not None and not _given("ego"):
        ego = fixed.ego
    problem = Problem(make_job(released(loaded), ego, gamma=0.0, method="naive", seed=seed, options={}))
    if fixed is None:
        drawn, seeds = ce.draw(problem.base, seed, "estimate", 0, row, row + 1)
        x = drawn[0]
        noise_seed: Noise = int(seeds[0])
    else:
        x, noise_seed = fixed_draw(problem.base, fixed, problem.job.weights_sha256, scenario)
    with problem.simulator(fcd=fcd, gui=sumo_gui) as simulator:
        trace = record(problem, simulator, x, noise_seed)
    result = trace.rollout
    if result.error is not None:
        raise SimulationError(
            f"the rollout failed: {result.error} (scenario {scenario}, ego {ego}, seed {seed})"
        )
    if table is not None:
        write_table(trace, table)
    if video is not None or frames is not None:
        from service.analysis.video import EgoView, write_frames, write_video

        view = EgoView(problem.job.scenario, problem.corridor, x, int(noise_seed))
        title = f"{scenario}, ego {ego}, seed {seed}"
        if video is not None:
            write_video(trace, problem.corridor, video, title, view)
        if frames is not None:
            write_frames(trace, problem.corridor, frames, title, view)
    kind = measure_kind(loaded.safety.measure)
    contact = None
    if result.contact is not None:
        told = msgspec.to_builtins(result.contact)
        contact = told | {
            "other": trace.names[told["other"]] if told["other"] < len(trace.names) else "background"
        }
    summary = {
        "scenario": scenario,
        "ego": ego,
        "seed": seed,
        "row": row,
        "f": result.f if math.isfinite(result.f) else None,
        "measure": loaded.safety.measure,
        "unit": kind.unit,
        "outcome": result.outcome,
        "contact": contact,
        "steps": result.steps,
        "time_s": round(result.steps * problem.job.scenario.time.step_s, 3),
        "ego_mean_speed_mps": float(trace.agents[:, trace.ego, A.SPEED_MPS].mean()),
    }
    if fixed is not None and fixed.f is not None and ego == fixed.ego and measure is None:
        summary |= {"f_on_record": fixed.f, "same_to_the_bit": fixed.f == result.f}
    if as_json:
        click.echo(json.dumps(summary, indent=2))
        return
    click.echo(
        f"{scenario}, ego {ego}, seed {seed}: {result.outcome} after {summary['time_s']:g} s, "
        f"{kind.words} {f'{result.f:.3f} {unit_at(kind.unit, result.f)}'.rstrip()}, "
        f"mean speed {summary['ego_mean_speed_mps']:.1f} m/s"
    )
    if "same_to_the_bit" in summary:
        same = summary["same_to_the_bit"]
        click.echo(
            "The same f to the bit as on record." if same else f"On record: {summary['f_on_record']!r}."
        )
    for path in (video, frames, table, fcd):
        if path is not None:
            click.echo(path)


def _given(option: str) -> bool:
    """Whether the user gave the option, rather than its default."""
    source = click.get_current_context().get_parameter_source(option)
    return source is not None and source.name != "DEFAULT"
