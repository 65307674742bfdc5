"""`tailroad.client`: a service that answers as this machine does, with runs and estimates of the same kind."""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import polars as pl

from service.analysis.comparison.objects import Comparison
from service.analysis.estimated import Estimated
from service.analysis.failures.objects import Failure, Failures
from service.analysis.notebook import comparison_html, estimates_html
from service.analysis.rollout_files import RolloutFiles
from service.closing import Closing
from service.errors import InputError, StoreError
from service.evaluation.store.export import SCHEMA, contact_columns
from service.remote.api.objects import Rollouts
from service.remote.client.client import DEFAULT_ENDPOINT, Client

Order = Literal["likelihood", "weight", "f"]


@dataclass(frozen=True)
class RemoteProgress:
    """How far a job is.

    rollouts: so far, at most `total`
    """

    job: str
    rollouts: int
    total: int


class Service(Closing):
    """A service at one of the endpoints; use as a context manager, or close it.

    client: its whole API (service.remote.client.Client).
    """

    def __init__(
        self,
        connect: str | Sequence[str] = DEFAULT_ENDPOINT,
        zenoh_config: str | None = None,
        timeout_s: float = 20.0,
    ):
        self.client = Client(connect, zenoh_config, timeout_s)

    def close(self) -> None:
        self.client.close()

    def estimate(
        self,
        scenario: Any,
        ego: str = "lidar",
        *,
        gamma: float,
        method: str = "auto",
        budget: int = 20_000,
        options: Mapping[str, Any] | None = None,
        progress: Callable[[RemoteProgress], None] = lambda told: None,
        **others: Any,
    ) -> "RemoteRun":
        """Submit a job and wait for its end; Ctrl-C stops the waiting, not the job.

        scenario: a name that the service lists, a file or a Scenario, which are sent by value
        others: rel_error, confidence, seed, measure, noise_mode, priority, weight, label
        """
        run = self.submit(scenario, ego, gamma=gamma, method=method, budget=budget, options=options, **others)
        return run.wait(progress)

    def submit(
        self,
        scenario: Any,
        ego: str = "lidar",
        *,
        gamma: float,
        options: Mapping[str, Any] | None = None,
        **others: Any,
    ) -> "RemoteRun":
        """Submit a job, and leave it to the service."""
        if not isinstance(ego, str):
            raise InputError(f"ego {ego!r:.200}: a service runs egos by name; `tailroad get egos` lists them")
        asked = self.client.submit(as_sent(scenario), gamma, ego=ego, options=dict(options or {}), **others)
        return RemoteRun(self.client, asked.id)

    def run(self, job: str) -> "RemoteRun":
        """A job that the service has."""
        return RemoteRun(self.client, self.client.job(job).id)

    def compare(
        self, runs: Sequence["str | RemoteRun"], gamma: float | None = None, examine: int | None = None
    ) -> "RemoteCompared":
        """Jobs of the service beside each other.

        gamma: one threshold for all
        """
        names = tuple(run if isinstance(run, str) else run.job for run in runs)
        return RemoteCompared(names, self.client.comparison(names, gamma, examine))


@dataclass(frozen=True)
class RemoteCompared:
    """Jobs of a service beside each other."""

    runs: tuple[str, ...]
    comparison: Comparison

    def _repr_html_(self) -> str:
        return comparison_html(self.comparison)


class RemoteRun:
    """A job of a service, as a Run of this machine."""

    def __init__(self, client: Client, job: str):
        self.client, self.job = client, job

    def __repr__(self) -> str:
        return f"<RemoteRun {self.job}: {self.estimate.in_short}>"

    def _repr_html_(self) -> str:
        return estimates_html([self.estimate], self.job)

    @property
    def status(self) -> str:
        """running, paused, done, cancelled, failed or needs-restart."""
        return self.client.job(self.job).status

    @property
    def estimate(self) -> Estimated:
        """What it has come to, from the batches that are complete."""
        return self.client.estimate(self.job)

    @property
    def estimates(self) -> dict[str, Estimated]:
        """The same, by job: a run of a service is one."""
        return {self.job: self.estimate}

    def wait(self, progress: Callable[[RemoteProgress], None] = lambda told: None) -> "RemoteRun":
        """Wait until the job is over; InputError where it failed or was cancelled."""
        total = int(self.client.job(self.job).options.get("budget") or 0)
        for event in self.client.watch(self.job):
            if event.kind == "progress":
                progress(RemoteProgress(self.job, int(event.body["rollouts"]), total))
        over = self.client.job(self.job)
        if over.status != "done":
            raise InputError(f"job {self.job} is {over.status}: {over.reason or 'no reason given'}")
        return self

    def to_polars(self) -> pl.DataFrame:
        """Every rollout, a row each: job, phase, iteration, row, f, outcome, steps, error, worker, contact."""
        pages = [
            pl.DataFrame({"job": [self.job] * len(page.row)} | _columns(page), SCHEMA)
            for page in self.client.all_rollouts(self.job)
        ]
        return pl.concat(pages)

    def failures(self, limit: int = 20, by: Order = "likelihood", outcome: str | None = None) -> Failures:
        """How the ego fails: the failure modes, and the first `limit` dangerous rollouts in the order asked for.

        outcome: those that ended so, instead of those with f <= gamma
        """
        return self.client.failures(self.job, limit, by, outcome)

    def replay(self, rank: int, by: Order = "likelihood", outcome: str | None = None) -> "RemoteReplay":
        """The dangerous rollout at that rank of `failures`, to be looked at."""
        found = self.failures(max(rank, 1), by, outcome)
        if not 1 <= rank <= len(found.failures):
            raise InputError(
                f"rank {rank}: job {self.job} has {found.events} dangerous rollouts, counted from 1"
            )
        return RemoteReplay(self.client, self.job, found.failures[rank - 1])

    def report(self, path: str | Path = "report.html") -> Path:
        """Write the HTML report to `path`, and its facts beside it, as .json; the page's path."""
        facts = msgspec.json.encode(self.client.report_json(self.job))
        page = write_to(Path(path), self.client.report(self.job).encode())
        write_to(page.with_suffix(".json"), msgspec.json.format(facts, indent=1) + b"\n")
        return page


class RemoteReplay(RolloutFiles):
    """A dangerous rollout of a service's job; each method has the service run it again, and writes a file."""

    def __init__(self, client: Client, job: str, failure: Failure):
        self.client, self.job, self.failure = client, job, failure

    @property
    def f(self) -> float:
        """Its safety value, on record."""
        return self.failure.f

    def _write(self, form: str, path: str | Path) -> Path:
        failure = self.failure
        return write_to(
            Path(path), self.client.export(self.job, failure.row, form, iteration=failure.iteration)
        )


def as_sent(scenario: Any) -> str | dict[str, Any]:
    """A name as it is, a file or a Scenario as its content; ScenarioError where a file is wrong in itself."""
    from service.world.scenario import Scenario

    if isinstance(scenario, Scenario):
        from service.world.scenario.fixed import toml_of

        return tomllib.loads(toml_of(scenario))
    if not str(scenario).endswith(".toml"):
        return str(scenario)
    from service.world.scenario.load import read_toml

    return read_toml(Path(scenario), str(scenario))


def _columns(page: Rollouts) -> dict[str, Any]:
    """The columns of a page of rollouts, as `service.evaluation.store.export` has them."""
    told = {k: v for k, v in msgspec.structs.asdict(page).items() if k not in ("next", "contact")}
    return told | contact_columns([outcome == "collision" for outcome in page.outcome], page.contact)


def write_to(path: Path, content: bytes) -> Path:
    """Write a file; StoreError where it cannot be. Its path."""
    try:
        path.write_bytes(content)
    except OSError as error:
        raise StoreError(f"cannot write {path}: {error.strerror or error}; give another path") from error
    return path


def client(
    connect: str | Sequence[str] = DEFAULT_ENDPOINT, zenoh_config: str | None = None, timeout_s: float = 20.0
) -> Service:
    """The service at a Zenoh endpoint, whose jobs are runs like those of this machine.

    connect: where it or a router is
    zenoh_config: a file, for TLS and passwords
    timeout_s: to wait for an answer

    >>> import tailroad
    >>> with tailroad.client("tcp/127.0.0.1:7447") as fleet:  # doctest: +SKIP
    ...     run = fleet.estimate("i80-10s", "lidar", gamma=0.5, budget=20_000)
    ...     run.estimate.p, run.estimate.ci
    """
    return Service(connect, zenoh_config, timeout_s)
