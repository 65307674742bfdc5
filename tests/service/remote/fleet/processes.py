"""`tailroad serve` and `tailroad worker` as processes that tests kill."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import ce
from service.evaluation.job import Job
from service.evaluation.record import replay
from service.evaluation.store.jobs import JobStore
from service.evaluation.store.reader import JobReader

LIMIT_S = 240.0  # for anything that a test waits for, on a machine with other things to do
JOB = "j1"


class Process:
    """A `tailroad` command whose lines are read as they come."""

    def __init__(self, *arguments: str):
        command = [sys.executable, "-m", "service.front.cli", *arguments]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
        self.lines: list[str] = []
        self._changed = threading.Condition()
        self._ended = False
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            with self._changed:
                self.lines.append(line)
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def wait_line(self, part: str, limit_s: float = LIMIT_S) -> None:
        """Until it has said so."""
        with self._changed:
            said = self._changed.wait_for(
                lambda: self._ended or any(part in line for line in self.lines), limit_s
            )
            assert said, self.lines[-20:]
            assert any(part in line for line in self.lines), self.lines[-20:]

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    def kill(self) -> None:
        """kill -9."""
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(LIMIT_S)

    def children(self) -> list[int]:
        """Its own processes that run rollouts."""
        found = []
        for task in Path(f"/proc/{self.process.pid}/task").iterdir():
            for pid in (task / "children").read_text().split():
                if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    found.append(int(pid))
        return found


def serve(home: Path, port: int, *more: str, database: str | None = None) -> Process:
    where = ("--database", database) if database else ()
    return Process(
        "serve",
        "--home",
        str(home),
        "--listen",
        f"tcp/127.0.0.1:{port}",
        "--workers",
        "0",
        "--dashboard",
        "off",
        *where,
        *more,
    )


def worker(port: int, procs: int = 1) -> Process:
    return Process("worker", "--connect", f"tcp/127.0.0.1:{port}", "--procs", str(procs))


def submit(store: JobStore, job: Job, max_failed: float = 1.0) -> None:
    store.add_job(JOB, job, 0, 1.0, "", "running", max_failed)


def rollouts(store: JobStore) -> int:
    return sum(chunk.stop - chunk.start for _, _, chunk in store.chunks.all_chunks(JOB))


def wait(true: Callable[[], bool], alive: Sequence[Process] = (), limit_s: float = LIMIT_S) -> None:
    """Until something that is only seen from outside is so; processes that must be alive meanwhile are looked after."""
    deadline = time.monotonic() + limit_s
    pause_s = 0.02
    while not true():
        for process in alive:
            assert process.alive, process.lines[-20:]
        assert time.monotonic() < deadline, [process.lines[-20:] for process in alive]
        time.sleep(pause_s)
        pause_s = min(1.5 * pause_s, 0.2)


def wait_done(store: JobStore, alive: Sequence[Process] = (), limit_s: float = LIMIT_S) -> None:
    def over() -> bool:
        row = store.job(JOB)
        assert row is not None
        assert row.status in ("running", "done"), row.reason
        return row.status == "done"

    wait(over, alive, limit_s)


def bits(estimate: ce.Estimate) -> tuple:
    weights = b"" if estimate.log_weights is None else estimate.log_weights.tobytes()
    return estimate.p, estimate.std_error, estimate.ci, estimate.rollouts, estimate.f.tobytes(), weights


def recorded_bits(store: JobStore) -> tuple:
    """The estimate that the record gives, after a look that every rollout is there once."""
    row = store.job(JOB)
    assert row is not None
    rows = [(p, k, i) for p, k, c in store.chunks.all_chunks(JOB) for i in range(c.start, c.stop)]
    estimate = replay(JobReader(store, row), row.job).estimate
    assert len(rows) == len(set(rows)) == estimate.rollouts
    assert estimate.finished
    return bits(estimate)


def fill_disk(process: Process) -> Callable[[], None]:
    """Let no file of the process grow beyond a few bytes, as if the disk were full; what is returned ends that."""
    pid = process.process.pid
    before = resource.prlimit(pid, resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
    return lambda: resource.prlimit(pid, resource.RLIMIT_FSIZE, before) and None


def kill(pid: int) -> None:
    os.kill(pid, signal.SIGKILL)
