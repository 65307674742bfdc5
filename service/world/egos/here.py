"""Egos that are Python objects of this process: instances, and classes that no other process could import.

A job names one as `here:NAME`. What the name stands for is known in this process and in those forked from it, nowhere
else: it is never pickled, and a run that used it asks for it again when it is resumed.
"""

import importlib
import inspect
import os
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from policies.egos import EgoPolicy
from policies.egos.onnx_file import PREFIX as ONNX
from service.errors import InputError
from service.world.egos.settings import PYTHON_EGO, EgoSettings

HERE = "here:"
REMOTE = "zenoh:"
_made_by: dict[str, Callable[[], Any]] = {}


def ego_name(ego: Any, name: str | None = None) -> str:
    """What jobs call this ego.

    ego: a name, a class, a function that makes one, or one itself

    A name, and a class that another process can import, may run in any worker of this process; everything else is held
    here as `here:NAME` (name: instead of its own). InputError for what is no ego.
    """
    if isinstance(ego, str):
        permit(ego)
        return ego
    if inspect.isclass(ego) and name is None and _importable(ego):
        permit(known := f"{ego.__module__}:{ego.__qualname__}")
        return known
    make: Callable[[], Any]
    if inspect.isclass(ego):
        make, own = ego, ego.__name__
    elif callable(getattr(ego, "reset", None)) and callable(getattr(ego, "act", None)):
        make, own = lambda: ego, type(ego).__name__
    elif callable(ego):
        make, own = ego, getattr(ego, "__name__", type(ego).__name__)
    else:
        raise InputError(
            f"ego {ego!r:.200}: give a name, a class with reset and act, a function that makes one, or one itself"
        )
    held = HERE + (name or re.sub(r"[^A-Za-z0-9_]+", "", own) or "ego")
    _made_by[held] = make
    return held


def give_again(name: str, ego: Any) -> None:
    """The ego of a run that is gone on with; InputError where it is another than `name` says."""
    given = ego_name(ego)
    if given != name:
        raise InputError(
            f"the run was begun with ego {name!r}, and this one is {given!r}; give that one again"
        )


def permit(name: str) -> None:
    """Let this process and its workers import the class that MODULE:CLASS names, or read the file of onnx:FILE; whoever
    calls this may name it."""
    if name.startswith(ONNX):
        settings = EgoSettings.from_environment()
        file = name.removeprefix(ONNX)
        os.environ.update(replace(settings, onnx=settings.onnx | {file}).as_environment())
        return
    if PYTHON_EGO.fullmatch(name) and not name.startswith((HERE, REMOTE)):
        settings = EgoSettings.from_environment()
        os.environ.update(replace(settings, python=settings.python | {name}).as_environment())


def check_held(name: str) -> None:
    """InputError where this process does not hold the ego of that name."""
    if name not in _made_by:
        raise InputError(
            f"ego {name!r} lived in the Python process that began the run, and is never written down; give it again "
            "in Python, as in tailroad.resume(RUN, ego=MyEgo)"
        )


def make_held(name: str) -> EgoPolicy:
    """The ego that `here:NAME` stands for, a new one where a class or a function was given."""
    check_held(name)
    return _made_by[name]()


def _importable(kind: type) -> bool:
    """Whether another process finds the class by its module and name."""
    if kind.__module__ in ("__main__", "builtins") or not PYTHON_EGO.fullmatch(
        f"{kind.__module__}:{kind.__qualname__}"
    ):
        return False
    try:
        return getattr(importlib.import_module(kind.__module__), kind.__qualname__, None) is kind
    except ImportError:
        return False
