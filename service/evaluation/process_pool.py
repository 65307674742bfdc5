"""A pool of worker processes that survives the loss of any of them.

A worker that dies (killed, out of memory, a crash in native code) does not end the work: whatever was in flight is run
again alone, and a task that ends its process then, too, is run part by part, so that the one part that does it becomes
a result that says so, and all others get theirs.
"""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from typing import Any, Generic, Self, TypeVar

from service.errors import WorkerError
from service.evaluation.parent import end_with_parent

DIED = "the process that ran it died"
Task = TypeVar("Task")
Result = TypeVar("Result")
Part = TypeVar("Part")
Numbered = TypeVar("Numbered", bound=tuple[Any, ...])
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class TaskKind(Generic[Task, Result]):
    """What the workers of a pool do.

    run: in a worker; a function at a module's top level
    parts: of a task, those that cannot be divided further
    joined: the result of a task from those of its parts
    lost: the result of a part that has ended its process each time it was tried
    """

    run: Callable[[Task], Result]
    parts: Callable[[Task], Sequence[Task]]
    joined: Callable[[Sequence[Result]], Result]
    lost: Callable[[Task], Result]


def of_lists(
    run: Callable[[list[Part]], list[Outcome]], lost: Callable[[Part], Outcome]
) -> TaskKind[list[Part], list[Outcome]]:
    """Tasks that are lists of parts, and that have a result for each of them."""
    return TaskKind(
        run,
        parts=lambda task: [[part] for part in task],
        joined=lambda results: [one for result in results for one in result],
        lost=lambda task: [lost(part) for part in task],
    )


def _spawned() -> BaseContext:
    return multiprocessing.get_context("spawn")


class ProcessPool(Generic[Task, Result]):
    """Worker processes, started when they are first needed; they end with this process.

    workers: at most
    open_worker, arguments: called once in each worker process, before its first task
    context: what the processes are started with, asked for when they are
    """

    def __init__(
        self,
        workers: int,
        kind: TaskKind[Task, Result],
        open_worker: Callable[..., None],
        arguments: tuple = (),
        context: Callable[[], BaseContext] = _spawned,
    ):
        self.workers = workers
        self._kind = kind
        self._context = context
        self._opening = (open_worker, *arguments)
        self._executor: ProcessPoolExecutor | None = None

    def start(self) -> None:
        """Start the workers and let the first one compile the kernels for all; WorkerError where none can start."""
        try:
            self._started().submit(os.getpid).result()
        except BrokenProcessPool as error:
            raise WorkerError(
                "a worker process ended before its first rollout; its own message is above, or run one rollout with "
                "`tailroad rollout` to see it"
            ) from error

    def pids(self) -> list[int]:
        """The worker processes there are now."""
        return list(self._executor._processes or {}) if self._executor is not None else []

    def run(self, tasks: Iterable[Task], one_by_one: bool = False) -> Iterator[tuple[Task, Result]]:
        """Run the tasks; each is yielded with its result when it is done, in any order.

        one_by_one: for few tasks, which would be done before another process had started
        """
        at_once = 1 if one_by_one else 2 * self.workers
        waiting = list(reversed(list(tasks)))
        running: dict[Future[Result], Task] = {}
        if waiting and self._executor is None:
            self.start()
        while waiting or running:
            while waiting and len(running) < at_once:
                try:
                    running[self._started().submit(self._kind.run, waiting[-1])] = waiting[-1]
                except BrokenProcessPool:  # a worker died while nobody waited for it
                    if running:
                        break  # and what it held is found failed below
                    self._restart()
                else:
                    waiting.pop()
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            suspects: list[Task] = []
            for future in done:
                task = running.pop(future)
                try:
                    yield task, future.result()
                except BrokenProcessPool:
                    suspects.append(task)
            if suspects:
                # the other futures of a broken pool fail too; all of them are run again, one at a time
                suspects += running.values()
                running.clear()
                self._restart()
                for task in suspects:
                    yield task, self._run_alone(task)

    def close(self, kill: bool = False) -> None:
        """End the workers, at once or when they have done what they do; they are started again when needed again."""
        executor, self._executor = self._executor, None
        if executor is not None:
            processes = list(
                (executor._processes or {}).values()
            )  # forgotten by the executor when it is shut down
            executor.shutdown(wait=not kill, cancel_futures=True)
            for process in processes if kill else ():
                process.kill()

    def _started(self) -> ProcessPoolExecutor:
        if self._executor is None:
            self._executor = ProcessPoolExecutor(
                self.workers,
                mp_context=self._context(),
                initializer=_open_worker,
                initargs=self._opening,
            )
        return self._executor

    def _restart(self) -> None:
        self.close(kill=True)
        self.start()  # where no worker can start, that is the error, not the tasks

    def _run_alone(self, task: Task) -> Result:
        """Run a task while nothing else runs; where it ends its worker, part by part."""
        try:
            return self._started().submit(self._kind.run, task).result()
        except BrokenProcessPool:
            self._restart()
        parts = self._kind.parts(task)
        if len(parts) > 1:
            return self._kind.joined([self._run_alone(part) for part in parts])
        return self._kind.lost(task)


def _open_worker(open_worker: Callable[..., None], *arguments: object) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    open_worker(*arguments)


class OnProcesses(Generic[Task, Result]):
    """What runs tasks in worker processes; a context manager, whose end ends them, and at once after an error."""

    def __init__(self, processes: ProcessPool[Task, Result]):
        self._processes = processes

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._processes.close(kill=kind is not None)

    def close(self) -> None:
        """End the processes; they are started again when they are needed again."""
        self._processes.close()


class NumberedParts(OnProcesses[list[Numbered], list[Outcome]]):
    """What runs parts, tuples that begin with their number, several at once."""

    def _in_order(
        self,
        parts: Sequence[Numbered],
        at_once: int,
        on_done: Callable[[int], None],
        one_by_one: bool = False,
    ) -> list[Outcome]:
        """What each part came to, in their order.

        at_once: parts that a worker is given at once
        on_done: told how many more are done
        one_by_one: as of `ProcessPool.run`
        """
        found: dict[int, Outcome] = {}
        tasks = (list(parts[i : i + at_once]) for i in range(0, len(parts), at_once))
        for task, outcomes in self._processes.run(tasks, one_by_one):
            found |= {part[0]: one for part, one in zip(task, outcomes, strict=True)}
            on_done(len(task))
        return [found[part[0]] for part in parts]
