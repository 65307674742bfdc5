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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from policies.cache import cache_folder

PACKAGES = ("ce", "policies", "service", "sumo_nets")
_COMPILED = re.compile(r"^\s*from policies\.jit import ", re.MULTILINE)
_WORDS = b"from policies.jit import "
_IMPORT = re.compile(
    r"^\s*(?:from (?P<source>[\w.]+) import (?:\((?P<block>[^)]*)\)|(?P<line>.*))|import (?P<module>[\w.]+))",
    re.MULTILINE,
)


def kernel_sources(root: Path) -> list[Path]:
    """The files below `root` that decide compiled code: those that hold kernels, and all they import, in one order.

    A constant is compiled into the kernels that name it, so a file without a kernel counts as well where a kernel's
    file imports it, directly or through others.
    """
    return sorted(root / path for path in _deciding(_texts(root)))


def _texts(root: Path) -> dict[str, bytes]:
    """Every source file of the packages below `root`: its path from there, with slashes -> what it holds."""
    found = {}
    for package in PACKAGES:
        for folder, _, names in os.walk(root / package):
            inside = folder[len(str(root)) + 1 :].replace(os.sep, "/")
            for name in names:
                if name.endswith(".py"):
                    with open(f"{folder}/{name}", "rb") as file:
                        found[f"{inside}/{name}"] = file.read()
    return found


def _deciding(texts: dict[str, bytes]) -> set[str]:
    """Those of the files that hold kernels, and all that they import."""
    found: set[str] = set()
    # looking for the plain words first takes a tenth of the time: every process does this when it starts
    waiting = [path for path, text in texts.items() if _WORDS in text and _COMPILED.search(text.decode())]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting += [other for other in _imported(texts[path].decode()) if other in texts]
    return found


def _imported(text: str) -> Iterator[str]:
    """The files that the import statements of a source may mean, whether or not they exist."""
    for found in _IMPORT.finditer(text):
        base = (found["source"] or found["module"]).replace(".", "/")
        yield f"{base}.py"
        yield f"{base}/__init__.py"
        for name in (found["block"] or found["line"] or "").split(","):
            if words := name.split():
                yield f"{base}/{words[0]}.py"
                yield f"{base}/{words[0]}/__init__.py"


def source_digest(root: Path) -> str:
    """A hash of numba's version and of all that decides compiled code below `root`: the same in every process."""
    digest = hashlib.sha256(numba.__version__.encode())
    texts = _texts(root)
    for path in sorted(_deciding(texts), key=lambda path: path.split("/")):
        digest.update(path.encode())
        digest.update(texts[path])
    return digest.hexdigest()[:16]


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = cache_folder(f"kernels-{source_digest(Path(__file__).resolve().parents[1])}")  # type: ignore[attr-defined]


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
