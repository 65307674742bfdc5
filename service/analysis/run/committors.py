"""Where a committor comes from that a run is given: another run, or a file."""

from pathlib import Path

from ce.paths import NetworkCommittor
from service.errors import InputError
from service.evaluation.options import PATHS
from service.evaluation.path_store import committor_in, committor_of
from service.evaluation.store import RunDirectory

LARGEST_BYTES = 16_000_000


def committor_from(given: str | Path) -> tuple[NetworkCommittor, bytes]:
    """The committor of a run directory or of a file, and its bytes. InputError where there is none, StoreError where it
    cannot be read."""
    path = Path(given)
    data = _of_run(path) if path.is_dir() else _of_file(path)
    return committor_of(data, str(path)), data


def _of_run(path: Path) -> bytes:
    with RunDirectory.open(path) as store:
        for job in store.jobs:
            if job.method == PATHS and (data := committor_in(store.artefacts, job.id)) is not None:
                return data
    raise InputError(
        f"{path} has no committor: only a run of method {PATHS} whose training is over has one; give another run, or a "
        "file of one"
    )


def _of_file(path: Path) -> bytes:
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise InputError(f"{path}: a committor's file has at most {LARGEST_BYTES} bytes")
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"committor {path}: give a run directory of method {PATHS}, or a file of a committor ({error.strerror})"
        ) from error
