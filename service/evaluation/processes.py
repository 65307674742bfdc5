"""How worker processes of this one are started: from nothing, or as its forks.

Processes start from nothing, and without the program that started this one: a script needs no `if __name__ ==
"__main__"` then, and a worker does not load what it does not use. An ego that lives in this process (`service.world.
egos.here`) can only be driven in forks of it, which have it as it is.
"""

import multiprocessing
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext, SpawnContext, SpawnProcess
from types import ModuleType
from typing import Any

from service.world.egos.here import HERE, check_held

_hidden = threading.Lock()


class _Process(SpawnProcess):
    """A spawned process that does not import the main module again: what it runs lies in modules."""

    @staticmethod
    def _Popen(process_obj: Any) -> Any:
        with _without_main():
            return SpawnProcess._Popen(process_obj)  # type: ignore[attr-defined]


class _Context(SpawnContext):
    Process = _Process  # type: ignore[assignment]


def context_for(ego: str) -> BaseContext:
    """What worker processes that drive this ego are started with; InputError where no process could have it."""
    if ego.startswith(HERE):
        check_held(ego)
        return multiprocessing.get_context("fork")
    return _Context()


@contextmanager
def _without_main() -> Iterator[None]:
    """multiprocessing looks at the main module to tell a new process what to import; it finds an empty one here."""
    with _hidden:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main
