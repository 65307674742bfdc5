"""One side of `tests.bench.against`: runs the rollouts of the checkout that it is started in, a round for each line.

It is read by the present Python and imports what the checkout has, whatever it was called then. A line N on the
standard input is answered by one JSON object: the processor seconds of N rollouts and a digest of their f.
"""

import hashlib
import json
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

ROOMS = (("service.evaluation", "service.world"), ("service", "service"))  # today, and before the rooms
BEFORE = {
    "i80-paper-10s": "i80-10s",
    "lidar-paper": "lidar",
    "vision-paper": "vision",
}  # before they were renamed
CHUNK = 250


def modules() -> tuple[Any, Any, Any, Any]:
    """The modules of jobs, of the pool, of scenarios and of egos that this checkout has."""
    # an editable installation finds what this checkout lacks in another one
    sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in repr(finder).lower()]
    evaluation, world = next(
        rooms for rooms in ROOMS if (Path.cwd() / rooms[0].replace(".", "/") / "job.py").is_file()
    )
    names = f"{evaluation}.job", f"{evaluation}.pool", f"{world}.scenario", "policies.egos"
    jobs, pool, scenarios, egos = map(import_module, names)
    return jobs, pool, scenarios, egos


def main(way: str, scenario: str, ego: str, gamma: float) -> None:
    jobs, pool, scenarios, egos = modules()
    if ego not in egos.ego_names():
        ego = BEFORE[ego]
    try:
        loaded = scenarios.load_scenario(scenario)
    except Exception:  # whatever it was then that said there is none of that name
        if scenario not in BEFORE:
            raise
        loaded = scenarios.load_scenario(BEFORE[scenario])
    job = jobs.make_job(loaded, ego, gamma, "naive", 1, {})
    problem = jobs.Problem(job)
    worlds = getattr(pool, "WORLDS", {})
    open_world = worlds.get("some", pool.in_sumo) if way == "estimate" else pool.in_sumo
    ce = import_module("ce")
    world, ready = open_world(job), False
    for line in sys.stdin:
        n = int(line)
        x, noise = ce.draw(problem.base, job.seed, "estimate", 0, 0, n)
        if not ready:  # what is compiled or opened when it is first needed
            pool.run_chunk(world, pool.Work(0, x[:5], noise[:5]))
            ready = True
        digest, began = hashlib.sha256(), time.process_time()
        for first in range(0, n, CHUNK):
            chunk = pool.run_chunk(
                world, pool.Work(first, x[first : first + CHUNK], noise[first : first + CHUNK])
            )
            digest.update(chunk.f.tobytes())
        print(
            json.dumps({"processor_s": time.process_time() - began, "digest": digest.hexdigest()[:16]}),
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4]))
