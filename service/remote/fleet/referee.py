"""A replay on the scheduler's own machine, which settles what workers disagree on."""

import threading

from service.evaluation.store import Chunk
from service.remote.fleet.answers import chunk_of
from service.remote.fleet.messages import Answer, BadMessage, JobSpec, Lease
from service.remote.fleet.runner import Runner, RunnerLost

NAME = "the-scheduler"


class Referee:
    """One process that runs chunks, started when there is the first dispute. May be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._runner: Runner | None = None

    def replay(self, spec: JobSpec, lease: Lease) -> Chunk | str:
        """The chunk, or why it cannot be run here."""
        with self._lock:
            try:
                if self._runner is None:
                    self._runner = Runner(NAME)
                if self._runner.job != spec.job and (wrong := self._runner.open(spec)):
                    return wrong
                answer = self._runner.run(lease)
                return chunk_of(answer) if isinstance(answer, Answer) else answer.reason
            except (RunnerLost, BadMessage) as error:
                self._end()
                return str(error)

    def close(self) -> None:
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._runner is not None:
            self._runner.close()
            self._runner = None
