"""What decides the rollouts of a naive job, as one digest: a ground truth is good for the jobs that share it.

Names do not decide rollouts, nor do descriptions, nor values that a scenario leaves at the schema's defaults, so that a
scenario may be renamed and the schema may grow. Defaults therefore stay what they are once they are released.
"""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from policies.drivers import WEIGHTS_FOLDER
from service.evaluation.job import Job, Problem
from service.evaluation.sources import code_alone
from service.world.egos.sumo import PREFIX as SUMO
from service.world.scenario.schema import Scenario
from service.world.sim.road import road_of

SOURCES = Path(__file__).resolve().parents[3]
# Of a scenario: what it is called, and what stands for contents that are hashed themselves.
NOT_DECISIVE = {"format", "name", "description", "fixed", "network", "drivers.weights", "camera"}
CAMERA_WEIGHTS = ".onnx"  # the shipped egos with a camera are networks in this format
# The code of egos that no compiled rollout repeats bit for bit, so that no audit notices when it changes.
SUMO_CODE = ("service/world/egos/sumo.py", "service/world/sim/sumo.py", "service/world/sim/drawn_lengths.py")
CAMERA_CODE = ("policies/egos/vision.py", "service/world/camera/*.py")
NOT_SEEN_BY_EGOS = ("__init__.py", "export.py", "sheet.py", "start.py")  # of the camera's


def digest_of(job: Job) -> str:
    """16 hexadecimal digits of everything that decides the job's rollouts: scenario, road, drivers, ego, seed."""
    problem = Problem(job)
    digest = hashlib.sha256(msgspec.json.encode(decisive(job.scenario), order="deterministic"))
    road = road_of(problem.corridor)
    for table in (road.reference, road.lanes):
        digest.update(table.tobytes())
    digest.update(f"{road.spacing_m!r}/{job.weights_sha256}/{job.seed}/".encode())
    for part in _ego(job, problem):
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()[:16]


def decisive(scenario: Scenario) -> dict[str, Any]:
    """What of a scenario decides its rollouts: every value that differs from the schema's default."""
    return _own_values(scenario, "")


def _own_values(value: Any, key: str) -> Any:
    if isinstance(value, msgspec.Struct):
        kind = value.__struct_config__
        found = {} if kind.tag is None else {str(kind.tag_field): kind.tag}
        for field in msgspec.structs.fields(value):
            inner = f"{key}.{field.encode_name}" if key else field.encode_name
            own = getattr(value, field.name)
            if inner not in NOT_DECISIVE and own != field.default:
                found[field.encode_name] = _own_values(own, inner)
        return found
    if isinstance(value, tuple):
        return [_own_values(item, key) for item in value]
    return value


def _ego(job: Job, problem: Problem) -> Iterable[bytes]:
    """What decides how the ego drives: its weights whatever they are called, or its name; the code of some."""
    if job.ego.startswith(SUMO):
        yield job.ego.encode()
        yield Path(problem.corridor.net_path).read_bytes()
        yield from _code(SUMO_CODE)
        return
    weights = [path for path in sorted(WEIGHTS_FOLDER.glob(f"ego-{job.ego}.*")) if path.suffix != ".json"]
    if not weights:
        yield job.ego.encode()
    for path in weights:
        yield path.suffix.encode() + path.read_bytes()
        if path.suffix == CAMERA_WEIGHTS:
            yield msgspec.json.encode(job.scenario.camera)
            yield from _code(CAMERA_CODE)


def _code(patterns: Iterable[str]) -> Iterable[bytes]:
    for pattern in patterns:
        for path in sorted(SOURCES.glob(pattern)):
            if path.name not in NOT_SEEN_BY_EGOS:
                yield code_alone(path.read_text(encoding="utf-8")).encode()
