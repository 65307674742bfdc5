"""One rollout once more, written in every form asked for."""

from collections.abc import Mapping
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

# Files to write, by form: those of `rollout_files.FORMATS`, and "road", ASAM OpenDRIVE, which the OpenSCENARIO file in
# the same folder then names.
Files = Mapping[str, Path]


def write_exports(
    problem: Problem, x: np.ndarray, noise_seed: Noise, title: str, files: Files, camera: bool = True
) -> Rerun:
    """Run the rollout of x (d,) and its noise seed again and write the files; what it came to.

    camera: whether the film shows the ego's camera beside the road from above

    SUMO allows one simulation a process. Raises SimulationError where the rollout fails.
    """
    with problem.simulator(fcd=files.get("fcd")) as simulator:
        again = rerun(problem, simulator, x, noise_seed)
    write_forms(problem, again, x, noise_seed, title, files, camera)
    return again


def write_forms(
    problem: Problem,
    again: Rerun,
    x: np.ndarray,
    noise_seed: Noise,
    title: str,
    files: Files,
    camera: bool = True,
) -> None:
    """Write the files of a rollout that was run again: all but the floating-car data, and without SUMO."""
    trace = again.trace
    if trace is None:
        raise SimulationError(f"the rollout failed: {again.error}")
    text = scenario_text(problem, x, noise_seed, again.f, title)
    road = files.get("road")
    if path := files.get("scenario"):
        path.write_text(text, encoding="utf-8")
    if path := files.get("table"):
        write_table(trace, path)
    if path := files.get("openscenario"):
        write_openscenario(trace, path, title, datetime.now(UTC), None if road is None else road.name)
    if road is not None:
        write_opendrive(problem.corridor.net_path, road)
    if path := files.get("mcap"):
        rays = problem.job.scenario.safety.rays
        write_recording(trace, problem.corridor, path, problem.job.gamma, rays, {"scenario.toml": text})
    if path := files.get("mp4"):
        from service.analysis.video import EgoView, write_video

        view = EgoView(problem.job.scenario, problem.corridor, x, int(noise_seed)) if camera else None
        write_video(trace, problem.corridor, path, title, view)
