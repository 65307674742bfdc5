"""submitit's jobs, of Slurm or of this machine, as an Executor.

submitit hands each call to a job of the batch system, which is dear: calls that wait are dealt out to as many jobs as
may run at once, so that a batch of a thousand chunks takes `jobs` of them. The world that a job opens for its first
chunk serves the others. submitit itself is the caller's: nothing of it is imported here.
"""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any, Protocol, TypeVar

T = TypeVar("T")
Call = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
Outcome = tuple[bool, Any]  # whether it came to its end; its result, or what it raised


class SubmititJob(Protocol):
    """What is needed of a submitit.Job."""

    def done(self) -> bool: ...
    def result(self) -> Any: ...


class Submitit(Protocol):
    """What is needed of a submitit.Executor."""

    def submit(self, fn: Callable[..., Any], *arguments: Any) -> SubmititJob: ...


class SubmititExecutor(Executor):
    """An Executor that runs its calls in jobs of submitit; use as a context manager, or shut it down.

    executor: a submitit.AutoExecutor or its like; its parameters (partition, time, memory) say what a job gets
    jobs: that run at once, at most
    poll_s: between two looks at the jobs, which batch systems answer by being asked

    >>> import submitit, tailroad  # doctest: +SKIP
    >>> slurm = submitit.AutoExecutor("logs")  # doctest: +SKIP
    >>> slurm.update_parameters(timeout_min=60, cpus_per_task=1)  # doctest: +SKIP
    >>> with tailroad.SubmititExecutor(slurm, jobs=50) as executor:  # doctest: +SKIP
    ...     run = tailroad.estimate("i80-10s", gamma=0.5, budget=100_000, executor=executor)
    """

    def __init__(self, executor: Submitit, jobs: int, poll_s: float = 1.0):
        self._executor, self._jobs, self._poll_s = executor, jobs, poll_s
        self._lock = threading.Lock()
        self._waiting: deque[tuple[Future, Call]] = deque()
        self._running: list[tuple[SubmititJob, list[Future]]] = []
        self._ended, self._wake = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve, name="submitit", daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Hand over a call; RuntimeError after `shutdown`."""
        future: Future[T] = Future()
        with self._lock:
            if self._ended.is_set():
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._waiting.append((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more calls; those that were taken are run, or cancelled where no job has them yet."""
        with self._lock:
            self._ended.set()
            self._wake.set()
            if cancel_futures:
                for future, _ in self._waiting:
                    future.cancel()
        if wait:
            self._thread.join()

    def _serve(self) -> None:
        """Deal out and collect, until there is nothing left and nothing more can come."""
        while True:
            with self._lock:
                over = self._ended.is_set() and not self._waiting and not self._running
            if over:
                return
            self._wake.wait(self._poll_s)
            self._wake.clear()
            self._collect()
            self._deal()

    def _collect(self) -> None:
        """Hand on what jobs that are over came to."""
        for one in [one for one in self._running if one[0].done()]:
            self._running.remove(one)
            job, futures = one
            try:
                outcomes: list[Outcome] = job.result()
            except Exception as error:
                _fail(futures, error)
                continue
            for future, (well, found) in zip(futures, outcomes, strict=True):
                future.set_result(found) if well else future.set_exception(found)

    def _deal(self) -> None:
        """Deal out the calls that wait evenly to the jobs that may still begin."""
        free = self._jobs - len(self._running)
        while free > 0:
            with self._lock:
                taken = [self._waiting.popleft() for _ in range(-(-len(self._waiting) // free))]
            if not taken:
                return
            begun = [(future, call) for future, call in taken if future.set_running_or_notify_cancel()]
            if begun:
                futures = [future for future, _ in begun]
                try:
                    job = self._executor.submit(run_calls, [call for _, call in begun])
                except Exception as error:
                    _fail(futures, error)
                else:
                    self._running.append((job, futures))
            free -= 1


def run_calls(calls: list[Call]) -> list[Outcome]:
    """Run the calls one after the other, in the process of a job; what each came to."""
    outcomes: list[Outcome] = []
    for call, arguments, named in calls:
        try:
            outcomes.append((True, call(*arguments, **named)))
        except Exception as error:
            outcomes.append((False, error))
    return outcomes


def _fail(futures: list[Future], error: Exception) -> None:
    """Tell the calls of a job that did not come to its end."""
    for future in futures:
        broken = BrokenExecutor(f"a job of submitit ended before its work did: {error}")
        broken.__cause__ = error
        future.set_exception(broken)
