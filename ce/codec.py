"""The bytes of states: MessagePack (msgspec), an array being a map of dtype, shape and raw little-endian bytes.

A state that is read back is the same to the bit. Bytes of another format, or of another problem, are refused.
"""

import hashlib
from dataclasses import fields
from typing import Any, TypeVar

import msgspec
import numpy as np

from ce.beta import Beta
from ce.errors import StateError
from ce.normal import Normal
from ce.product import Product
from ce.standard_normal import StandardNormal

FORMAT = 4

S = TypeVar("S", bound=msgspec.Struct)


def _encode_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return {"dtype": little.dtype.str, "shape": little.shape, "data": little.tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"cannot encode {type(value).__name__}")


def _decode_array(kind: type, value: Any) -> Any:
    array = np.frombuffer(value["data"], dtype=np.dtype(value["dtype"])).reshape(value["shape"])
    return array.astype(array.dtype.newbyteorder("="))


_encoder = msgspec.msgpack.Encoder(enc_hook=_encode_array)


def to_bytes(state: msgspec.Struct) -> bytes:
    """The state as MessagePack."""
    return _encoder.encode(state)


def from_bytes(data: bytes, kind: type[S], digest: str) -> S:
    """The state of that kind, checked to belong to the problem with that digest; StateError otherwise."""
    _refuse_other_formats(_format_of(data))
    try:
        state = msgspec.msgpack.decode(data, type=kind, dec_hook=_decode_array)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError) as error:
        raise StateError(f"these bytes are not a {kind.__name__}: {error}") from None
    if getattr(state, "digest", None) != digest:
        raise StateError(
            "the state belongs to another base distribution, gamma or options; give the same ones"
        )
    return state


class _Format(msgspec.Struct):
    """What every state of whatever version has."""

    format: int


def _format_of(data: bytes) -> int | None:
    try:
        return msgspec.msgpack.decode(data, type=_Format).format
    except (msgspec.MsgspecError, ValueError):
        return None


def _refuse_other_formats(found: int | None) -> None:
    if found not in (None, FORMAT):
        raise StateError(f"the state has format {found}, this version reads {FORMAT}")


def digest_of(base: Product, *rest: Any) -> str:
    """SHA-256 over the base distribution's numbers and whatever else defines the problem, in hexadecimal."""
    described: list[list[Any]] = []
    for b in base.blocks:
        if isinstance(b, Beta):
            described.append(["beta", b.alpha, b.beta, b.low, b.high])
        elif isinstance(b, StandardNormal):
            described.append(["standard-normal", b.mean])
        elif isinstance(b, Normal):
            described.append(["normal", b.mean, b.cov])
        else:
            names = [f.name for f in fields(b)]  # type: ignore[arg-type]
            described.append([type(b).__name__, *(getattr(b, name) for name in names)])
    return hashlib.sha256(_encoder.encode([described, *rest])).hexdigest()
