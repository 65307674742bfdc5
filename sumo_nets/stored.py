"""The lanes of a built-in road as they were read once, kept beside its net: the same bits on every processor.

Reading them from the net solves linear systems whose last bits depend on the processor, by up to 2e-8 m, and with
them a rollout's f by up to 1e-6 of itself. `python -m sumo_nets.build lanes --name NAME` writes the file anew.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from sumo_nets.errors import NetworkError

if TYPE_CHECKING:
    from sumo_nets.corridor import Corridor

NET_DIGEST = "net_sha256"


def store_lanes(corridor: Corridor, path: Path) -> Path:
    """Write a corridor's arrays and what net they were read from; NetworkError for a road with further rules."""
    if corridor.rules is not None:
        raise NetworkError(f"{corridor.net_path} has lanes with rules of their own, which are not kept")
    arrays: dict[str, Any] = {
        f.name: getattr(corridor, f.name) for f in fields(corridor) if f.name not in ("net_path", "rules")
    }
    arrays[NET_DIGEST] = _digest(Path(corridor.net_path))
    np.savez_compressed(path, **arrays)
    return path


def stored_lanes(path: Path, net: Path) -> dict[str, Any] | None:
    """The fields of a corridor but `net_path`; None where none are kept of just this net. NetworkError for a damaged
    file."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as kept:
            found = {name: kept[name] for name in kept.files}
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise NetworkError(
            f"{path} cannot be read ({error}); write it anew with `python -m sumo_nets.build lanes`"
        ) from error
    if str(found.pop(NET_DIGEST, "")) != _digest(net):
        return None
    return {
        name: value if value.ndim > 1 or name in ONE_A_STATION else value.tolist()
        for name, value in found.items()
    }


ONE_A_STATION = (
    "station_m", "ref_x", "ref_y", "ref_heading", "ref_curvature", "road_left", "road_right",
)  # fmt: skip


def _digest(net: Path) -> str:
    return hashlib.sha256(net.read_bytes()).hexdigest()
