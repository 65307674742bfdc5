"""Payloads that are wrong in many ways: any JSON, right ones with parts changed, and bytes cut and flipped."""

from __future__ import annotations

import copy
import json
from typing import Any

from hypothesis import strategies as st

NASTY_TEXT = ["", "*", "**", "$*", "../..", "/etc/passwd", "a" * 5000, "\x00", "é\u202e", "nan", "inf", "-1", "1e999",
              "9" * 400, "os:system", "x.xml", "w.safetensors", "zenoh:" + "x" * 100, "[]", "{}", "null"]  # fmt: skip
NASTY_NUMBERS = [0, -1, 2**31, 2**63, 2**64, 10**30, 0.0, -0.0, 1e308, 5e-324, -1e-9]
text = st.sampled_from(NASTY_TEXT) | st.text(max_size=20)
scalars = (
    st.none() | st.booleans() | st.sampled_from(NASTY_NUMBERS) | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False) | text
)  # fmt: skip
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(text, inner, max_size=4),
    max_leaves=12,
)


@st.composite
def changed(draw: st.DrawFn, right: Any) -> Any:
    """`right` with one to three of its parts replaced, removed, doubled or added."""
    found = copy.deepcopy(right)
    for _ in range(draw(st.integers(1, 3))):
        places = list(_places(found))
        if not places:
            return draw(values)
        holder, key = places[draw(st.integers(0, len(places) - 1))]
        action = draw(st.integers(0, 9))
        if action < 6:
            holder[key] = draw(values)
        elif action < 8:
            del holder[key]
        elif isinstance(holder, list):
            holder.append(copy.deepcopy(holder[key]))
        else:
            holder[draw(text)] = draw(values)
    return found


def _places(value: Any):
    if isinstance(value, dict | list):
        for key in list(value) if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key])


@st.composite
def damaged(draw: st.DrawFn, right: bytes) -> bytes:
    """Bytes with some flipped, cut out or put in."""
    data = bytearray(right)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(len(data) - 1, 0)))
        action = draw(st.integers(0, 3))
        if action == 0 and data:
            data[at] = draw(st.integers(0, 255))
        elif action == 1:
            del data[at : at + draw(st.integers(1, 64))]
        elif action == 2:
            data[at:at] = draw(st.binary(max_size=16))
        else:
            del data[at:]
    return bytes(data)


def json_of(value: Any) -> bytes:
    return json.dumps(value).encode("utf-8", "surrogatepass")


def bodies(right: Any) -> st.SearchStrategy[bytes]:
    """Bodies of a request that takes `right`."""
    return (
        changed(right).map(json_of) | changed(right).map(json_of) | values.map(json_of)
        | damaged(json_of(right)) | st.binary(max_size=64)
    )  # fmt: skip


parameter = st.sampled_from(
    ["gamma", "confidence", "gammas", "low", "high", "steps", "limit", "after", "by", "examine", "phase", "iteration",
     "trace", "_raw", "x"]
) | text  # fmt: skip
parameters = st.lists(st.tuples(parameter, text | scalars.map(str)), max_size=4).map(
    lambda pairs: ";".join(f"{name}={value}" for name, value in pairs)
)
