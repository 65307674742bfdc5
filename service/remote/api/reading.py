"""From the text of a request to checked values; ApiError names what was given and what was expected."""

import difflib
import math
import re
from typing import Any, TypeVar
from urllib.parse import unquote

import msgspec

from service.remote.api.problems import ApiError, Wrong, short

MAX_PARAMETERS = 32
MAX_TEXT = 32_000  # characters of all parameters together
WORDS = {"int": "a whole number", "float": "a number", "str": "text", "bool": "true or false", "array": "a list",
         "object": "an object"}  # for msgspec's names of kinds  # fmt: skip
T = TypeVar("T", bound=msgspec.Struct)


def parameters(text: str) -> dict[str, str]:
    """name=value, separated by ';' (Zenoh) or '&' (HTTP), percent-encoded or not. Names that begin with '_' are Zenoh's
    own and left out."""
    if len(text) > MAX_TEXT:
        raise ApiError("too-large", f"{len(text)} characters of parameters; give at most {MAX_TEXT}")
    found: dict[str, str] = {}
    for part in re.split("[;&]", text):
        name, _, value = part.partition("=")
        name, value = unquote(name), unquote(value)
        if not name or name.startswith("_"):
            continue
        if name in found:
            wrong = Wrong(short(name), short(value), "each parameter once")
            raise ApiError("bad-parameter", f"parameter {short(name)!r} is given twice", (wrong,))
        found[name] = value
        if len(found) > MAX_PARAMETERS:
            raise ApiError("bad-parameter", f"more than {MAX_PARAMETERS} parameters")
    return found


def checked(kind: type[T], given: dict[str, str]) -> T:
    """The parameters as a `kind`."""
    try:
        found = msgspec.convert(given, kind, strict=False)
    except msgspec.ValidationError as error:
        raise _complaint("bad-parameter", str(error), given, kind) from error
    _refuse_unusable(msgspec.structs.asdict(found), "bad-parameter")
    return found


def body(kind: type[T], payload: bytes) -> T:
    """The JSON of a request's body as a `kind`."""
    try:
        found = msgspec.json.decode(payload, type=kind)
    except msgspec.ValidationError as error:
        raise _complaint("bad-body", str(error), None, kind) from error
    except (msgspec.DecodeError, ValueError) as error:
        raise ApiError("bad-body", f"not JSON: {short(str(error))}") from error
    except RecursionError as error:
        raise ApiError("bad-body", "nested too deeply") from error
    try:
        _refuse_unusable(msgspec.structs.asdict(found), "bad-body")
    except RecursionError as error:
        raise ApiError("bad-body", "nested too deeply") from error
    return found


def _complaint(
    problem: str, message: str, given: dict[str, str] | None, kind: type[msgspec.Struct]
) -> ApiError:
    """msgspec's message as ours."""
    match = re.match(r"(?P<what>.*?)(?: - at `\$?\.?(?P<path>.*)`)?$", message, re.S)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    known = [field.encode_name for field in msgspec.structs.fields(kind)]
    if unknown := re.match(r"Object contains unknown field `(.*)`", what, re.S):
        name = unknown[1]
        close = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(known) or 'none'}"
        wrong = Wrong(short(name), short(given[name]) if given else "", f"no such parameter; {hint}")
        return ApiError(problem, f"unknown parameter {short(name)!r}; {hint}", (wrong,))
    if missing := re.match(r"Object missing required field `(.*)`", what):
        wrong = Wrong(missing[1], "", "must be given")
        return ApiError(problem, f"{missing[1]!r} is missing", (wrong,))
    value = short(repr(given[path])) if given and path in given else ""
    expected = re.sub(
        r"\w+", lambda word: WORDS.get(word[0], word[0]), what[:1].lower() + what[1:].replace("`", "")
    )
    where = f"{short(path)}" if path else "the body"
    shown = f" is {value}" if value else ""
    return ApiError(
        problem, f"{where}{shown}: {short(expected)}", (Wrong(short(path), value, short(expected)),)
    )


def _refuse_unusable(value: Any, problem: str, name: str = "") -> None:
    """No number that is not finite or does not fit into 64 bits."""
    if isinstance(value, dict):
        for key, item in value.items():
            _refuse_unusable(item, problem, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _refuse_unusable(item, problem, f"{name}[{index}]")
    elif isinstance(value, float) and not math.isfinite(value):
        wrong = Wrong(short(name), str(value), "a finite number")
        raise ApiError(problem, f"{short(name)} is {value}: give a finite number", (wrong,))
    elif isinstance(value, int) and value.bit_length() > 63:
        wrong = Wrong(short(name), f"an integer of {value.bit_length()} bits", "a number below 9e18")
        raise ApiError(problem, f"{short(name)} is too large: give a number below 9e18", (wrong,))
