"""From runs to a folder of evidence that stands alone, signed."""

import hashlib
import platform
import shutil
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import tomli_w
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from service.analysis.acceptance.case import Case, load_case
from service.analysis.evidence import goals
from service.analysis.evidence.material import CARDS, Wanted, add_run, write_json
from service.analysis.evidence.objects import CLAIMS, KEY, MANIFEST, SIGNATURE, Claim, Claims, Group, Manifest
from service.analysis.evidence.signature import public_key, sign
from service.analysis.run.acceptance import accept_case
from service.analysis.wording import significant
from service.errors import InputError
from service.evaluation.software import software
from service.evaluation.summary import json_ready

# cards of the drivers that a checkout has beside the packages
REPOSITORY = Path(__file__).resolve().parents[3] / "deploy"
BESIDE = ("cards/drivers-gail-realism.json", "results/driver-rates.md")


def gather(
    runs: Sequence[Path],
    out: Path,
    key: Ed25519PrivateKey,
    wanted: Wanted,
    case: Path | None = None,
    title: str = "Safety of the driving policies in simulated traffic",
    now: datetime | None = None,
) -> Claims:
    """Write the folder `out`, which must not exist; what it claims.

    It is made beside `out` and moved there whole. InputError where there is something at `out`, or nothing to claim.
    """
    if out.exists():
        raise InputError(f"{out} exists already: give a folder that does not")
    if not out.resolve().parent.is_dir():
        raise InputError(f"{out}: the folder {out.resolve().parent} does not exist; make it first")
    made = (now or datetime.now(UTC)).isoformat(timespec="seconds")
    with tempfile.TemporaryDirectory(dir=out.resolve().parent, prefix=".evidence-") as temporary:
        folder = Path(temporary) / "folder"
        folder.mkdir()
        groups: list[Group] = []
        for run in runs:
            groups += add_run(folder, run, len(groups) + 2, wanted)
        if case is not None:
            groups.append(_case(folder, case, runs, f"G{len(groups) + 2}", wanted))
        claims = Claims(title=title, made=made, groups=tuple(groups))
        write_json(folder, CLAIMS, claims)
        write_json(folder, "software.json", _software())
        for name in BESIDE:
            if (REPOSITORY / name).is_file():
                shutil.copyfile(REPOSITORY / name, folder / CARDS / Path(name).name)
        (folder / "README.md").write_text(goals.markdown(claims), encoding="utf-8")
        (folder / "goals.svg").write_bytes(goals.picture(claims))
        (folder / KEY).write_text(public_key(key).text, encoding="utf-8")
        seal(folder, key, made)
        folder.rename(out)
    return claims


def seal(folder: Path, key: Ed25519PrivateKey, made: str) -> None:
    """Write the manifest of all files in the folder, and its signature."""
    files = {path.relative_to(folder).as_posix(): digest_of(path) for path in files_in(folder)}
    runs = tuple(sorted(name.rpartition("/")[0] for name in files if name.endswith("/run.json")))
    manifest = Manifest(made=made, tailroad=version("tailroad"), files=dict(sorted(files.items())), runs=runs)
    data = msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n"
    (folder / MANIFEST).write_bytes(data)
    (folder / SIGNATURE).write_text(sign(key, data, f"tailroad evidence, {made}"), encoding="utf-8")


def files_in(folder: Path) -> list[Path]:
    """Every file but the manifest and its signature, links and all else that is no folder included."""
    beside = {folder / MANIFEST, folder / SIGNATURE}
    return sorted(
        path for path in folder.rglob("*") if path not in beside and (path.is_symlink() or not path.is_dir())
    )


def digest_of(path: Path) -> tuple[str, int]:
    """SHA-256 and size of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return digest, path.stat().st_size


def _software() -> dict[str, object]:
    own = software()
    return {
        "tailroad": version("tailroad"),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "system": platform.system(),
        "digest": own.digest,
        "parts": own.named(),
    }


def _with_runs(case: Case, runs: Sequence[Path]) -> dict[str, Any]:
    """The case as its file in the folder says it, with the runs that are in the folder.

    InputError for a run that is not.
    """
    known = {run.resolve(): f"runs/{run.resolve().name}" for run in runs}
    told: dict[str, Any] = json_ready(msgspec.to_builtins(case))
    del told["folder"]
    for scenario in told["scenario"]:
        if scenario["run"]:
            run = (Path(case.folder) / scenario["run"]).resolve()
            if run not in known:
                raise InputError(f"the case's scenario {scenario['name']!r} is of {run}: give this run, too")
            scenario["run"] = known[run]
    return _without_none(told)


def _without_none(value: Any) -> Any:
    """TOML has no word for nothing."""
    if isinstance(value, dict):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list | tuple) else value


def _case(folder: Path, case: Path, runs: Sequence[Path], goal: str, wanted: Wanted) -> Group:
    """The claims of an acceptance case."""
    read = load_case(case)
    found = accept_case(read, wanted.workers)
    (folder / "case.toml").write_text(tomli_w.dumps(_with_runs(read, runs)), encoding="utf-8")
    file = write_json(folder, "acceptance.json", found)
    claims = tuple(
        Claim(
            id=f"{goal}.{i + 1}",
            says=f"{one.claim}: {one.verdict}; at most {significant(one.target)}"
            + (" times the human rate" if one.of_human else f" per {found.unit}")
            + f", {one.why}",
            file=file,
            at=("claims", i, "verdict"),
            value=one.verdict,
            command="tailroad accept case.toml",
        )
        for i, one in enumerate(found.claims)
    )
    return Group(
        id=goal,
        says=f"Acceptance case {found.name}: {found.verdict}",
        context=tuple(f"{one.claim}: people {one.human}" for one in found.claims if one.human),
        assumptions=("The exposures and human rates of the case's file are as it says.",),
        warnings=(),
        claims=claims,
    )
