"""How much a client may ask of the service."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What all clients together may ask for, and one of them.

    body_bytes: of a request
    requests_per_s, submissions_per_s: of all clients together, `burst` times as many at once
    client_requests_per_s: of one client, known by its certificate and host; 1e9: as all together
    open_jobs: not over
    client_open_jobs: of one client
    open_bytes: memory that open jobs may hold together, beyond which jobs wait
    budget: rollouts of a job
    batch_rows: of a batch, as all of it is held in memory
    pending: requests that wait for an answer
    threads: that answer
    examine: dangerous rollouts that are run again for one answer
    rerun_procs: processes that do
    rerun_jobs: jobs whose processes wait for the next such question, for rerun_idle_s at most
    wait_s: for an answer that is being computed
    camera_pictures: of one rollout, camera_width_px wide
    compared: jobs in one comparison
    answer_bytes: of a file
    """

    body_bytes: int = 1_000_000
    requests_per_s: float = 200.0
    submissions_per_s: float = 20.0
    burst: float = 5.0
    client_requests_per_s: float = 1e9
    open_jobs: int = 1000
    client_open_jobs: int = 1000
    open_bytes: int = 4_000_000_000
    budget: int = 100_000_000
    batch_rows: int = 100_000
    pending: int = 256
    threads: int = 4
    examine: int = 400
    rerun_procs: int = 1
    rerun_jobs: int = 2
    rerun_idle_s: float = 60.0
    wait_s: float = 4.0
    camera_pictures: int = 100
    camera_width_px: int = 480
    compared: int = 6
    answer_bytes: int = 64_000_000

    def examined(self, asked: int | None) -> int:
        """Dangerous rollouts that are run again where so many were asked for; None: as many as may be."""
        return min(asked or self.examine, self.examine)


class Bucket:
    """Lets `rate` a second through, up to `burst` seconds' worth at once."""

    def __init__(self, rate: float, burst: float, clock: Callable[[], float] = time.monotonic):
        self._rate, self._most, self._clock = rate, max(1.0, rate * burst), clock
        self._left, self._at = self._most, clock()
        self._lock = threading.Lock()

    def wait_s(self) -> float:
        """0 where one more may pass now, else the seconds until it may."""
        with self._lock:
            now = self._clock()
            self._left = min(self._most, self._left + (now - self._at) * self._rate)
            self._at = now
            if self._left >= 1.0:
                self._left -= 1.0
                return 0.0
            return (1.0 - self._left) / self._rate
