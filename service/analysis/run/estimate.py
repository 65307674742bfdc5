"""`tailroad.estimate`: a question asked, run and answered in one call."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from service.analysis.run.carry_out import MAX_FAILED, carry_out, new_folder
from service.analysis.run.committors import committor_for
from service.analysis.run.progress import Tell, told
from service.analysis.run.question import BUDGET, CONFIDENCE, METHOD, SEED, jobs_of, scenario_of
from service.analysis.run.run import Run
from service.errors import InputError
from service.evaluation.cores import core_count
from service.evaluation.options import PATHS
from service.evaluation.pool import WORLDS, InSumo
from service.world.egos.here import ego_name
from service.world.scenario import Scenario
from service.world.scenario.noise_mode import NoiseMode


def estimate(
    scenario: str | Path | Scenario,
    ego: Any = "lidar",
    *,
    gamma: float | Sequence[float],
    method: str | Sequence[str] = METHOD,
    budget: int = BUDGET,
    rel_error: float | None = None,
    confidence: float = CONFIDENCE,
    seed: int | Sequence[int] = SEED,
    measure: str | None = None,
    noise_mode: NoiseMode | None = None,
    options: Mapping[str, Any] | None = None,
    committor: str | Path | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    in_sumo: InSumo = "some",
    executor: Executor | None = None,
    progress: Tell | bool = True,
    max_failed: float = MAX_FAILED,
    new: bool = False,
) -> Run:
    """Estimate p = P0(f(X) <= gamma): how probable the dangerous event is for this ego in this scenario.

    scenario: the name of one that comes with tailroad, a file, or a Scenario.
    ego: a name, a class, a function that makes one, or an ego itself; what no other process can import runs in forks of
        this one alone.
    gamma: threshold of the safety value f, in the measure's unit (s for the time to collision); several: a job each.
    method: auto, naive, ce, mixture, splitting or paths; several are compared.
    budget: rollouts of each job at most, training included.
    rel_error: stop where the interval's relative half-width is this small.
    confidence: of the interval.
    seed: the same seed gives the same bits.
    measure, noise_mode: in place of the scenario's safety measure and action noise.
    options: of the methods, as in {"rho": 0.1}.
    committor: what the method paths starts from in place of training one of its own: a run directory of it, or a file;
        "own" to train one although one comes with tailroad for that scenario and measure.
    out: run directory (default: runs/SCENARIO-EGO-TIME); one of the same question is gone on with, or with `new`
        refused.
    workers: processes (default: one for each core).
    in_sumo: "some": rollouts that can be one compiled call are, and SUMO drives the first 4 events of each chunk of
        rollouts, one in 10 of its others and one in 100 of what is no event, to the same bits; "all": all of them.
    executor: a concurrent.futures.Executor whose workers are processes, to run rollouts in place of local workers.
    progress: True: a bar on standard error where that is a terminal; False: nothing; a function: called with a Progress
        each time.
    max_failed: TooManyFailures where a larger share of the rollouts fails.

    Bad input raises InputError; Ctrl-C raises Interrupted, and `resume` goes on from there to the same bits.

    >>> import tailroad
    >>> run = tailroad.estimate("i80-paper-10s", ego="idm", gamma=2.0, method="naive", budget=40, out=folder, workers=1)
    >>> run.estimate.p, run.estimate.rollouts.total
    (0.6, 40)
    """
    name = ego_name(ego)
    asked = scenario_of(scenario, measure, noise_mode)
    given = committor_for(committor, asked)
    jobs = jobs_of(
        asked,
        name,
        gamma,
        method,
        budget=budget,
        rel_error=rel_error,
        confidence=confidence,
        seed=seed,
        options=options,
        committor_sha256="" if given is None else given[0].checksum,
        here=executor is None and in_sumo == "some",
    )
    if committor is not None and not any(job.method == PATHS for job in jobs):
        raise InputError(f"a committor is for the method {PATHS}; add it, or leave out the committor")
    path = Path(out) if out is not None else new_folder(jobs[0].scenario.name, name)
    count = workers or core_count()
    with told(progress, count) as tell:
        return carry_out(
            path, jobs, count, tell, max_failed, WORLDS[in_sumo], executor, new, given and given[1]
        )
