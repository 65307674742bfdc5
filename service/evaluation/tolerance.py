"""When a job stops for failed rollouts: a black box may answer late, or nonsense, or not at all."""

from service.errors import TooManyFailures
from service.evaluation.failed_share import JUDGED_FROM, SHOWN, too_many
from service.evaluation.store import FAILED, Chunk


class Tolerance:
    """Counts a job's rollouts and the failed ones; the job goes on while their share is at most `max_failed`.

    max_failed: 0 stops at the first failure, 1 never stops.
    """

    def __init__(self, max_failed: float = 1.0):
        self.max_failed = max_failed
        self._rollouts = 0
        self._failed = 0
        self._first: list[str] = []

    def see(self, chunk: Chunk) -> None:
        """Count a chunk; TooManyFailures where the share is passed. Such a chunk is not to be recorded, so that its
        rollouts run again when the job is continued with the ego repaired."""
        failed = int((chunk.outcomes == FAILED).sum())
        rollouts = self._rollouts + chunk.stop - chunk.start
        if failed and self._failed + failed > self.max_failed * max(rollouts, JUDGED_FROM):
            row, reason = next(iter(sorted(chunk.errors.items())), (0, "no reason recorded"))
            raise TooManyFailures(
                f"{self._failed + failed} of {rollouts} rollouts failed, more than the share {self.max_failed:g} that "
                f"is tolerated; rollout {chunk.start + row}: {reason}. What was run before is kept: put the ego right "
                "and continue with --resume, or allow more with --max-failed"
            )
        self._failed += failed
        self._rollouts = rollouts
        for row, reason in sorted(chunk.errors.items())[: SHOWN - len(self._first)]:
            self._first.append(f"rollout {chunk.start + row}: {reason}")

    def end(self) -> None:
        """The job is at its end: TooManyFailures where the share is passed, or every rollout failed."""
        if told := too_many(self._failed, self._rollouts, self.max_failed, self._first, at_end=True):
            raise TooManyFailures(
                f"{told}. What was run is kept: put the ego right and start a new run, or allow more with --max-failed"
            )
