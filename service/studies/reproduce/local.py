"""Carries out a plan on local workers, from wherever it stands: what is finished is read, what was begun goes on."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import ce
from service.analysis.run import Progress
from service.analysis.run import carry_out as carry_out_jobs
from service.evaluation.batches import RecordedBatches
from service.evaluation.job import Job, Problem, compiled, in_sumo, make_job
from service.evaluation.pool import OpenWorld
from service.evaluation.recorded import LazyPool
from service.evaluation.store import Chunk
from service.studies.reproduce import results
from service.studies.reproduce.plans import Plan, Run, Truth
from service.studies.reproduce.results import Result, result_of
from service.studies.reproduce.truth import GroundTruth, KnownTruth, truth_job
from service.world.scenario import load_scenario
from service.world.scenario.noise_mode import with_noise_mode
from service.world.sim.without_sumo import can_leave_out_sumo

NEVER_GIVE_UP = 1.0  # share of failed rollouts
RESULT = "reproduced.json"  # in a run's directory, once it is finished


@dataclass(frozen=True)
class Watch:
    """Who is told how far it is: on_part(what begins, its rollouts at most), on_rollouts(how many more)."""

    on_part: Callable[[str, int], None] = lambda what, rollouts: None
    on_rollouts: Callable[[int], None] = lambda count: None


@dataclass(frozen=True)
class Outcome:
    """What a plan came to: its ground truth and the results of its runs, in their order."""

    plan: Plan
    truth: KnownTruth
    results: tuple[Result, ...]
    sumo: bool  # all of it in SUMO, or without and one rollout in a hundred in both


def truth_path(truth: Truth, folder: Path) -> Path:
    return folder / f"{Path(truth.scenario).stem}-{truth.ego.replace(':', '-')}.npz"


def run_as_job(run: Run) -> Job:
    scenario = with_noise_mode(load_scenario(run.scenario), run.noise_mode)
    return make_job(scenario, run.ego, run.gamma, run.method, run.seed, run.options)


def carry_out(plan: Plan, out: Path, truths: Path, workers: int, sumo: bool, watch: Watch) -> Outcome:
    """Run what is missing of the plan.

    out: holds the run directories
    truths: the ground truths
    """
    sumo = sumo or not can_leave_out_sumo(load_scenario(plan.truth.scenario), plan.truth.ego)
    open_world = in_sumo if sumo else compiled
    truth = accumulate(plan.truth, truth_path(plan.truth, truths), workers, open_world, watch)
    found = tuple(finish_run(run, plan.gammas, out, workers, sumo, watch) for run in plan.runs)
    return Outcome(plan, truth, found, sumo)


def accumulate(wanted: Truth, path: Path, workers: int, open_world: OpenWorld, watch: Watch) -> GroundTruth:
    """The ground truth with at least so many rollouts; those that there are already are not run again."""
    job = truth_job(wanted)
    truth = GroundTruth(path, job)
    watch.on_part(f"ground truth, {wanted.ego} in {wanted.scenario}", wanted.rollouts)
    watch.on_rollouts(min(truth.rollouts, wanted.rollouts))
    problem = Problem(job)
    algorithm = problem.algorithm
    assert isinstance(algorithm, ce.Naive)
    state = truth.state(algorithm, problem.stream_seed)
    with truth, LazyPool(job, workers, open_world) as pool:

        def on_chunk(chunk: Chunk, replayed: bool) -> None:
            watch.on_rollouts(chunk.stop - chunk.start)

        run_batch = RecordedBatches(truth, job, pool, on_chunk)
        while (batch := algorithm.propose(state)) is not None:
            state, _ = algorithm.update(state, batch, run_batch(batch))
    return truth


def finish_run(
    run: Run, gammas: tuple[float, ...], out: Path, workers: int, sumo: bool, watch: Watch
) -> Result:
    """One run of the plan, or its result where it is finished."""
    folder = out / run.folder
    job = run_as_job(run)
    watch.on_part(f"{run.series}, seed {run.seed}", run.budget)
    done = results.load(folder / RESULT)
    if done is not None and tuple(r.gamma for r in done.readings) == gammas:
        watch.on_rollouts(run.budget)
        return done
    run_so_far = 0

    def on_progress(progress: Progress) -> None:
        nonlocal run_so_far
        run_so_far = progress.rollouts
        watch.on_rollouts(progress.more)

    world = in_sumo if sumo else compiled
    finished = carry_out_jobs(folder, [job], workers, on_progress, NEVER_GIVE_UP, world)
    watch.on_rollouts(run.budget - run_so_far)  # where the method needed fewer
    cost = finished.costs[job.id]
    spent = {"worker_s": cost.worker_s, "sim_s": cost.sim_s, "wall_s": cost.wall_s}
    result = result_of(run, finished.results[job.id], gammas, spent, job.tailroad)
    results.save(folder / RESULT, result)
    return result
