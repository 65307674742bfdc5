"""How the compiled kernels are compiled: one decorator, the same flags everywhere.

A rollout has to give the same bits on every worker, so `fastmath` stays off (it lets the compiler reorder and
contract floating-point operations by processor) and kernels call `policies.exactmath` instead of the C library,
whose functions differ in the last bit between processors.

Compiled code is kept in one folder for each state of the kernels' sources: numba itself notices a change of a
function's own file but not of the files that it calls. The folder lies in the user's cache, so it also works
where the installation is read-only.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

KERNEL_FOLDERS = (
    "policies", "policies/baselines", "service/sim", "service/sensors", "service/camera", "service/safety",
    "service/realism",
)  # fmt: skip


def _source_digest() -> str:
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256(numba.__version__.encode())
    for folder in KERNEL_FOLDERS:
        for path in sorted((root / folder).glob("*.py")):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for candidate in (Path(base), Path(tempfile.gettempdir()) / f"tailroad-{os.getuid()}"):
        folder = candidate / "tailroad" / f"kernels-{_source_digest()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return ""


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = _cache_folder()  # type: ignore[attr-defined]


def kernel(function: Callable) -> Any:
    """Compile `function` with numba: cached on disk, IEEE arithmetic, division by zero as in numpy."""
    return numba.njit(cache=True, error_model="numpy", fastmath=False)(function)


def bare(function: Callable) -> Any:
    """As `kernel`, for functions that allocate nothing: they are compiled without numba's counting of references.

    Arrays that such functions hand on to each other are then plain pointers; in the camera's loops over thousands of
    polygons the counting took four fifths of the time. An allocation in one is an error when it is compiled.
    """
    options: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": False, "_nrt": False}
    return numba.njit(**options)(function)
