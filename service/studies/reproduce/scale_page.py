"""The page on scale: local cores measured, larger fleets played, and what that is against driving in the real world."""

import os
from collections.abc import Callable

import numpy as np

from service.analysis.report import ink
from service.analysis.report.ink import Picture
from service.analysis.wording import count, percent
from service.evaluation.job import Job, make_job
from service.studies import bench
from service.studies.reproduce.page import Page, made_by, made_with
from service.studies.reproduce.scale import LATENCY_S, MESSAGE_S, FleetTiming, measure, play
from service.studies.reproduce.tables import Table, number
from service.world.scenario import Scenario, load_scenario

SCENARIO, EGO = "i80-paper-10s", "lidar-paper"
BATCHES = {"batches of 5,000": 5000, "one batch": None}  # the default of `naive`, and all rollouts at once
PAPER = (10, 300)  # the paper's speed-up over real-world testing, for each of P processors


class Size:
    """How much is measured and played.

    fleets: numbers of workers
    each: rollouts for a worker
    measured: rollouts that are timed
    cores: local ones
    """

    def __init__(self, fleets: tuple[int, ...], each: int, measured: int):
        self.fleets, self.each, self.measured = fleets, each, measured


SIZES = {
    "smoke": Size((1, 10), 50, 20),
    "small": Size((1, 10, 100, 1000), 200, 100),
    "medium": Size((1, 10, 100, 300, 1000), 500, 300),
    "large": Size((1, 10, 100, 300, 1000), 1000, 500),
    "paper": Size((1, 2, 5, 10, 20, 50, 100, 200, 500, 1000), 2000, 1000),
}


def scale_page(scale: str, cores: int, command: str, tell: Callable[[str], None]) -> Page:
    """Measure and play.

    tell: told what begins
    """
    size = SIZES[scale]
    scenario = load_scenario(SCENARIO)
    tell(f"timing {size.measured} rollouts in SUMO")
    rollout_s = measure(make_job(scenario, EGO, 0.5, "naive", 1, {}), size.measured)
    tell(f"local pools of up to {cores} workers")
    load = os.getloadavg()[0]
    local = bench.scaling(scenario, EGO, size.measured, sorted({1, 2, cores} & set(range(1, cores + 1))))
    timings: dict[str, list[FleetTiming]] = {}
    for name, batch in BATCHES.items():
        for workers in size.fleets:
            tell(f"{workers} workers, {name}")
            timings.setdefault(name, []).append(
                play(_job(scenario, workers * size.each, batch), rollout_s, workers)
            )
    sim_s = scenario.time.horizon_s
    introduction = [
        made_by(command, goes_on=False),
        f"Scenario `{SCENARIO}`, ego `{EGO}`, naive Monte Carlo. A rollout takes "
        f"{1e3 * float(rollout_s.mean()):.1f} ms of a core in SUMO (mean of {size.measured}, processor time), which is "
        f"{number(sim_s / float(rollout_s.mean()))} times real time. {made_with()}",
        "Larger fleets are played: the real scheduler, its messages, its statistics and its decisions take the "
        "processor time that they take here, a rollout what one of the timed ones took, the network "
        f"{1e3 * LATENCY_S:g} ms each way and Zenoh with the database {1e3 * MESSAGE_S:g} ms a message. "
        f"{size.each} rollouts for each worker, so that the beginning and the end of a job weigh more than in a "
        "long one.",
    ]
    return Page(
        f"scale-{scale}",
        f"Scale ({scale})",
        introduction,
        [_local_table(local, load, cores), *(_fleet_table(name, r, sim_s) for name, r in timings.items())],
        [("scale.svg", _picture(timings))],
        {"rollout_s": rollout_s.tolist(), "local": local, "fleets": timings},
    )


def _job(scenario: Scenario, rollouts: int, batch: int | None) -> Job:
    return make_job(
        scenario, EGO, 0.5, "naive", 1, {"budget": rollouts, "batch_size": min(batch or rollouts, rollouts)}
    )


def _local_table(local: list[dict[str, float]], load: float, cores: int) -> Table:
    rows = tuple(
        (count(r["workers"]), number(r["rollouts_per_s"], 3), number(r["efficiency"])) for r in local
    )
    return Table("Local cores, measured", ("workers", "rollouts/s", "efficiency"), rows,
                 f"By the wall clock, beside whatever else the machine did: its load average was {load:.1f} on {cores} "
                 "cores when it began. Only an idle machine tells the efficiency.")  # fmt: skip


def _fleet_table(name: str, timings: list[FleetTiming], sim_s: float) -> Table:
    rows = tuple(
        (
            count(r.workers),
            count(r.rollouts_per_s),
            percent(r.efficiency),
            count(r.rollouts_per_s * sim_s),
            percent(r.scheduler_busy),
            percent(r.statistics_busy),
            number(r.scheduler_ms_per_chunk),
        )
        for r in timings
    )
    head = (
        "workers",
        "rollouts/s",
        "efficiency",
        "x real time",
        "scheduler busy",
        "statistics busy",
        "ms a chunk",
    )
    note = (
        "Efficiency: rollouts' own time over workers × time to the end. Statistics: drawing and digesting each "
        "batch at the scheduler, before any worker can begin with it. The paper speaks of "
        f"{PAPER[0]} to {PAPER[1]} times real time for each of P processors, the cross-entropy method's gain included."
    )
    return Table(f"Fleets, played: {name}", head, rows, note)


def _picture(timings: dict[str, list[FleetTiming]]) -> Picture:
    with ink.figure(3.0) as drawn:
        axes = drawn.add_subplot()
        for i, (name, found) in enumerate(timings.items()):
            workers = np.array([r.workers for r in found])
            axes.plot(workers, [r.efficiency for r in found], marker="o", markersize=4,
                      color=ink.SPARE_COLOURS[i], linestyle="-" if i else "--", label=name)  # fmt: skip
        axes.set_ylim(0.0, 1.05)
        axes.set_xlim(0.8, 1.3 * max(r.workers for found in timings.values() for r in found))
        ink.log_axis(axes, "x", lambda v: f"{v:g}")
        axes.set_xlabel("workers")
        axes.set_ylabel("efficiency")
        axes.legend(loc="lower left")
        return ink.picture(drawn, "Efficiency by workers", "Efficiency of played fleets against the number of workers.",
                           "Rollouts' own time over workers × time to the end.")  # fmt: skip
