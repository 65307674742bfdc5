"""What people say of jobs: events of a kind of their own, of which the last one of a job counts."""

import msgspec

from service.evaluation.store.decoding import decoded

NOTE = "note"  # the kind of event


class Said(msgspec.Struct, frozen=True):
    """What people say of a job: words, tags, whether it is put away."""

    text: str = ""
    tags: tuple[str, ...] = ()
    archived: bool = False


def said_of(body: str | None, job: str) -> Said:
    """What a job's last note says."""
    return Said() if body is None else decoded(body, Said, f"the note of job {job}")
