"""What a database says in JSON, read: where it is damaged, that is said, and what to do."""

from typing import Any, TypeVar

import msgspec

from service.errors import StoreError

T = TypeVar("T")


class Told(msgspec.Struct, frozen=True):
    """A status, as the event of that kind tells it."""

    status: str
    reason: str = ""


def decoded(text: Any, kind: type[T], what: str) -> T:
    """JSON as a value of that kind; StoreError, which names `what` it was to be, for anything else."""
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.MsgspecError, ValueError, TypeError, RecursionError) as error:
        raise StoreError(
            f"{what} is damaged in the database; `tailroad verify` says what else is: take it from a copy"
        ) from error


def status_of(text: Any, job: str, known: tuple[str, ...]) -> Told:
    """A job's last status; StoreError where it is none of those known."""
    told = decoded(text, Told, f"the status of job {job}")
    if told.status not in known:
        raise StoreError(
            f"the status of job {job} is damaged in the database: {told.status!r}; take it from a copy"
        )
    return told
