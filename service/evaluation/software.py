"""What decides bits besides a job: the code of the simulator and the estimators, and the libraries they stand on.

Not the version of tailroad: one that leaves this code as it is goes on with what another one began.
"""

import hashlib
import os
import re
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from policies.cache import cache_folder
from service.evaluation import sources
from service.evaluation.sources import code_alone

SOURCES = Path(__file__).resolve().parents[2]
MAKERS = (Path(__file__).resolve(), Path(sources.__file__).resolve())  # of digests
LIBRARIES = ("numpy", "numba", "scipy", "onnxruntime", "libsumo")
# The sources by part, as globs below SOURCES; a test looks that no compiled code is left out.
PARTS = {
    "world": (
        "service/world/agents.py",
        "service/world/paths/*.py",
        "service/world/scenario/*.py",
        "service/world/sensors/*.py",
        "service/world/sim/*.py",
        "sumo_nets/*.py",
    ),
    "camera": ("service/world/camera/*.py",),
    "drivers": ("policies/*.py",),
    "measures": ("service/world/safety/*.py",),
    "egos": ("policies/egos/*.py", "policies/baselines/idm_mobil.py", "service/world/egos/*.py"),
    "estimators": (
        "ce/**/*.py",
        "service/evaluation/evaluate.py",
        "service/evaluation/job.py",
        "service/evaluation/options.py",
        "service/evaluation/path_job.py",
        "service/evaluation/path_work.py",
        "service/evaluation/pool.py",
        "service/evaluation/store/draws.py",
    ),
}
# They make, show or export what there is, and no rollout calls them.
BESIDE = {
    "sumo_nets/asam_xml.py",
    "sumo_nets/build.py",
    "sumo_nets/drawn.py",
    "sumo_nets/opendrive.py",
    "sumo_nets/plot.py",
    "service/world/camera/export.py",
    "service/world/camera/sheet.py",
    "service/world/egos/sdk.py",
}
UNKNOWN = "none"
_DIGEST = re.compile(r"[0-9a-f]{16}")


class Software(msgspec.Struct, frozen=True):
    """What decides bits besides a job.

    code: 16 hexadecimal digits of each part's code
    libraries: versions by name
    """

    code: dict[str, str]
    libraries: dict[str, str]

    @property
    def digest(self) -> str:
        """16 hexadecimal digits of all of it."""
        return hashlib.sha256(msgspec.json.encode(self, order="deterministic")).hexdigest()[:16]

    def named(self) -> dict[str, str]:
        """As one table: libraries by name, code as "code of PART"."""
        return self.libraries | {f"code of {part}": digest for part, digest in self.code.items()}

    def differs_from(self, other: "Software") -> str:
        """What differs in a few words, as in "numpy 2.1.0 instead of 2.2.0", "" for nothing."""
        mine, theirs = self.named(), other.named()
        return ", ".join(
            f"{name} {mine.get(name, UNKNOWN)} instead of {theirs.get(name, UNKNOWN)}"
            for name in sorted(mine.keys() | theirs.keys())
            if mine.get(name) != theirs.get(name)
        )


@cache
def software() -> Software:
    """Of this installation; where its sources were seen before, their digests are on record."""
    return Software({part: _known(part) for part in PARTS}, {name: _version(name) for name in LIBRARIES})


def sources_of(part: str) -> list[Path]:
    """The files of a part, in one order."""
    found = {path for pattern in PARTS[part] for path in SOURCES.glob(pattern)}
    return sorted(path for path in found if path.relative_to(SOURCES).as_posix() not in BESIDE)


def _known(part: str) -> str:
    """The part's digest: from the record of contents that were read before, else made and put on record.

    To read sources as syntax trees takes a second, to hash their bytes a fiftieth of it. A record is named by the bytes
    of every source of the part, of their paths, and of the code that makes digests: it is a function of nothing else.
    """
    contents = [(path.relative_to(SOURCES).as_posix(), path.read_bytes()) for path in sources_of(part)]
    named = hashlib.sha256()
    for name, content in [("", path.read_bytes()) for path in MAKERS] + contents:
        named.update(f"{name} {len(content)} ".encode() + content)
    folder = cache_folder("software")
    if not folder:
        return _digest(contents)
    record = Path(folder) / named.hexdigest()
    with suppress(
        OSError, UnicodeDecodeError
    ):  # there is none yet, or none that can be read: it is made again
        if _DIGEST.fullmatch(found := record.read_text(encoding="ascii")):
            return found
    digest = _digest(contents)
    with suppress(OSError):  # a full disk, say: it is made again next time
        whole = record.with_name(f"{record.name}.{os.getpid()}")
        whole.write_text(digest, encoding="ascii")
        whole.replace(record)
    return digest


def _digest(contents: list[tuple[str, bytes]]) -> str:
    """Of sources by their paths: what they do, without what changes nothing."""
    digest = hashlib.sha256()
    for name, content in contents:
        code = code_alone(content.decode()).encode()
        digest.update(f"{name} {len(code)} ".encode())
        digest.update(code)
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
