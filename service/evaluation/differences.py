"""Where two jobs differ: the first field by its path, with both values."""

from typing import Any

import msgspec

from service.evaluation.job import Job

TOLD_APART_BY_OTHERS = (
    "tailroad",
)  # a version says nothing: what decides bits is in `service.evaluation.software`
SHOWN = 100  # characters of a value


class Difference(msgspec.Struct, frozen=True):
    """A field that has another value.

    path: as in scenario.time.step_s
    then, now: the values as JSON, shortened
    """

    path: str
    then: str
    now: str


def first_difference(then: Job, now: Job) -> Difference | None:
    """The first field, in the order of a job's, that differs; None for the same question."""
    for name, value in msgspec.to_builtins(then).items():
        if name not in TOLD_APART_BY_OTHERS:
            found = _differs(name, value, msgspec.to_builtins(getattr(now, name)))
            if found is not None:
                return found
    return None


def _differs(path: str, then: Any, now: Any) -> Difference | None:
    if isinstance(then, dict) and isinstance(now, dict):
        keys = [*then, *(key for key in now if key not in then)]
        pairs = [(f"{path}.{key}", then.get(key), now.get(key)) for key in keys]
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = [(f"{path}[{i}]", a, b) for i, (a, b) in enumerate(zip(then, now, strict=True))]
    else:
        return None if _json(then) == _json(now) else Difference(path, _shown(then), _shown(now))
    return next((found for found in (_differs(*pair) for pair in pairs) if found is not None), None)


def _json(value: Any) -> bytes:
    return msgspec.json.encode(value)


def _shown(value: Any) -> str:
    text = _json(value).decode()
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
