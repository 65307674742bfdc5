"""A worker: slots that ask for chunks, run each in a process of its own, and answer until it is noted.

It remembers nothing: a scheduler that was started again is greeted again, and gets the answers that are ready.
"""

import threading
import time
from collections.abc import Callable
from typing import Protocol

from service.remote.fleet.messages import (
    Answer,
    Ask,
    Bye,
    Capabilities,
    Failed,
    GetJob,
    Hello,
    JobSpec,
    Lease,
    Refused,
    Reply,
    Request,
    Welcome,
)
from service.remote.fleet.runner import Runner, RunnerLost

PATIENCE_S = 10.0  # for a reply, beyond what the scheduler holds it back
GIVE_UP_S = 30.0  # until an answer is dropped that nobody notes, when the worker is to stop
TAKEN_S = 15.0  # in which a worker of the same name that is gone is missed
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 2.0  # before a question is asked again


class Connection(Protocol):
    """The way to the scheduler."""

    def ask(self, kind: str, message: Request, timeout_s: float) -> Reply | None:
        """The scheduler's reply; None where none came in time."""


class NotWanted(Exception):
    """The scheduler refuses this worker for good; its text says why."""


class Worker:
    """`procs` slots. `report` is given a line for each thing that whoever runs the worker should know."""

    def __init__(
        self,
        name: str,
        capabilities: Capabilities,
        connection: Connection,
        report: Callable[[str], None],
        runner: Callable[[str], Runner] = Runner,
    ):
        self.name = name
        self._capabilities = capabilities
        self._connection = connection
        self._report = report
        self._new_runner = runner
        self._stopping = threading.Event()
        self._refusal = ""
        self._hold_s = 0.0
        self._greeting = threading.Lock()
        self._greeted = 0  # times, so that slots that were refused together say hello once
        self._changed = threading.Condition()
        self._busy = 0  # slots that run a chunk or answer it
        self._specs: dict[str, JobSpec] = {}

    def run(self) -> None:
        """Work until `stop`; NotWanted where the scheduler refuses this worker."""
        if not self._hello(0):
            raise NotWanted(self._refusal or "stopped before a scheduler answered")
        slots = [
            threading.Thread(target=self._slot, args=(i,), name=f"slot-{i}")
            for i in range(self._capabilities.procs)
        ]
        for slot in slots:
            slot.start()
        self._stopping.wait()
        with self._changed:  # what is being run is run to its end and answered; questions are left
            self._changed.wait_for(lambda: self._busy == 0)
        self._request("bye", Bye(self.name), once=True)
        for slot in slots:
            slot.join()
        if self._refusal:
            raise NotWanted(self._refusal)

    def stop(self) -> None:
        """Finish what is being run, answer it, and leave."""
        self._stopping.set()

    # -- a slot ----------------------------------------------------------------------------------------------

    def _slot(self, index: int) -> None:
        bench = _SlotBench(self, index)
        try:
            while not self._stopping.is_set():
                reply = self._request("work", Ask(self.name, index, bench.job))
                if isinstance(reply, Lease) and self._begin():
                    try:
                        self._request("answer", bench.run(reply), until_noted=True)
                    finally:
                        self._end()
        finally:
            bench.close()

    def _begin(self) -> bool:
        """Whether a chunk is still to be run; it is waited for then."""
        with self._changed:
            if self._stopping.is_set():
                return False
            self._busy += 1
            return True

    def _end(self) -> None:
        with self._changed:
            self._busy -= 1
            self._changed.notify_all()

    def _spec(self, job: str) -> JobSpec | str:
        """The job's specification, or why there is none."""
        if job not in self._specs:
            reply = self._request("job", GetJob(self.name, job))
            if not isinstance(reply, JobSpec):
                return reply.reason if isinstance(reply, Refused) else "no answer"
            self._specs = {job: reply}  # one at a time is enough: slots mostly work on the same job
        return self._specs[job]

    # -- requests ---------------------------------------------------------------------------------------------

    def _request(
        self, kind: str, message: Request, once: bool = False, until_noted: bool = False
    ) -> Reply | None:
        """Say it until there is an answer that settles it; None where the worker stops without one.

        until_noted: say it even while stopping, for GIVE_UP_S at most.
        """
        pause_s, give_up = FIRST_PAUSE_S, 0.0
        while True:
            greeted = self._greeted
            reply = self._connection.ask(kind, message, self._hold_s + PATIENCE_S)
            if isinstance(reply, Refused) and reply.unknown and not once and self._hello(greeted):
                continue
            again = reply is None or (isinstance(reply, Refused) and (reply.again or reply.unknown))
            if isinstance(reply, Refused) and not again and kind in ("work", "answer"):
                self._refuse(reply.reason)
            if not again or once or self._refusal:
                return reply
            if self._stopping.is_set():
                give_up = give_up or time.monotonic() + GIVE_UP_S
                if not until_noted or time.monotonic() > give_up:
                    return reply
                time.sleep(pause_s)
            else:
                self._stopping.wait(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def _hello(self, greeted: int) -> bool:
        """Tell the scheduler who is here, unless another slot has since `greeted`; whether it knows."""
        with self._greeting:
            pause_s, reported, until = FIRST_PAUSE_S, False, time.monotonic() + TAKEN_S
            while self._greeted == greeted and not self._refusal:
                reply = self._connection.ask("hello", Hello(self.name, self._capabilities), PATIENCE_S)
                if isinstance(reply, Welcome):
                    self._hold_s = reply.hold_s
                    self._greeted += 1
                    self._report(f"worker {self.name} is connected, {self._capabilities.procs} processes")
                elif isinstance(reply, Refused) and (
                    not reply.again or (reply.taken and time.monotonic() > until)
                ):
                    self._refuse(reply.reason)
                elif self._stopping.is_set():
                    return False
                else:
                    if not reported:
                        why = reply.reason if isinstance(reply, Refused) else "no scheduler answers"
                        self._report(f"worker {self.name}: {why}; trying on")
                        reported = True
                    self._stopping.wait(pause_s)
                    pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            return not self._refusal

    def _refuse(self, reason: str) -> None:
        self._refusal = reason
        self._stopping.set()


class _SlotBench:
    """A slot's process, started when it is needed and again when it is lost."""

    def __init__(self, worker: Worker, index: int):
        self._worker = worker
        self._index = index
        self._runner: Runner | None = None

    @property
    def job(self) -> str:
        return self._runner.job if self._runner is not None else ""

    def run(self, lease: Lease) -> Answer | Failed:
        name, key = self._worker.name, lease.chunk
        try:
            if self._runner is None:
                self._runner = self._worker._new_runner(name)
            if self._runner.job != key.job:
                spec = self._worker._spec(key.job)
                wrong = self._runner.open(spec) if isinstance(spec, JobSpec) else spec
                if wrong:
                    self._worker._report(f"worker {name} refuses job {key.job}: {wrong}")
                    return Failed(name, lease.lease, key, wrong, refused=True)
            return self._runner.run(lease)
        except RunnerLost as error:
            self.close()
            self._worker._report(f"worker {name}, slot {self._index}: {error}")
            return Failed(name, lease.lease, key, str(error))

    def close(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None
