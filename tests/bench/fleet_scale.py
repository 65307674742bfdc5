"""What the scheduler costs: time a chunk with many workers, memory over many rollouts, use of the local cores.

    python -m tests.bench.fleet_scale overhead     200 light workers over real Zenoh, TCP and database
    python -m tests.bench.fleet_scale memory       10^6 rollouts of bookkeeping
    python -m tests.bench.fleet_scale efficiency   real rollouts through `tailroad serve` beside a local pool

Light workers are the real worker with a formula for rollouts. Prints one JSON object each.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import sys
import tempfile
import threading
import time
from pathlib import Path

import psutil

import ce
from service.evaluation.job import Job, Problem, make_job
from service.evaluation.pool import LocalPool, Work
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.messages import Answer, Lease
from service.remote.fleet.policy import Policy
from service.remote.fleet.zenoh_link import client_session
from service.world.scenario import load_scenario
from tests.service.remote.fleet import processes as P
from tests.service.remote.fleet.light import LightFleet, LightRunner, LightWorker, free_port, light_answer

WORKERS, HOSTS = 200, 4
CHUNK_S = 1.0  # a light worker's chunk takes so long


class Slow(LightRunner):
    """Takes the time of a real chunk, and none of the processor's."""

    def run(self, lease: Lease) -> Answer:
        time.sleep(CHUNK_S)
        return light_answer(self.worker, lease)


def _host(port: int, host: int, count: int, quick: bool) -> None:
    """A process with some of the workers, which share a session: 200 of those need more threads than a desk has."""
    session = client_session([f"tcp/127.0.0.1:{port}"])
    runner = LightRunner if quick else Slow
    workers = [LightWorker(port, f"h{host}w{i}", runner, session=session) for i in range(count)]
    threading.Event().wait()  # until this process is killed
    assert workers


def _job(budget: int) -> Job:
    return make_job(
        load_scenario("i80-paper-10s"), "idm", 0.5, "naive", 1, {"budget": budget, "batch_size": 20_000}
    )


def _light_run(policy: Policy, budget: int, workers: int, hosts: int, quick: bool, look) -> None:
    """Run a job on light workers in other processes; look(fleet, job, done) each second."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        fleet = LightFleet(Path(folder), policy, lock_wait_s=5.0)
        processes = [
            context.Process(target=_host, args=(fleet.port, i, workers // hosts, quick), daemon=True)
            for i in range(hosts)
        ]
        for process in processes:
            process.start()
        while len(fleet.fleet.workers()) < workers:
            time.sleep(0.1)
        job = fleet.fleet.submit(_job(budget)).id
        over = threading.Event()
        fleet.hub.listen(lambda event: over.set() if event.body.get("status") == "done" else None)
        while not over.wait(1.0):
            look(fleet, job, False)
        look(fleet, job, True)
        for process in processes:
            process.kill()
        fleet.close()


def _processor_s() -> dict[str, float]:
    """Processor time of this process by what it went into."""
    names = {t.native_id: t.name.split("_")[0] for t in threading.enumerate()}
    spent = {"hub": 0.0, "statistics": 0.0, "other": 0.0}
    for thread in psutil.Process().threads():
        name = names.get(thread.id, "other")
        spent[name if name in spent else "other"] += thread.user_time + thread.system_time
    return spent


def overhead() -> dict:
    """Processor time of the scheduler's process for each chunk.

    hub: the scheduler, the database and the replies; other: Zenoh with its router, and reading the messages;
    statistics: the algorithm's own work, drawing each batch of 428 dimensions above all, which grows with the rollouts
    and not with the chunks.
    """
    seen: list[tuple[dict[str, float], int]] = []

    def look(fleet: LightFleet, job: str, done: bool) -> None:
        chunks = fleet.hub.call(lambda s: sum(w.chunks for w in s.workers.here.values())).result()
        seen.append((_processor_s(), chunks))

    policy = Policy(first_rows=100, max_rows=100, least_chunk_s=CHUNK_S, chunk_s=CHUNK_S, audit_share=0.0)
    _light_run(policy, 400_000, WORKERS, HOSTS, False, look)
    busy = [one for one in seen if one[1] > 2 * WORKERS]
    (first, chunks_0), (last, chunks_1) = busy[0], busy[-1]
    n = chunks_1 - chunks_0
    return {"workers": WORKERS, "chunks": n, "rollouts_a_chunk": 100} | {
        f"{what}_ms_per_chunk": 1e3 * (last[what] - first[what]) / n for what in last
    }


def memory() -> dict:
    """Resident memory of the scheduler's process as rollouts are counted, and what it holds at the end."""
    seen: dict[int, float] = {}
    left: dict[str, int] = {}

    def look(fleet: LightFleet, job: str, done: bool) -> None:
        def held(s) -> dict[str, int]:
            return {"jobs": len(s.jobs), "leases": len(s.workers.leases), "tickets": len(s.tickets)}

        rollouts = 1_000_000 if done else (fleet.fleet.job(job).rollouts or 0)
        seen[rollouts // 100_000 * 100_000] = psutil.Process().memory_info().rss / 2**20
        left.update(fleet.hub.call(held).result())

    _light_run(Policy(max_rows=500, chunk_s=10.0, audit_share=0.02), 1_000_000, 8, 2, True, look)
    return {"resident_mb_after_rollouts": seen, "held_at_the_end": left,
            "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10}  # fmt: skip


def _tree_s(root: int | None = None) -> float:
    """Processor time of a process's descendants, and of the process itself where one is named."""
    process = psutil.Process(root)
    family = process.children(recursive=True) + ([process] if root is not None else [])
    return sum(times.user + times.system for times in (one.cpu_times() for one in family))


def efficiency(rollouts: int = 4000) -> dict:
    """The fleet beside a bare local pool of as many processes: rollouts a second, and processor time of a rollout, all
    processes of either counted, which other programs on the machine hardly change; and the share of time that workers
    are busy, which they hardly change either."""
    cores = len(os.sched_getaffinity(0))
    job = make_job(load_scenario("i80-paper-10s"), "lidar", 0.5, "naive", 1, {"budget": rollouts})
    x, noise_seeds = ce.draw(Problem(job).base, 1, "estimate", 0, 0, rollouts)
    works = [Work(i, x[i : i + 100], noise_seeds[i : i + 100]) for i in range(0, rollouts, 100)]
    with LocalPool(job, cores) as pool:
        for _ in pool.run(works[: 2 * cores]):  # every process is warm
            pass
        began, used = time.perf_counter(), _tree_s()
        for _ in pool.run(works):
            pass
        pool_s, pool_used_s = time.perf_counter() - began, _tree_s() - used
    with tempfile.TemporaryDirectory() as folder, JobStore(f"sqlite:///{folder}/fleet.sqlite") as store:
        P.submit(store, job)
        port = free_port()
        started = [P.serve(Path(folder), port, "--audit-share", "0"), P.worker(port, cores)]
        P.wait(lambda: P.rollouts(store) >= 100 * cores, started)  # every process is warm
        pids = [process.process.pid for process in started]
        first, began = P.rollouts(store), time.perf_counter()
        worker_0, used = store.cost(P.JOB)[0], sum(_tree_s(pid) for pid in pids)
        P.wait_done(store, started, 3000.0)
        fleet_s, fleet_used_s = time.perf_counter() - began, sum(_tree_s(pid) for pid in pids) - used
        worker_s = store.cost(P.JOB)[0] - worker_0
        for process in started:
            process.kill()
    return {
        "cores": cores,
        "pool_rollouts_per_s": rollouts / pool_s,
        "fleet_rollouts_per_s": (rollouts - first) / fleet_s,
        "fleet_over_pool": (rollouts - first) / fleet_s * pool_s / rollouts,
        "pool_processor_ms_per_rollout": 1e3 * pool_used_s / rollouts,
        "fleet_processor_ms_per_rollout": 1e3 * fleet_used_s / (rollouts - first),
        "busy_share": worker_s / fleet_s / cores,
    }


if __name__ == "__main__":
    kinds = {"overhead": overhead, "memory": memory, "efficiency": efficiency}
    if len(sys.argv) != 2 or sys.argv[1] not in kinds:
        sys.exit(__doc__)
    print(json.dumps(kinds[sys.argv[1]](), indent=2))
