"""Where a committor comes from that a run is given: another run, a file, or tailroad itself."""

from pathlib import Path

from ce.paths import NetworkCommittor
from service.errors import InputError
from service.evaluation.options import PATHS
from service.evaluation.path_store import committor_in, committor_of
from service.evaluation.shipped import shipped_for
from service.evaluation.store import RunDirectory
from service.world.scenario import Scenario

LARGEST_BYTES = 16_000_000
OWN = "own"  # in place of a committor: train one


def committor_for(given: str | Path | None, scenario: Scenario) -> tuple[NetworkCommittor, bytes] | None:
    """The committor that paths start from: the one given, or the one that comes with tailroad for that scenario; None
    where one is to be trained.

    given: a run directory, a file, "own" to train one, or None
    """
    if given is None:
        return shipped_for(scenario)
    return None if str(given) == OWN else committor_from(given)


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
