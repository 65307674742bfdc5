"""A worker's process: one SUMO, one job at a time, chunks in and answers out over a pipe of MessagePack.

A crash in native code, or a rollout that never ends, costs this process and its chunk, nothing else.
"""

import multiprocessing
import multiprocessing.connection
import signal
from contextlib import suppress

import numpy as np

import ce
from ce.errors import CeError
from policies.drivers import WeightsError
from service.errors import SimulationError, TailroadError
from service.evaluation.job import Problem, compiled
from service.evaluation.parent import end_with_parent
from service.evaluation.pool import Work, run_chunk
from service.evaluation.store.draws import row_hashes, rows_digest
from service.remote.fleet.answers import answer_of
from service.remote.fleet.messages import (
    MAX_REASON,
    Answer,
    ChunkKey,
    Drawn,
    Failed,
    JobSpec,
    Lease,
    array_of,
    decode_reply,
    decode_request,
    encode,
)
from service.remote.fleet.versions import differing
from service.world.sim.audited import Audited
from service.world.sim.rollout import Simulator

OPEN_LIMIT_S = 300.0  # to open a job: kernels may have to be compiled


class RunnerLost(Exception):
    """The process ended, or did not answer in time and was ended; its text says which."""


class Runner:
    """The parent's side: a process that runs chunks of the job it was last given."""

    def __init__(self, worker: str):
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_main, args=(theirs, worker), daemon=True)
        self._process.start()
        theirs.close()
        self.job = ""

    @property
    def pid(self) -> int:
        return self._process.pid or 0

    def open(self, spec: JobSpec) -> str:
        """Make the job this process's; what is in the way, "" for nothing."""
        reply = self._call(encode(spec), OPEN_LIMIT_S)
        self.job = spec.job if not reply else ""
        return reply.decode()

    def run(self, lease: Lease) -> Answer | Failed:
        """Run a chunk of the job that is open."""
        message = decode_request(self._call(encode(lease), lease.limit_s))
        assert isinstance(message, Answer | Failed)
        return message

    def _call(self, data: bytes, limit_s: float) -> bytes:
        try:
            self._pipe.send_bytes(data)
            if self._pipe.poll(limit_s):
                return self._pipe.recv_bytes()
        except (OSError, EOFError):
            self._process.join(5.0)
            raise RunnerLost(f"the worker process ended (exit code {self._process.exitcode})") from None
        self.close()
        raise RunnerLost(f"the worker process did not answer within {limit_s:g} s")

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._process.kill()
        self._process.join()
        self._pipe.close()


def _main(pipe: multiprocessing.connection.Connection, worker: str) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is to be stopped and how is the parent's to say
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    bench = _Bench(worker)
    with suppress(EOFError):
        while True:
            message = decode_reply(pipe.recv_bytes())
            if isinstance(message, JobSpec):
                pipe.send_bytes(bench.open(message).encode())
            elif isinstance(message, Lease):
                pipe.send_bytes(encode(bench.run(message)))


class _Bench:
    """The job that is open in this process, and its simulator."""

    def __init__(self, worker: str):
        self._worker = worker
        self._problem: Problem | None = None
        self._simulator: Audited | Simulator | None = None
        self._last: tuple[tuple, ce.Stream] | None = None  # of the batch that was run last

    def open(self, spec: JobSpec) -> str:
        if self._simulator is not None:
            self._simulator.close()
            self._simulator = None
        try:
            problem = Problem(spec.spec)
            wrong = differing(problem, spec.digests)
            if wrong:
                return (
                    f"{wrong} of job {spec.job} differ from the scheduler's; install the same files at the same place "
                    "on this machine"
                )
            self._simulator = compiled(problem.job)
            self._problem = problem
            self._last = None
        except (TailroadError, WeightsError, CeError, ValueError, OSError) as error:
            return f"job {spec.job} cannot be opened here: {error}"
        return ""

    def run(self, lease: Lease) -> Answer | Failed:
        key = lease.chunk
        assert self._problem is not None
        assert self._simulator is not None
        base, n = self._problem.base, key.stop - key.start
        if isinstance(lease.rows, Drawn):
            x, noise_seeds = self._stream(key, lease.rows).draw(key.start, key.stop)
        else:
            x = array_of(lease.rows.x, "<f8", n * base.dim).reshape(n, base.dim).astype(np.float64)
            noise_seeds = array_of(lease.rows.noise_seeds, "<u8", n).astype(np.uint64)
        if rows_digest(row_hashes(x, noise_seeds)) != key.digest:
            reason = "the random draws of this machine are not the scheduler's"
            return Failed(self._worker, lease.lease, key, reason, explicit=True)
        try:
            chunk = run_chunk(self._simulator, Work(key.start, x, noise_seeds))
        except SimulationError as error:  # this machine's compiled rollouts are not SUMO's: it must not go on
            return Failed(self._worker, lease.lease, key, str(error)[:MAX_REASON], refused=True)
        return answer_of(self._worker, lease.lease, key, chunk)

    def _stream(self, key: ChunkKey, rows: Drawn) -> ce.Stream:
        """Of the batch that the chunk is of; chunks mostly follow one another."""
        assert self._problem is not None
        batch = (rows.parameters, rows.seed, key.phase, key.iteration)
        if self._last is None or self._last[0] != batch:
            parameters = array_of(rows.parameters, "<f8", len(rows.parameters) // 8)
            proposal = self._problem.base.with_parameters(parameters)
            self._last = batch, ce.Stream(proposal, rows.seed, key.phase, key.iteration)
        return self._last[1]
