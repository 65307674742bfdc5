"""Answers that take long: computed once in the background, remembered, and given to whoever asks again."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as Late
from typing import Any

from service.remote.api.problems import ApiError

KEPT = 64  # answers
RETRY_S = 1.0


class Background:
    """One thread and its last answers.

    wait_s: how long an asker waits before it is told to ask again
    most: that may wait to be computed
    """

    def __init__(self, wait_s: float, most: int = 16):
        self._wait_s, self._most = wait_s, most
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="api-background")
        self._lock = threading.Lock()
        self._known: OrderedDict[Hashable, Future[Any]] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """compute()'s result, once for each key; ApiError "working" while it takes, "busy" where too much waits."""
        with self._lock:
            future = self._known.get(key)
            if future is None:
                if sum(not f.done() for f in self._known.values()) >= self._most:
                    raise ApiError("busy", "too many long answers are being computed", retry_after_s=5.0)
                future = self._known[key] = self._pool.submit(compute)
            self._known.move_to_end(key)
            self._drop()
        try:
            return future.result(self._wait_s)
        except Late:
            if future.done():  # it raised one itself
                raise
            raise ApiError(
                "working", "the answer is being computed; ask again", retry_after_s=RETRY_S
            ) from None
        finally:
            if future.done() and future.exception() is not None:
                with self._lock:
                    if self._known.get(key) is future:
                        del self._known[key]

    def forget(self, key: Hashable) -> None:
        """Compute it anew when it is asked for again."""
        with self._lock:
            self._known.pop(key, None)

    def _drop(self) -> None:
        for key in [k for k, f in self._known.items() if f.done()][: max(0, len(self._known) - KEPT)]:
            del self._known[key]

    def close(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
