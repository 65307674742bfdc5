"""Progress bars on standard error, off when it is not a terminal."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from service.analysis.run.progress import Progress as Told
from service.analysis.run.progress import by_job

stderr = Console(stderr=True)


class RateColumn(ProgressColumn):
    """Rollouts a second over the last half minute."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.0f}/s" if task.speed else "", style="cyan")


def progress_bar(threaded: bool = True) -> Progress:
    """A progress bar with counts, rate and time remaining.

    threaded: drawn again ten times a second by a thread of its own, else by whoever tells it something
    """
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        RateColumn(),
        TimeElapsedColumn(),
        TextColumn("eta"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
        console=stderr,
        auto_refresh=threaded,
        redirect_stdout=threaded,
        redirect_stderr=threaded,
        disable=not stderr.is_terminal,
    )


@contextmanager
def counted(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar for what is counted, told of (done, total)."""
    with progress_bar() as bar:
        task = bar.add_task(what, total=None, note="")
        yield lambda done, total: bar.update(task, completed=done, total=total)


class Shown:
    """Shows how far a run is: a bar for each job, or, where there is no terminal, a line as each begins.

    name: what a bar is called, of the job
    """

    def __init__(self, bar: Progress, workers: int, name: Callable[[Told], str] = by_job):
        self._bar, self._name = bar, name
        self._tasks: dict[tuple[str, str], TaskID] = {}
        self._starting = bar.add_task(f"starting {workers} workers", total=None, note="")

    def __call__(self, told: Told) -> None:
        key = str(told.path), told.job.id
        if key not in self._tasks:
            self._bar.update(self._starting, visible=False)
            self._tasks[key] = self._bar.add_task(self._name(told), total=told.total, note="")
            if not stderr.is_terminal:
                click.echo(
                    f"{self._name(told)}: at most {told.total:,} rollouts on {told.workers} workers, run {told.path}",
                    err=True,
                )
        drawn_here = not self._bar.live.auto_refresh
        self._bar.update(self._tasks[key], completed=told.rollouts, note=told.note, refresh=drawn_here)
