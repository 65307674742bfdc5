"""One rollout once more, written in every form asked for."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from service.analysis.exports.opendrive import write_opendrive
from service.analysis.exports.openscenario import write_openscenario
from service.analysis.failures.recording import write_recording
from service.analysis.failures.rerun import Rerun, rerun
from service.analysis.failures.scenario_file import scenario_text
from service.analysis.trace import write_table
from service.errors import SimulationError
from service.evaluation.job import Problem
from service.world.scenario.noise import Noise


@dataclass(frozen=True)
class Exports:
    """Files to write.

    scenario: a scenario file that holds the rollout
    fcd: SUMO's floating-car data
    mp4: a film
    mcap: a recording for viewers of robot logs
    table: every vehicle at every step, as Parquet
    openscenario: ASAM OpenSCENARIO XML 1.3, the vehicles on their trajectories
    road: ASAM OpenDRIVE, which the OpenSCENARIO file then names; in the same folder
    """

    scenario: Path | None = None
    fcd: Path | None = None
    mp4: Path | None = None
    mcap: Path | None = None
    table: Path | None = None
    openscenario: Path | None = None
    road: Path | None = None


def write_exports(
    problem: Problem, x: np.ndarray, noise_seed: Noise, title: str, files: Exports, camera: bool = True
) -> Rerun:
    """Run the rollout of x (d,) and its noise seed again and write the files; what it came to.

    camera: whether the film shows the ego's camera beside the road from above

    SUMO allows one simulation a process. Raises SimulationError where the rollout fails.
    """
    with problem.simulator(fcd=files.fcd) as simulator:
        again = rerun(problem, simulator, x, noise_seed)
    write_forms(problem, again, x, noise_seed, title, files, camera)
    return again


def write_forms(
    problem: Problem,
    again: Rerun,
    x: np.ndarray,
    noise_seed: Noise,
    title: str,
    files: Exports,
    camera: bool = True,
) -> None:
    """Write the files of a rollout that was run again: all but the floating-car data, and without SUMO."""
    trace = again.trace
    if trace is None:
        raise SimulationError(f"the rollout failed: {again.error}")
    text = scenario_text(problem, x, noise_seed, again.f, title)
    if files.scenario is not None:
        files.scenario.write_text(text, encoding="utf-8")
    if files.table is not None:
        write_table(trace, files.table)
    if files.openscenario is not None:
        road = None if files.road is None else files.road.name
        write_openscenario(trace, files.openscenario, title, datetime.now(UTC), road)
    if files.road is not None:
        write_opendrive(problem.corridor.net_path, files.road)
    if files.mcap is not None:
        rays = problem.job.scenario.safety.rays
        write_recording(trace, problem.corridor, files.mcap, problem.job.gamma, rays, {"scenario.toml": text})
    if files.mp4 is not None:
        from service.analysis.video import EgoView, write_video

        view = EgoView(problem.job.scenario, problem.corridor, x, int(noise_seed)) if camera else None
        write_video(trace, problem.corridor, files.mp4, title, view)
