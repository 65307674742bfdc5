"""Workers without SUMO: the real worker over real Zenoh, whose rollouts are a formula of their noise seeds."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import ce
from service.evaluation.evaluate import evaluate
from service.evaluation.job import Job, Problem
from service.evaluation.store import FAILED, Chunk
from service.evaluation.store.jobs import Event, JobStore
from service.remote.fleet.answers import answer_of, chunk_of
from service.remote.fleet.hub import Hub
from service.remote.fleet.messages import Answer, Capabilities, Drawn, Failed, JobSpec, Lease
from service.remote.fleet.policy import Policy
from service.remote.fleet.referee import Referee
from service.remote.fleet.service import Fleet
from service.remote.fleet.versions import versions
from service.remote.fleet.worker import NotWanted, Worker
from service.remote.fleet.zenoh_link import HubLink, WorkerConnection, client_session, router_session

ROW_S = 0.01  # what a light rollout says it has taken
LIMIT_S = 120.0  # for anything that a test waits for


def formula(noise_seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f and outcome of rollouts, by their noise seeds."""
    f = (noise_seeds % 1_000_003) / 250_000.0
    outcomes = (noise_seeds % 3).astype(np.uint8)
    failed = noise_seeds % 997 == 0
    f[failed], outcomes[failed] = np.nan, FAILED
    return f, outcomes


def expected(job: Job) -> ce.Estimate:
    """What one process comes to with the formula."""
    problem = Problem(job)
    return evaluate(problem.algorithm, problem.stream_seed, lambda batch: formula(batch.noise)[0])


class LightRunner:
    """Stands for a worker's process; subclasses misbehave."""

    def __init__(self, worker: str):
        self.worker = worker
        self.job = ""

    def open(self, spec: JobSpec) -> str:
        self.job = spec.job
        return ""

    def run(self, lease: Lease) -> Answer | Failed:
        return light_answer(self.worker, lease)

    def close(self) -> None:
        self.job = ""


def light_answer(worker: str, lease: Lease) -> Answer:
    key = lease.chunk
    if isinstance(lease.rows, Drawn):
        noise_seeds = ce.streams.noise_seeds(lease.rows.seed, key.phase, key.iteration, key.start, key.stop)
    else:
        noise_seeds = np.frombuffer(lease.rows.noise_seeds, np.uint64)
    f, outcomes = formula(noise_seeds)
    errors = {int(i): "light" for i in np.flatnonzero(outcomes == FAILED)}
    steps = (noise_seeds % 90).astype(np.int32)
    chunk = Chunk(key.start, key.stop, f, outcomes, steps, errors, ROW_S * noise_seeds.size)
    return answer_of(worker, lease.lease, key, chunk)


class LightReferee(Referee):
    """Replays a chunk by the formula."""

    def replay(self, spec: JobSpec, lease: Lease) -> Chunk | str:
        return chunk_of(light_answer("referee", lease))


class Gate:
    """Lets so many chunks through, so that a test decides how far its job is."""

    def __init__(self):
        self._permits = threading.Semaphore(0)

    def let(self, chunks: int) -> None:
        self._permits.release(chunks)

    def open(self) -> None:
        """For good."""
        self.let(1_000_000)

    def runner(self, worker: str) -> LightRunner:
        gate = self

        class Waiting(LightRunner):
            def run(self, lease: Lease) -> Answer | Failed:
                gate._permits.acquire()
                return super().run(lease)

        return Waiting(worker)


class LightWorker:
    """A worker in threads of this process, over a session of its own or a shared one."""

    def __init__(
        self,
        port: int,
        name: str,
        runner: Callable[[str], LightRunner] = LightRunner,
        procs: int = 1,
        session=None,
        made_of: dict[str, str] | None = None,
    ):
        self._session = session or client_session([f"tcp/127.0.0.1:{port}"])
        self._own = session is None
        self.connection = WorkerConnection(self._session, name)
        capabilities = Capabilities(procs, ("idm", "lidar"), False, False, made_of or versions())
        self.lines: list[str] = []
        self.refusal = ""
        self.worker = Worker(name, capabilities, self.connection, self.lines.append, runner)
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self.worker.run()
        except NotWanted as error:
            self.refusal = str(error)

    def stop(self) -> None:
        """Stop it as SIGTERM would."""
        self.worker.stop()
        self.join()
        self.connection.close()
        if self._own:
            self._session.close()

    def join(self) -> None:
        self._thread.join(LIMIT_S)
        assert not self._thread.is_alive()

    def vanish(self) -> None:
        """Be gone at once, as if killed: the connection breaks, nothing is said."""
        self._session.close()
        self.worker.stop()


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class LightFleet:
    """A hub, its database and its router in this process."""

    def __init__(
        self,
        folder: Path,
        policy: Policy,
        clock: Callable[[], float] | None = None,
        lock_wait_s: float = 0.2,
        referee: Referee | None = None,
    ):
        self.port = free_port()
        self.store = JobStore(f"sqlite:///{folder / 'fleet.sqlite'}", lock_wait_s)
        given = {"clock": clock} if clock else {}
        self.hub = Hub(self.store, policy, referee=referee or LightReferee(), **given)
        self.fleet = Fleet(self.hub)
        self._changed = threading.Condition()
        self.told: list[Event] = []
        self.hub.listen(self._hear)
        self.hub.start()
        self.open()

    def open(self) -> None:
        """Let the world in."""
        self._session = router_session([f"tcp/127.0.0.1:{self.port}"])
        self._link = HubLink(self._session, self.hub)

    def shut(self) -> None:
        """Shut the world out."""
        self._link.close()
        self._session.close()

    def _hear(self, event: Event) -> None:
        with self._changed:
            self.told.append(event)
            self._changed.notify_all()

    def wait(self, true: Callable[[list[Event]], bool]) -> None:
        """Until what was told so far is as the test wants it."""
        with self._changed:
            assert self._changed.wait_for(lambda: true(self.told), LIMIT_S), self.told

    def wait_status(self, job: str, status: str) -> None:
        self.wait(lambda told: any(e.job == job and e.body.get("status") == status for e in told))

    def wait_rollouts(self, job: str, least: int) -> None:
        """Until that many are run, or all."""

        def enough(event: Event) -> bool:
            ran = event.body["rollouts"] if event.kind == "progress" else 0
            return event.job == job and (ran >= least or event.body.get("status") == "done")

        self.wait(lambda told: any(enough(event) for event in told))

    def close(self) -> None:
        self.shut()
        self.hub.stop()
        self.store.close()


@contextmanager
def light_fleet(folder: Path, policy: Policy = Policy(), **more) -> Iterator[LightFleet]:  # noqa: B008 (frozen)
    fleet = LightFleet(folder, policy, **more)
    try:
        yield fleet
    finally:
        fleet.close()
