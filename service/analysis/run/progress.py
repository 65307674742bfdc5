"""How far a run is, and who is told."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import ce
from service.evaluation.job import Job


@dataclass(frozen=True)
class Progress:
    """How far a run is.

    job: that runs
    path: the run directory
    workers: processes
    rollouts: of the job so far
    total: rollouts of the job at most
    more: rollouts since it was told last
    record: of the last batch, None before the first
    """

    job: Job
    path: Path
    workers: int
    rollouts: int
    total: int
    more: int = 0
    record: ce.TrainingRecord | ce.EstimationRecord | None = None

    @property
    def note(self) -> str:
        """The last batch in a few words."""
        if isinstance(self.record, ce.TrainingRecord):
            return f"search {self.record.iteration + 1}: gamma_k {self.record.gamma_k:.3g}, ESS {self.record.ess:.0f}"
        if self.record is not None:
            return f"p = {self.record.p:.3g} [{self.record.low:.2g}, {self.record.high:.2g}]"
        return ""


Tell = Callable[[Progress], None]


def tell_nobody(progress: Progress) -> None:
    pass


def by_job(progress: Progress) -> str:
    """The job's id, as the name of its bar."""
    return progress.job.id


@contextmanager
def told(progress: Tell | bool, workers: int, name: Callable[[Progress], str] = by_job) -> Iterator[Tell]:
    """Whom to tell of a run: the function given; with True a bar on standard error, where that is a terminal.

    name: of a job's bar
    """
    if callable(progress):
        yield progress
    elif progress and sys.stderr.isatty():
        from service.analysis.run.bars import Shown, progress_bar

        # drawn when something is told and by no thread: the run may fork this process
        with progress_bar(threaded=False) as bar:
            yield Shown(bar, workers, name)
    else:
        yield tell_nobody
