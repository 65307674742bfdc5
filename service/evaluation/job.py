"""A job: everything that decides an estimate, and what is made of it."""

import hashlib
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

import ce
from policies.drivers import DriverModel, load_drivers
from policies.egos import ego_digest
from service.errors import InputError, StoreError
from service.world.egos.open import camera_elsewhere, check_ego, open_ego
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

    @property
    def id(self) -> str:
        """Unique within a run."""
        return self.method


def make_job(
    scenario: Scenario, ego: str, gamma: float, method: str, seed: int, options: dict[str, Any]
) -> Job:
    """A checked job; InputError, ce.CeError or ValueError names what is wrong."""
    if scenario.fixed is not None:
        raise InputError(
            f"scenario {scenario.name} holds one fixed rollout: run it with `tailroad rollout`, or remove [fixed] "
            "from the file to estimate over its distributions"
        )
    job = Job(
        scenario=scenario,
        ego=ego,
        gamma=gamma,
        method=method,
        options=options,
        seed=seed,
        weights_sha256=_weights_digest(load_drivers(scenario.drivers.weights)),
        ego_sha256=ego_digest(ego),
    )
    check_ego(ego)
    open_monitor(scenario, len(scenario.vehicles))
    try:
        check_threshold(scenario.safety.measure, gamma)
    except ValueError as error:
        raise InputError(str(error)) from error
    ce.algorithm(method, _TINY_BASE, gamma, _options(method, options))
    return job


PER_ROW, PER_ROLLOUT = (
    40,
    24,
)  # bytes beside x: noise, hash, f of the batch; f, log weight, replication of the estimate


def held_bytes(job: Job) -> int:
    """Memory that an open job takes at the scheduler at most: its batch, its algorithm's state, its rollouts' f."""
    options = _options(job.method, job.options)
    dim = dimension(job.scenario)
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
        return ce.algorithm(job.method, self.base, job.gamma, _options(job.method, job.options))

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

    def simulator(self, fcd: Path | None = None, gui: bool = False) -> Simulator:
        """A simulator of this job's rollouts, for this process."""
        self.check_ego_weights()
        ego = open_ego(self.job.ego, self.job.scenario, self.corridor)
        return Simulator(
            self.job.scenario,
            self.corridor,
            self.drivers,
            ego,
            fcd=fcd,
            gui=gui,
            open_camera=camera_elsewhere(self.job.scenario),
        )


def without_sumo(job: Job) -> Audited | Simulator:
    """A world for this process that leaves SUMO out where the job can do without, with one rollout in a hundred run in
    both and compared (`service.world.sim.audited`)."""
    problem = Problem(job)
    if not can_leave_out_sumo(job.scenario, job.ego):
        return problem.simulator()
    problem.check_ego_weights()
    alone = WithoutSumo(job.scenario, problem.corridor, problem.drivers, job.ego)
    return Audited(alone, problem.simulator())


def _options(method: str, options: dict[str, Any]) -> Any:
    if method not in ce.OPTIONS:
        raise InputError(f"no method named {method!r}; there are {', '.join(ce.METHODS)}")
    try:
        return ce.OPTIONS[method](**options)
    except TypeError as error:
        raise InputError(f"options of method {method!r}: {error}") from error


def _weights_digest(drivers: DriverModel) -> str:
    digest = hashlib.sha256()
    for name in ("w1", "b1", "w2", "b2", "mu0", "sigma0", "action_scale"):
        digest.update(getattr(drivers, name).tobytes())
    return digest.hexdigest()
