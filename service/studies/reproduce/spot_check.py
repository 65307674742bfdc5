"""Runs a share of a ground truth's rollouts again, and can then give its file the digest of today's code and names.

    python -m service.studies.reproduce.spot_check deploy/results/truths/i80-paper-10s-lidar.npz --rollouts 1000

A digest changes with whatever may decide rollouts, code that was only rewritten included. Where the rollouts still come
to the same bits, `--accept` keeps them; `--scenario` and `--ego` say what they are called now.
"""

import math
from pathlib import Path

import click
import msgspec
import numpy as np
from rich.progress import track

from ce.streams import Stream
from service.evaluation.job import Job, Problem
from service.evaluation.pool import OUTCOME_CODES, OUTCOME_NAMES, RolloutWorld
from service.studies.reproduce.identity import digest_of
from service.studies.reproduce.plans import Truth
from service.studies.reproduce.truth import CUTOFF_S, Kept, read_truth, truth_job, write_truth
from service.world.sim.without_sumo import WithoutSumo, can_leave_out_sumo

CHOICE = 1  # seed of which rows are run again
MOST_SHOWN = 20  # of the rows that differ


def chosen_rows(kept: Kept, rollouts: int) -> np.ndarray:
    """Rows to run again, rising: a quarter most dangerous, a quarter others with f on record, half from the rest."""
    ran = np.concatenate([np.arange(first, last) for first, last in kept.ran.ranges])
    source = np.random.default_rng(CHOICE)
    lowest = kept.rows[np.argsort(kept.f, kind="stable")][: rollouts // 4]
    some = source.permutation(kept.rows)[: rollouts // 4]
    known = np.union1d(lowest, some)
    rest = source.permutation(np.setdiff1d(ran, kept.rows))[: rollouts - known.size]
    return np.union1d(known, rest)


def differing_rows(kept: Kept, job: Job, rows: np.ndarray, within: float) -> list[str]:
    """Which of the rows come to something else today, and to what.

    within: how far f may be off
    """
    problem = Problem(job)
    world: RolloutWorld
    if can_leave_out_sumo(job.scenario, job.ego):
        world = WithoutSumo(job.scenario, problem.corridor, problem.drivers, job.ego)
    else:
        world = problem.simulator()
    stream = Stream(problem.base, problem.stream_seed, "estimate", 0)
    on_record = dict(
        zip(kept.rows.tolist(), zip(kept.f.tolist(), kept.outcomes.tolist(), strict=True), strict=True)
    )
    wrong = []
    for row in track(rows.tolist(), description=f"{job.ego} in {job.scenario.name}"):
        (x,), (noise,) = stream.draw(row, row + 1)
        again = world.run(x, int(noise))
        if row not in on_record:
            if not again.f >= CUTOFF_S - within:
                wrong.append(f"row {row}: f = {again.f!r}, on record at least {CUTOFF_S:g}")
            continue
        f, code = on_record[row]
        same = abs(again.f - f) <= within or (math.isnan(again.f) and math.isnan(f))
        if not same or OUTCOME_CODES[again.outcome] != code:
            then = OUTCOME_NAMES[code]
            wrong.append(f"row {row}: f = {again.f!r} ({again.outcome}), on record {f!r} ({then})")
    return wrong


@click.command()
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False)
)
@click.option(
    "--rollouts", default=200, show_default=True, type=click.IntRange(1), help="Run again, of each file."
)
@click.option("--scenario", help="What the scenario is called now, where it was renamed.")
@click.option("--ego", help="What the ego is called now, where it was renamed.")
@click.option(
    "--within",
    default=0.0,
    show_default=True,
    help="How far f may be off: egos on ONNX Runtime have the last bits of their processor.",
)
@click.option("--accept", is_flag=True, help="Give the file today's digest and names where none differs.")
def main(
    files: tuple[Path, ...], rollouts: int, scenario: str | None, ego: str | None, within: float, accept: bool
) -> None:
    """Run rollouts of ground truths again and compare them bit for bit; exit code 1 where one differs."""
    for path in files:
        kept = read_truth(path)
        ran = msgspec.structs.replace(
            kept.ran, scenario=scenario or kept.ran.scenario, ego=ego or kept.ran.ego
        )
        job = truth_job(Truth(scenario=ran.scenario, ego=ran.ego, rollouts=1, seed=ran.seed))
        rows = chosen_rows(kept, rollouts)
        wrong = differing_rows(kept, job, rows, within)
        digest = digest_of(job)
        click.echo(
            f"{path.name}: {rows.size} rollouts run again, {len(wrong)} differ; digest {digest}, on record {ran.digest}"
        )
        if wrong:
            raise SystemExit("\n".join(wrong[:MOST_SHOWN]))
        if accept:
            write_truth(path, kept._replace(ran=msgspec.structs.replace(ran, digest=digest)))


if __name__ == "__main__":
    main()
