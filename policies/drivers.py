"""The driver model: a network with random last-layer weights xi ~ N(mu0, Sigma0), loaded from its weights file.

    model = load_drivers("drivers-bc")          # shipped with tailroad
    model = load_drivers("runs/mine.safetensors")

A weights file is a safetensors file with the arrays of `DriverModel` and, beside it, a JSON card of the same name
that says what the weights were trained on and how well they drive. An ego network is stored in the same way; its
`sigma0` is zero and its head's last two columns are unused, and its file says whether it has emergency braking.
"""

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import load_file, save_file

from policies.layout import HEAD_SIZE, HIDDEN_1, HIDDEN_2, OBSERVATION_SIZE

WEIGHTS_FOLDER = Path(__file__).parent / "weights"

_SHAPES: dict[str, tuple[tuple[int, ...], type]] = {
    "w1": ((OBSERVATION_SIZE, HIDDEN_1), np.float32),
    "b1": ((HIDDEN_1,), np.float32),
    "w2": ((HIDDEN_1, HIDDEN_2), np.float32),
    "b2": ((HIDDEN_2,), np.float32),
    "mu0": ((HEAD_SIZE,), np.float64),
    "sigma0": ((HEAD_SIZE, HEAD_SIZE), np.float64),
    "action_scale": ((2,), np.float64),
}
_LOWER = "sigma0_lower"  # Sigma0 is symmetric: its lower triangle is stored, row by row
_EMERGENCY = "emergency"  # in the file's metadata
_STORED = ("w1", "b1", "w2", "b2", "mu0", _LOWER, "action_scale")


class WeightsError(ValueError):
    """A weights file that cannot be used: names the file, what was found, what was expected and what to do."""


@dataclass(frozen=True, eq=False)
class DriverModel:
    """A driver network (see policies.network) and the base distribution of its last layer.

    w1 (51, 200), b1 (200,), w2 (200, 100), b2 (100,) float32: the trunk; mu0 (404,), sigma0 (404, 404) float64: mean
    and covariance of the last layer's weights, symmetric positive definite (zero for an ego); action_scale (2,):
    m/s^2 and rad/s.

    card: the JSON card
    emergency: of an ego, whether braking and moving over in an emergency stand beside the network
        (policies.egos.emergency)
    """

    w1: np.ndarray
    b1: np.ndarray
    w2: np.ndarray
    b2: np.ndarray
    mu0: np.ndarray
    sigma0: np.ndarray
    action_scale: np.ndarray
    card: dict[str, Any]
    emergency: bool = False


def shipped() -> list[str]:
    """Names of the weights that come with tailroad."""
    return sorted(path.stem for path in WEIGHTS_FOLDER.glob("*.safetensors"))


def load_drivers(name_or_path: str | Path) -> DriverModel:
    """The model called `name_or_path` (see `shipped`), or that of a `.safetensors` file. Raises WeightsError."""
    path = weights_file(name_or_path)
    stamp = path.stat()
    return _load(path, stamp.st_mtime_ns, stamp.st_size)


@functools.lru_cache(maxsize=8)
def _load(path: Path, _changed_ns: int, _size: int) -> DriverModel:
    """The model of a file in the state that its time and size stand for."""
    try:
        arrays = load_file(path)
        with safe_open(path, "np") as file:
            said = file.metadata() or {}
    except (SafetensorError, OSError) as error:
        raise WeightsError(
            f"{path}: not a readable safetensors file ({error}); train one with 'tailroad train drivers'"
        ) from error
    missing = [key for key in _STORED if key not in arrays]
    if missing:
        raise WeightsError(f"{path}: arrays {missing} are missing; expected {list(_STORED)}")
    lower = arrays.pop(_LOWER).astype(np.float64)
    if lower.shape != (HEAD_SIZE * (HEAD_SIZE + 1) // 2,):
        raise WeightsError(
            f"{path}: {_LOWER} has shape {lower.shape}, expected "
            f"({HEAD_SIZE * (HEAD_SIZE + 1) // 2},): the lower triangle of a ({HEAD_SIZE}, {HEAD_SIZE}) matrix"
        )
    sigma0 = np.zeros((HEAD_SIZE, HEAD_SIZE))
    sigma0[np.tril_indices(HEAD_SIZE)] = lower
    sigma0 += np.tril(sigma0, -1).T
    arrays["sigma0"] = sigma0
    return _checked(path, arrays, _card(path), said.get(_EMERGENCY) == "yes")


def save_drivers(
    path: Path | str, arrays: dict[str, np.ndarray], card: dict, emergency: bool = False
) -> Path:
    """Write the arrays of a `DriverModel` and its card; returns the path of the weights.

    emergency: see `DriverModel`
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    stored: dict[str, np.ndarray] = {
        key: np.ascontiguousarray(value, dtype=_SHAPES[key][1]) for key, value in arrays.items()
    }
    stored[_LOWER] = stored.pop("sigma0")[np.tril_indices(HEAD_SIZE)]
    metadata = {"format": "tailroad-drivers-1"} | ({_EMERGENCY: "yes"} if emergency else {})
    save_file(stored, path, metadata=metadata)
    path.chmod(0o644)  # safetensors creates files that only their owner can read
    path.with_suffix(".json").write_text(json.dumps(card, indent=2) + "\n", encoding="utf-8")
    return path


def weights_file(name_or_path: str | Path) -> Path:
    given = Path(name_or_path)
    if given.suffix == ".safetensors":
        if not given.is_file():
            raise WeightsError(f"{given}: no such weights file")
        return given
    path = WEIGHTS_FOLDER / f"{name_or_path}.safetensors"
    if not path.is_file():
        raise WeightsError(
            f"no shipped weights are called '{name_or_path}'; there are {shipped()}, or give the path of a "
            ".safetensors file"
        )
    return path


def _card(path: Path) -> dict[str, Any]:
    card = path.with_suffix(".json")
    if not card.is_file():
        raise WeightsError(f"{path}: its card {card.name} is missing; weights without a card are not used")
    try:
        found = json.loads(card.read_text(encoding="utf-8"))
    except (
        ValueError,
        RecursionError,
    ) as error:  # not UTF-8, not JSON, a number of thousands of digits, nested too deeply
        raise WeightsError(f"{card}: not valid JSON ({error})") from error
    if not isinstance(found, dict):
        raise WeightsError(f"{card}: expected a JSON object, got {type(found).__name__}")
    return found


def _checked(path: Path, arrays: dict[str, np.ndarray], card: dict[str, Any], emergency: bool) -> DriverModel:
    values = {}
    for key, (shape, kind) in _SHAPES.items():
        array: np.ndarray = np.ascontiguousarray(arrays[key], dtype=kind)
        if array.shape != shape:
            raise WeightsError(f"{path}: {key} has shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise WeightsError(f"{path}: {key} holds values that are not finite; the training diverged")
        array.flags.writeable = False
        values[key] = array
    if (values["action_scale"] <= 0.0).any():
        raise WeightsError(f"{path}: action_scale must be positive, got {values['action_scale'].tolist()}")
    sigma0 = values["sigma0"]
    if sigma0.any():
        try:
            np.linalg.cholesky(sigma0)
        except np.linalg.LinAlgError as error:
            raise WeightsError(f"{path}: sigma0 is not positive definite; refit it") from error
    return DriverModel(**values, card=card, emergency=emergency)
