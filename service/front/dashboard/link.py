"""The dashboard's line to the service: answers are asked for in threads and remembered for a moment, once for all
browsers; and somebody always watches whether the service is there."""

import asyncio
import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from service.remote.client import Client, NoAnswer, Refused

log = logging.getLogger("tailroad.dashboard")

T = TypeVar("T")
THREADS = 8  # some wait for answers that take a while
KEPT = 1000  # answers
MOMENT_S = 1.0
FOR_GOOD_S = 3600.0  # an answer that does not change any more
WELL_S, LOST_S = 5.0, 1.0  # between two looks at the service, while it answers and while it does not


class Link:
    """Asks through a client, which must not wait for long answers.

    changed: called in a thread with whether the service is there, each time that this changes or another service
        answers in its place
    """

    def __init__(self, client: Client, changed: Callable[[bool], None] = lambda here: None):
        self._client, self._changed = client, changed
        self._pool = ThreadPoolExecutor(THREADS, thread_name_prefix="dashboard-asks")
        self._known: OrderedDict[Hashable, tuple[float, bool, asyncio.Future[Any]]] = OrderedDict()
        self._stopping = threading.Event()
        self._look_now = threading.Event()
        self._here: bool | None = None
        self._reason = "the service has not been asked yet"
        self._uptime_s = 0.0
        self._began = 0  # counts services seen
        self._watcher = threading.Thread(target=self._watch, name="dashboard-link", daemon=True)

    def start(self) -> None:
        self._watcher.start()

    @property
    def here(self) -> bool | None:
        """Whether the service answers; None: not known yet."""
        return self._here

    @property
    def reason(self) -> str:
        """Why it does not."""
        return self._reason

    async def ask(self, key: Hashable, ask: Callable[[Client], T], keep_s: float = MOMENT_S) -> T:
        """ask(client), or what it answered less than keep_s ago under the same key; Refused, NoAnswer."""
        if self._here is False:
            raise NoAnswer(self._reason)
        key = self._began, key
        now = time.monotonic()
        until, _, known = self._known.get(key, (0.0, True, None))
        if known is None or now >= until or (known.done() and known.exception() is not None):
            known = asyncio.get_running_loop().run_in_executor(self._pool, self._asked, ask)
            self._known[key] = now + keep_s, keep_s <= MOMENT_S, known
            known.add_done_callback(lambda future: future.exception())  # told to whoever awaits it
            self._drop()
        self._known.move_to_end(key)
        return await asyncio.shield(known)

    async def once(self, ask: Callable[[Client], T]) -> T:
        """ask(client), which is not remembered."""
        if self._here is False:
            raise NoAnswer(self._reason)
        return await asyncio.get_running_loop().run_in_executor(self._pool, self._asked, ask)

    async def order(self, ask: Callable[[Client], T]) -> T:
        """ask(client), which changes something: what was remembered is forgotten."""
        try:
            return await self.once(ask)
        finally:
            self._known.clear()

    def forget_passing(self) -> None:
        """Something has changed: what was to be remembered for a moment only is not, even while it is being asked."""
        for key in [key for key, (_, passing, _) in self._known.items() if passing]:
            del self._known[key]

    def _asked(self, ask: Callable[[Client], T]) -> T:
        try:
            return ask(self._client)
        except NoAnswer:
            self._look_now.set()
            raise

    def _drop(self) -> None:
        while len(self._known) > KEPT:
            self._known.popitem(last=False)

    def _watch(self) -> None:
        while not self._stopping.is_set():
            self._look()
            self._look_now.wait(WELL_S if self._here else LOST_S)
            self._look_now.clear()

    def _look(self) -> None:
        try:
            uptime_s = self._client.health().uptime_s
        except NoAnswer as error:
            self._found(False, str(error))
        except Refused as error:
            self._found(error.kind != "unavailable", str(error))
        except Exception as error:  # a fault of ours must not end the watch
            log.exception("looking at the service")
            self._found(False, f"the dashboard failed: {error}")
        else:
            if uptime_s < self._uptime_s:  # another service in place of the one before
                self._here = None
            self._uptime_s = uptime_s
            self._found(True, "")

    def _found(self, here: bool, reason: str) -> None:
        before, self._here, self._reason = self._here, here, reason
        if before is not here:
            self._began += here
            log.log(logging.INFO if here else logging.WARNING, "the service answers" if here else reason)
            self._changed(here)

    def close(self) -> None:
        self._stopping.set()
        self._look_now.set()
        self._pool.shutdown(wait=False, cancel_futures=True)
