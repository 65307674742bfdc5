"""A job: everything that decides an estimate, and what is made of it."""

import hashlib
from collections.abc import Sequence
from functools import cached_property
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any

import msgspec

import ce
from ce.paths import NetworkCommittor, PathOptions, PathSampling
from policies.drivers import DriverModel, load_drivers
from policies.egos import EgoPolicy, ego_digest
from service.errors import InputError, StoreError
from service.evaluation.options import PATHS, options_of
from service.world.egos.open import camera_elsewhere, check_ego, open_ego
from service.world.paths.process import HighwayPaths, check_paths
from service.world.safety.measure import open_monitor
from service.world.scenario.base import base_distribution, dimension
from service.world.scenario.check import check_road
from service.world.scenario.measures import check_threshold
from service.world.scenario.schema import Scenario
from service.world.sim.audited import Audited
from service.world.sim.rollout import Simulator
from service.world.sim.without_sumo import WithoutSumo, can_leave_out_sumo
from sumo_nets.corridor import Corridor


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """scenario + ego + threshold + method with its options + seed: the same job gives the same bits."""

    scenario: Scenario
    ego: str
    gamma: float
    method: str
    options: dict[str, Any]  # of the method: ce.OPTIONS
    seed: int
    tailroad: str = version("tailroad")
    weights_sha256: str = ""  # of the drivers' weights, so that a resumed job is not mixed with others'
    ego_sha256: str = ""  # of the ego's, where it is one of the shipped networks
    name: str = ""  # within its run; empty: its method's
    committor_sha256: str = ""  # of the committor that the method paths was given; "" where it trains its own

    @property
    def id(self) -> str:
        """What the job's record is kept by, unique within a run (`told_apart`)."""
        return self.name or self.method


def make_job(
    scenario: Scenario,
    ego: str,
    gamma: float,
    method: str,
    seed: int,
    options: dict[str, Any],
    committor_sha256: str = "",
) -> Job:
    """A checked job; InputError, ce.CeError or ValueError names what is wrong."""
    if scenario.fixed is not None:
        raise InputError(
            f"scenario {scenario.name} holds one fixed rollout: run it with `tailroad rollout`, or remove [fixed] "
            "from the file to estimate over its distributions"
        )
    check_ego(ego)  # before anything of it is read
    job = Job(
        scenario=scenario,
        ego=ego,
        gamma=gamma,
        method=method,
        options=options,
        seed=seed,
        weights_sha256=_weights_digest(load_drivers(scenario.drivers.weights)),
        ego_sha256=ego_digest(ego),
        committor_sha256=committor_sha256,
    )
    open_monitor(scenario, len(scenario.vehicles))
    try:
        check_threshold(scenario.safety.measure, gamma)
    except ValueError as error:
        raise InputError(str(error)) from error
    chosen = options_of(method, options)
    if method == PATHS:
        check_paths(scenario, ego)
    else:
        ce.algorithm(method, _TINY_BASE, gamma, chosen)
    return job


def told_apart(jobs: Sequence[Job]) -> tuple[Job, ...]:
    """The jobs of a run, each with an id of its own: the second of an id is ID-2. InputError where two are the
    same job."""
    found: list[Job] = []
    for job in jobs:
        if job in jobs[: len(found)]:
            raise InputError(f"the same job twice: {job.method}, gamma {job.gamma:g}, seed {job.seed}")
        taken, own = {other.id for other in found}, job.id
        ids = (own if n == 1 else f"{own}-{n}" for n in count(1))
        free = next(i for i in ids if i not in taken)
        found.append(job if free == own else msgspec.structs.replace(job, name=free))
    return tuple(found)


PER_ROW = 40  # bytes beside x of a row of the batch: noise seed, hash, f
PER_ROLLOUT = 24  # bytes of a rollout of the estimate: f, log weight, replication


def held_bytes(job: Job) -> int:
    """Memory that an open job takes at the scheduler at most: its batch, its algorithm's state, its rollouts' f."""
    options = options_of(job.method, job.options)
    dim = dimension(job.scenario)
    if isinstance(options, PathOptions):
        return int(options.population * options.starts_a_path) * 8 * dim
    kept = options.sizes()[2] if isinstance(options, ce.CrossEntropyOptions) else options.budget
    return options.held_rows(dim) * (8 * dim + PER_ROW) + kept * PER_ROLLOUT


_TINY_BASE = ce.Product([ce.Beta(1.0, 1.0)])  # only to check the other arguments before any file is opened


class Problem:
    """What a job's parts come to: its road, drivers, base distribution and algorithm."""

    def __init__(self, job: Job):
        self.job = job

    @cached_property
    def corridor(self) -> Corridor:
        return check_road(self.job.scenario, self.job.scenario.name)

    @cached_property
    def drivers(self) -> DriverModel:
        drivers = load_drivers(self.job.scenario.drivers.weights)
        if _weights_digest(drivers) != self.job.weights_sha256:
            raise StoreError(
                f"the weights {self.job.scenario.drivers.weights!r} have changed since this run began; "
                "start a new run with another --out"
            )
        return drivers

    @cached_property
    def base(self) -> ce.Product:
        return base_distribution(self.job.scenario, self.drivers)

    @cached_property
    def algorithm(self) -> ce.Algorithm:
        job = self.job
        return ce.algorithm(job.method, self.base, job.gamma, options_of(job.method, job.options))

    @cached_property
    def paths(self) -> HighwayPaths:
        """The job's rollouts as paths."""
        self.check_ego_weights()
        return HighwayPaths(self.job.scenario, self.corridor, self.drivers, self.job.ego)

    def path_algorithm(self, committor: NetworkCommittor | None) -> PathSampling:
        """The algorithm of a job of paths.

        committor: that it was given
        """
        job = self.job
        return PathSampling(self.paths, job.gamma, options_of(job.method, job.options), committor)

    @property
    def stream_seed(self) -> int:
        """The seed of this job's random streams: jobs that differ in their method share no rollouts."""
        digest = hashlib.sha256(f"{self.job.method}/{self.job.seed}".encode()).digest()
        return int.from_bytes(digest[:8], "little")

    def check_ego_weights(self) -> None:
        """StoreError where the ego's weights have changed since the job was made."""
        if self.job.ego_sha256 not in ("", ego_digest(self.job.ego)):
            raise StoreError(
                f"the weights of ego {self.job.ego!r} have changed since this run began; start a new run with another "
                "--out"
            )

    def ego(self) -> EgoPolicy:
        """The job's ego, a new one."""
        self.check_ego_weights()
        return open_ego(self.job.ego, self.job.scenario, self.corridor)

    def simulator(
        self, fcd: Path | None = None, gui: bool = False, ego: EgoPolicy | None = None
    ) -> Simulator:
        """A simulator of this job's rollouts, for this process.

        ego: to drive in place of the job's
        """
        return Simulator(
            self.job.scenario,
            self.corridor,
            self.drivers,
            ego or self.ego(),
            fcd=fcd,
            gui=gui,
            open_camera=camera_elsewhere(self.job.scenario),
        )


def in_sumo(job: Job) -> Simulator:
    """A world for this process in which SUMO drives every rollout."""
    return Problem(job).simulator()


def compiled(job: Job) -> Audited | Simulator:
    """A world for this process in which rollouts are one compiled call where the job allows it, with the events and one
    in a hundred of the others driven in SUMO too and compared (`service.world.sim.audited`)."""
    problem = Problem(job)
    if not can_leave_out_sumo(job.scenario, job.ego):
        return in_sumo(job)
    problem.check_ego_weights()
    alone = WithoutSumo(job.scenario, problem.corridor, problem.drivers, job.ego)
    return Audited(alone, problem.simulator, job.gamma)


def _weights_digest(drivers: DriverModel) -> str:
    digest = hashlib.sha256()
    for name in ("w1", "b1", "w2", "b2", "mu0", "sigma0", "action_scale"):
        digest.update(getattr(drivers, name).tobytes())
    return digest.hexdigest()
