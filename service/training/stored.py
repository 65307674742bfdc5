"""What an interrupted training keeps on disk: MessagePack whose form is checked when it is read.

    save(path, value)                    # dataclasses, dicts, lists, arrays, tensors, networks
    value = load(path, tuple[Rows, Rows])

Arrays and tensors are stored as dtype, shape, memory order and bytes. Reading makes the types that the caller names and
no others: a file never chooses what code runs.
"""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from policies import layout as O
from service.errors import InputError
from service.training.network import DriverNet

ARRAY, TENSOR = 1, 2  # codes of MessagePack's extension types
KINDS = "fiub"  # of numpy's dtypes that may be stored: floats, integers, truth values


class _Array(msgspec.Struct, frozen=True, array_like=True):
    """An array's dtype (numpy's name of it), shape, whether its columns lie together (Fortran's order), and bytes."""

    dtype: str
    shape: tuple[int, ...]
    fortran: bool
    data: bytes


def save(path: Path, value: object) -> None:
    """Write `value` to `path`; an interruption leaves the file of before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_bytes(msgspec.msgpack.encode(value, enc_hook=_encoded))
    part.replace(path)


def load(path: Path, form: Any) -> Any:
    """The value of type `form` that `save` wrote to `path`. Raises InputError where the file holds anything else."""
    try:
        return msgspec.msgpack.decode(path.read_bytes(), type=form, ext_hook=_extension, dec_hook=_checked)
    except (msgspec.MsgspecError, TypeError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{path}: not what this training keeps when it is interrupted ({error}); delete the file and start the "
            "training again"
        ) from error


def _encoded(value: object) -> object:
    match value:
        case np.ndarray():
            return msgspec.msgpack.Ext(ARRAY, _bytes_of(value))
        case np.generic():
            return value.item()
        case torch.Tensor():
            return msgspec.msgpack.Ext(TENSOR, _bytes_of(value.detach().cpu().numpy()))
        case DriverNet():
            return dict(value.state_dict())
    raise NotImplementedError(f"a training cannot keep a {type(value).__name__}")


def _bytes_of(array: np.ndarray) -> bytes:
    fortran = array.flags.f_contiguous and not array.flags.c_contiguous
    form = _Array(array.dtype.str, array.shape, fortran, array.tobytes(order="F" if fortran else "C"))
    return msgspec.msgpack.encode(form)


def _extension(code: int, data: memoryview) -> np.ndarray | torch.Tensor:
    if code not in (ARRAY, TENSOR):
        raise ValueError(f"extension {code} of MessagePack is neither an array nor a tensor")
    form = msgspec.msgpack.decode(data, type=_Array)
    dtype = np.dtype(form.dtype)
    if dtype.kind not in KINDS:
        raise ValueError(f"an array of {dtype} is not stored here")
    flat = np.frombuffer(form.data, dtype)
    array = flat.reshape(form.shape, order="F" if form.fortran else "C").copy(order="K")
    return torch.from_numpy(array) if code == TENSOR else array


def _checked(kind: type, value: Any) -> Any:
    """A custom type of the form from what was stored for it."""
    if kind is DriverNet and isinstance(value, dict):
        net = DriverNet(np.zeros(O.OBSERVATION_SIZE), np.ones(O.OBSERVATION_SIZE))
        net.load_state_dict(value)
        return net
    if not isinstance(value, kind):
        raise ValueError(f"expected {kind.__name__}, found {type(value).__name__}")
    return value
