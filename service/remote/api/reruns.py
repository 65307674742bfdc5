"""Processes that run rollouts again, kept a while for the next question: who opens a failure opens another one soon,
and a process takes seconds to start."""

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec

from service.analysis.failures.rerun import Rerunner
from service.evaluation.job import Job


class Reruns:
    """Rerunners by job.

    procs: of each
    most: jobs whose processes wait unused
    idle_s: how long at most

    One that is in use is nobody else's: of two who ask for one job at a time each gets its own.
    """

    def __init__(
        self, procs: int, most: int, idle_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._procs, self._most, self._idle_s, self._clock = procs, most, idle_s, clock
        self._lock = threading.Lock()
        self._waiting: OrderedDict[bytes, tuple[float, Rerunner]] = OrderedDict()  # by job, since when
        self._timer: threading.Timer | None = None
        self._closed = False

    @contextmanager
    def of(self, job: Job) -> Iterator[Rerunner]:
        """A rerunner of the job; after an error its processes end."""
        key = msgspec.json.encode(job)
        with self._lock:
            _, rerunner = self._waiting.pop(key, (0.0, None))
        rerunner = rerunner or Rerunner(job, self._procs)
        try:
            yield rerunner
        except BaseException:
            rerunner.close()
            raise
        ended = []
        with self._lock:
            if key in self._waiting or self._closed:
                ended.append(rerunner)
            else:
                self._waiting[key] = self._clock(), rerunner
            while len(self._waiting) > self._most:
                ended.append(self._waiting.popitem(last=False)[1][1])
            self._look_later()
        for one in ended:
            one.close()

    def drop_idle(self) -> None:
        """End those that have waited too long."""
        with self._lock:
            self._timer = None
            until = self._clock() - self._idle_s
            old = [key for key, (since, _) in self._waiting.items() if since <= until]
            ended = [self._waiting.pop(key)[1] for key in old]
            self._look_later()
        for one in ended:
            one.close()

    def _look_later(self) -> None:
        if self._timer is None and self._waiting and not self._closed:
            self._timer = threading.Timer(self._idle_s, self.drop_idle)
            self._timer.daemon = True
            self._timer.start()

    def close(self) -> None:
        with self._lock:
            self._closed = True
            ended = [one for _, one in self._waiting.values()]
            self._waiting.clear()
            if self._timer is not None:
                self._timer.cancel()
        for one in ended:
            one.close()
