"""What was found of a job's preventability, kept in the run directory for reports.

    RUN/verdict/prevention-JOB.json    written whole, then moved into place

A file of another format, job, threshold or number of dangerous rollouts is not read.
"""

import contextlib
import os
import tempfile
from pathlib import Path
from urllib.parse import quote

import msgspec

from service.analysis.prevention.objects import FORMAT, Prevention


def path_of(run: Path, job: str) -> Path:
    return run / "verdict" / f"prevention-{quote(job, safe='')}.json"


def keep(run: Path, found: Prevention) -> None:
    """Write it; a run directory that cannot be written to goes without."""
    path = path_of(run, found.job)
    with contextlib.suppress(OSError):
        path.parent.mkdir(exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "wb") as out:
            out.write(msgspec.json.encode(found))
        os.replace(name, path)


def kept(run: Path, job: str, gamma: float, events: int) -> Prevention | None:
    """What is kept of a job, where it is of this threshold and of as many dangerous rollouts; None otherwise."""
    with contextlib.suppress(OSError, msgspec.MsgspecError, ValueError, RecursionError):
        found = msgspec.json.decode(path_of(run, job).read_bytes(), type=Prevention)
        if found.format == FORMAT and found.job == job and found.gamma == gamma and found.events == events:
            return found
    return None
