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
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

PACKAGES = ("ce", "policies", "service", "sumo_nets")
_COMPILED = re.compile(r"^\s*from policies\.jit import ", re.MULTILINE)
_IMPORT = re.compile(
    r"^\s*(?:from (?P<source>[\w.]+) import (?:\((?P<block>[^)]*)\)|(?P<line>.*))|import (?P<module>[\w.]+))",
    re.MULTILINE,
)


def kernel_sources(root: Path) -> list[Path]:
    """The files below `root` that decide compiled code: those that hold kernels, and all they import, in one order.

    A constant is compiled into the kernels that name it, so a file without a kernel counts as well where a kernel's
    file imports it, directly or through others.
    """
    texts = {
        path.relative_to(root): path.read_text(encoding="utf-8")
        for package in PACKAGES
        for path in (root / package).rglob("*.py")
    }
    found: set[Path] = set()
    waiting = [path for path, text in texts.items() if _COMPILED.search(text)]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += [other for other in _imported(texts[path]) if other in texts]
    return sorted(root / path for path in found)


def _imported(text: str) -> Iterator[Path]:
    """The files that the import statements of a source may mean, whether or not they exist."""
    for found in _IMPORT.finditer(text):
        base = Path(*(found["source"] or found["module"]).split("."))
        yield base.with_suffix(".py")
        yield base / "__init__.py"
        for name in (found["block"] or found["line"] or "").split(","):
            if words := name.split():
                yield base / f"{words[0]}.py"
                yield base / words[0] / "__init__.py"


def source_digest(root: Path) -> str:
    """A hash of numba's version and of all that decides compiled code below `root`: the same in every process."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in kernel_sources(root):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    digest = source_digest(Path(__file__).resolve().parents[1])
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for candidate in (Path(base), Path(tempfile.gettempdir()) / f"tailroad-{os.getuid()}"):
        folder = candidate / "tailroad" / f"kernels-{digest}"
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
