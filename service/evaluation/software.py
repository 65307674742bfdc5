"""What decides bits besides a job: the code of the simulator and the estimators, and the libraries they stand on.

Not the version of tailroad: one that leaves this code as it is goes on with what another one began.
"""

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from service.evaluation.sources import code_alone

SOURCES = Path(__file__).resolve().parents[2]
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
    "sumo_nets/build.py",
    "sumo_nets/plot.py",
    "service/world/camera/export.py",
    "service/world/camera/sheet.py",
    "service/world/egos/sdk.py",
}
UNKNOWN = "none"


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
    """Of this installation; it reads some two hundred sources, a third of a second."""
    return Software({part: _digest(part) for part in PARTS}, {name: _version(name) for name in LIBRARIES})


def sources_of(part: str) -> list[Path]:
    """The files of a part, in one order."""
    found = {path for pattern in PARTS[part] for path in SOURCES.glob(pattern)}
    return sorted(path for path in found if path.relative_to(SOURCES).as_posix() not in BESIDE)


def _digest(part: str) -> str:
    digest = hashlib.sha256()
    for path in sources_of(part):
        code = code_alone(path.read_text(encoding="utf-8")).encode()
        digest.update(f"{path.relative_to(SOURCES).as_posix()} {len(code)} ".encode())
        digest.update(code)
    return digest.hexdigest()[:16]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
