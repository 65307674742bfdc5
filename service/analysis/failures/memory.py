"""What rollouts came to when they were run again, kept in the run directory: asking once more costs nothing.

    RUN/failures/JOB.msgpack    by iteration and row; written whole, then moved into place

A file of another job, another version of tailroad or another MEMORY_FORMAT is not read.
"""

import contextlib
import hashlib
import os
import tempfile
from importlib.metadata import version
from pathlib import Path
from urllib.parse import quote

import msgspec

from service.analysis.failures.lapses import Lapse
from service.analysis.failures.motion import Motion
from service.analysis.failures.rerun import Rerun
from service.evaluation.job import Job
from service.world.safety.contact import Contact

MEMORY_FORMAT = 3  # to be raised whenever `Motion`, `Contact`, `Lapse` or how they are measured change
Key = tuple[int, int]  # iteration, row


class _Seen(msgspec.Struct, frozen=True, array_like=True):
    iteration: int
    row: int
    recorded_f: float
    f: float
    outcome: str
    error: str | None
    motion: Motion | None
    contact: Contact | None
    lapse: Lapse | None


class _File(msgspec.Struct, frozen=True):
    key: str
    seen: list[_Seen]


class Memory:
    """The remembered rollouts of a job; of none where `folder` is None."""

    def __init__(self, job: Job, folder: Path | None):
        self._path = None if folder is None else folder / "failures" / f"{quote(job.id, safe='')}.msgpack"
        self._key = hashlib.sha256(
            msgspec.msgpack.encode((MEMORY_FORMAT, version("tailroad"), job), order="deterministic")
        ).hexdigest()
        self._seen: dict[Key, _Seen] = {}
        if self._path is not None:
            # a damaged file is as good as none
            with contextlib.suppress(OSError, msgspec.MsgspecError, ValueError, RecursionError):
                file = msgspec.msgpack.decode(self._path.read_bytes(), type=_File)
                if file.key == self._key:
                    self._seen = {(s.iteration, s.row): s for s in file.seen}

    def get(self, key: Key, f: float) -> Rerun | None:
        """What the rollout came to, where it is known for this value on record."""
        seen = self._seen.get(key)
        if seen is None or seen.recorded_f != f:
            return None
        return Rerun(
            seen.f, seen.outcome, seen.error, motion=seen.motion, contact=seen.contact, lapse=seen.lapse
        )

    def add(self, key: Key, f: float, again: Rerun) -> None:
        self._seen[key] = _Seen(
            *key, f, again.f, again.outcome, again.error, again.motion, again.contact, again.lapse
        )

    def save(self) -> None:
        """Write the file; a run directory that cannot be written to goes without."""
        if self._path is None:
            return
        content = msgspec.msgpack.encode(_File(self._key, [self._seen[k] for k in sorted(self._seen)]))
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self._path.parent)
            with os.fdopen(handle, "wb") as out:
                out.write(content)
            os.replace(name, self._path)
