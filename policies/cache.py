"""Where what can be made again is kept between processes: the user's cache, or a temporary folder of the user's."""

import os
import tempfile
from pathlib import Path


def cache_folder(name: str) -> str:
    """A folder of that name that this user can write to, made where it is missing; "" where there is none."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for candidate in (Path(base), Path(tempfile.gettempdir()) / f"tailroad-{os.getuid()}"):
        folder = candidate / "tailroad" / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return str(folder)
    return ""
