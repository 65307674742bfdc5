"""Whether a folder of evidence says what it said when it was signed: signature, digests, claims, a sample run again.

Nothing in the folder is opened for writing: records are read from copies.
"""

import json
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from service.analysis.evidence.gather import digest_of, files_in
from service.analysis.evidence.material import estimate_facts
from service.analysis.evidence.objects import (
    CLAIMS,
    FORMAT,
    KEY,
    MANIFEST,
    SIGNATURE,
    Claim,
    Claims,
    Manifest,
)
from service.analysis.evidence.signature import PublicKey, check, read_public_key
from service.errors import StoreError, TailroadError
from service.evaluation.record import replay
from service.evaluation.store import RunDirectory
from service.evaluation.verify import Verified, verify

LARGEST = 64 << 20  # bytes of a JSON file that is read


@dataclass(frozen=True)
class Checked:
    """What was found of a folder.

    signed_by: name of the key; trusted: whether it is the one that was given
    files, claims: how many were checked
    records: of its runs' jobs
    wrong: what is wrong, a sentence each, with the name of the file or claim
    """

    signed_by: str
    trusted: bool
    comment: str
    files: int
    claims: int
    records: tuple[Verified, ...]
    wrong: tuple[str, ...]


def is_evidence(folder: Path) -> bool:
    """Whether it looks like a folder of evidence."""
    return (folder / MANIFEST).is_file() or (folder / SIGNATURE).is_file()


def check_evidence(folder: Path, sample: int, workers: int, trusted: PublicKey | None = None) -> Checked:
    """Check a folder of evidence and run `sample` rollouts of each job again.

    trusted: the key that must have signed it; None: the folder's own, which says only that it was changed by nobody
        who has not that key
    """
    wrong: list[str] = []
    key, comment, manifest = _sealed(folder, trusted, wrong)
    if manifest is None:
        return Checked("" if key is None else key.name, False, comment, 0, 0, (), tuple(wrong))
    wrong += _files(folder, manifest)
    claims = _claims(folder, manifest, wrong)
    records: list[Verified] = []
    if not wrong:  # what was changed is not run
        for run in manifest.runs:
            records += _run(folder, run, sample, workers, wrong)
    return Checked(
        "" if key is None else key.name,
        trusted is not None and not wrong,
        comment,
        len(manifest.files),
        claims,
        tuple(records),
        tuple(wrong),
    )


def _read(path: Path) -> bytes:
    if path.is_symlink() or not path.is_file():
        raise StoreError(f"{path.name} is missing")
    if path.stat().st_size > LARGEST:
        raise StoreError(f"{path.name} is larger than {LARGEST} bytes")
    return path.read_bytes()


def _sealed(
    folder: Path, trusted: PublicKey | None, wrong: list[str]
) -> tuple[PublicKey | None, str, Manifest | None]:
    """The key, the signature's comment and the manifest; None where it cannot be relied on."""
    key = None
    try:
        key = trusted or read_public_key(_read(folder / KEY).decode("utf-8", "replace"))
        data = _read(folder / MANIFEST)
        comment = check(key, data, _read(folder / SIGNATURE).decode("utf-8", "replace"))
        manifest = msgspec.json.decode(data, type=Manifest)
    except (StoreError, msgspec.MsgspecError, ValueError, RecursionError, OSError) as error:
        wrong.append(str(error))
        return key, "", None
    if manifest.format != FORMAT:
        wrong.append(f"{MANIFEST} has format {manifest.format}; this tailroad reads {FORMAT}")
        return key, comment, None
    return key, comment, manifest


def _files(folder: Path, manifest: Manifest) -> list[str]:
    """What is wrong with the folder's files."""
    found = {path.relative_to(folder).as_posix(): path for path in files_in(folder)}
    wrong = [f"{name} is missing" for name in manifest.files if name not in found]
    wrong += [
        f"{name} is not of the evidence: the manifest does not name it"
        for name in found
        if name not in manifest.files
    ]
    for name, path in found.items():
        if name not in manifest.files:
            continue
        if path.is_symlink() or not path.is_file():
            wrong.append(f"{name} is no plain file")
        elif digest_of(path) != manifest.files[name]:
            wrong.append(f"{name} was changed: its SHA-256 is not the manifest's")
    return wrong


def _claims(folder: Path, manifest: Manifest, wrong: list[str]) -> int:
    """How many claims there are; what is wrong with them goes to `wrong`."""
    try:
        claims = msgspec.json.decode(_read(folder / CLAIMS), type=Claims)
    except (StoreError, msgspec.MsgspecError, ValueError, RecursionError, OSError) as error:
        wrong.append(f"{CLAIMS}: {error}")
        return 0
    every = [claim for group in claims.groups for claim in group.claims]
    files: dict[str, Any] = {}
    for claim in every:
        if (reason := _unsupported(folder, manifest, claim, files)) is not None:
            wrong.append(f"claim {claim.id} ({claim.says}) has no support: {reason}")
    for group in claims.groups:
        if not group.claims:
            wrong.append(f"goal {group.id} ({group.says}) has no support: no claim stands below it")
    return len(every)


def _unsupported(folder: Path, manifest: Manifest, claim: Claim, files: dict[str, Any]) -> str | None:
    """Why nothing supports a claim; None where its file says what it says."""
    if claim.file not in manifest.files:
        return f"the manifest has no file {claim.file}"
    if not claim.at:
        return None if (folder / claim.file).is_file() else f"{claim.file} is missing"
    try:
        if claim.file not in files:
            files[claim.file] = json.loads(_read(folder / claim.file))
        value = files[claim.file]
        for step in claim.at:
            value = value[step]
    except (StoreError, OSError, ValueError, KeyError, IndexError, TypeError, RecursionError) as error:
        return f"{claim.file} says nothing there ({type(error).__name__})"
    return (
        None if value == claim.value else f"{claim.file} says {str(value)[:80]}, not {str(claim.value)[:80]}"
    )


def _run(folder: Path, run: str, sample: int, workers: int, wrong: list[str]) -> list[Verified]:
    """Verify a copy of a run's record, and hold its estimates against those of the folder."""
    found = []
    with tempfile.TemporaryDirectory(prefix="tailroad-verify-") as temporary:
        copy = Path(temporary) / Path(run).name
        shutil.copytree(folder / run, copy)
        try:
            with RunDirectory.open(copy, checked=False) as store:
                wrong += [f"{run}: {line}" for line in store.wrong()]
                for job in store.jobs:
                    one = verify(job.id, job, store.record.rows(job.id), sample, workers)
                    found.append(one)
                    wrong += [f"{run}, {job.id}: {line}" for line in one.damage]
                    name = f"estimates/{Path(run).name}-{job.id}.json"
                    if not one.damage and estimate_facts(replay(store, job)) != json.loads(
                        _read(folder / name)
                    ):
                        wrong.append(f"{name} is not what the record of {run} comes to")
        except (TailroadError, ValueError, OSError) as error:
            wrong.append(f"{run}: {error}")
    return found
