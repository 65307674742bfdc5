"""The ego policies that tailroad brings, by name.

`idm` is code. The others are weights with their cards, in policies/weights: `ego-NAME.safetensors` is a network on the
51 values (policies.egos.lidar), `ego-NAME.onnx` one with a camera (policies.egos.vision). A file is all that another
ego of either kind takes.
"""

import difflib
import hashlib
from functools import lru_cache
from pathlib import Path

from policies.drivers import WEIGHTS_FOLDER, WeightsError, load_drivers
from policies.egos.idm import IdmEgo
from policies.egos.lidar import LidarEgo
from policies.egos.onnx_file import PREFIX as ONNX
from policies.egos.protocol import EgoPolicy
from policies.egos.vision import VisionEgo

LIDAR, VISION = ".safetensors", ".onnx"
_PREFIX = "ego-"


def ego_weights(name: str) -> Path | None:
    """The file of the weights that the ego of that name drives by; None for one without, or an unknown one."""
    return _weights().get(name)


def ego_digest(name: str) -> str:
    """SHA-256 of the weights that the ego of that name drives by, a file of the user's included; "" for one without."""
    path = Path(name.removeprefix(ONNX)) if name.startswith(ONNX) else ego_weights(name)
    if path is None:
        return ""
    if not path.is_file():
        raise WeightsError(f"{path}: no such file")
    stamp = path.stat()
    return _digest(path, stamp.st_mtime_ns, stamp.st_size)


def ego_names() -> list[str]:
    """Names that `load_ego` knows."""
    return sorted(["idm", *_weights()])


def load_ego(name: str) -> EgoPolicy:
    """A new ego policy of that name; ValueError for a name that is not known."""
    if name == "idm":
        return IdmEgo()
    path = ego_weights(name)
    if path is None:
        close = difflib.get_close_matches(name, ego_names(), 1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise ValueError(f"no ego named {name!r}; {hint}there are {', '.join(ego_names())}")
    ego: LidarEgo | VisionEgo = LidarEgo(load_drivers(path)) if path.suffix == LIDAR else VisionEgo(path)
    ego.name = name
    return ego


def _weights() -> dict[str, Path]:
    """The weights' files by the names of their egos."""
    found = sorted(WEIGHTS_FOLDER.glob(f"{_PREFIX}*"))
    return {path.stem.removeprefix(_PREFIX): path for path in found if path.suffix in (LIDAR, VISION)}


@lru_cache(maxsize=16)
def _digest(path: Path, _changed_ns: int, _size: int) -> str:
    """Of a file in the state that its time and size stand for."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
