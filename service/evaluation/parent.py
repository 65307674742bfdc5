"""A process that ends with the one that started it, whose work nobody would read or use any more."""

import multiprocessing
import os
import threading
from contextlib import suppress
from multiprocessing.connection import wait


def end_with_parent(parent: int | None = None) -> None:
    """Let this process end at once when its parent does, however that ends.

    parent: the process's id; None: the process that multiprocessing has started this one from. A process of a pool does
    not see it by itself.
    """
    threading.Thread(target=_wait_and_end, args=(parent,), name="end-with-parent", daemon=True).start()


def _wait_and_end(parent: int | None) -> None:
    if parent is not None:
        with suppress(ProcessLookupError):  # it has ended already
            wait([os.pidfd_open(parent)])
    elif (starter := multiprocessing.parent_process()) is not None:
        wait([starter.sentinel])
    os._exit(1)
