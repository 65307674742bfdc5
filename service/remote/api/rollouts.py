"""Every rollout of a job's record over the API, in pages."""

from contextlib import closing

import numpy as np

from service.evaluation.listing import Wanted
from service.evaluation.pool import OUTCOME_NAMES
from service.evaluation.store.chunk import Chunk
from service.remote.api.objects import Listing, Rollouts
from service.remote.api.problems import ApiError, Wrong, short
from service.remote.api.requests import AskListing, RolloutsPage
from service.remote.api.results import finite
from service.remote.fleet.service import Fleet

Place = tuple[
    str, int, int, int, int
]  # phase, iteration, start and epoch of a chunk; the first row of it that is meant
BEGIN: Place = ("", 0, 0, 0, 0)
ERROR_CHARACTERS = 1_000_000  # of a page's reasons: a page ends early where there are more
COLUMNS = ("phase", "iteration", "row", "f", "outcome", "steps", "error", "worker", "contact")


class RolloutAnswers:
    """What is answered on jobs/ID/rollouts and jobs/ID/listing."""

    def __init__(self, fleet: Fleet):
        self._fleet = fleet

    def rollouts(self, asked: RolloutsPage, job: str) -> Rollouts:
        """The page after a place of the record. Of a job that is not over, what comes to stand before that place later
        is left out."""
        place = _place(asked.after)
        columns: dict[str, list[object]] = {name: [] for name in COLUMNS}
        taken, left, following = 0, ERROR_CHARACTERS, None
        with closing(self._fleet.reader(job).from_chunk(place[:4])) as chunks:
            for phase, iteration, chunk, origin in chunks:
                key = (phase, iteration, chunk.start, origin.epoch)
                first = max(place[4], chunk.start) if key == place[:4] else chunk.start
                stop, left = _stop(chunk, first, asked.limit - taken, left)
                if stop > first:
                    _take(columns, phase, iteration, chunk, origin.worker or None, first, stop)
                    taken += stop - first
                if stop < chunk.stop:
                    following = ",".join(map(str, (*key, stop)))
                    break
        return Rollouts(**{name: tuple(column) for name, column in columns.items()}, next=following)  # type: ignore[arg-type]

    def listing(self, asked: AskListing, job: str) -> Listing:
        """The rollouts that were asked for, some of them."""
        wanted = Wanted(asked.phase, asked.outcome, asked.low, asked.high)
        found = self._fleet.listing(job, wanted, asked.by, asked.offset, asked.limit)
        return Listing(
            job=job,
            total=found.total,
            found=found.found,
            phase=found.phases,
            iteration=tuple(found.iterations.tolist()),
            row=tuple(found.rows.tolist()),
            f=tuple(finite(found.f.tolist())),
            outcome=found.outcomes,
        )


def _stop(chunk: Chunk, first: int, rollouts: int, characters: int) -> tuple[int, int]:
    """Up to which row a page with so much room left takes the chunk, and the room for characters after that."""
    for row in range(first, min(chunk.stop, first + rollouts)):
        if characters <= 0:
            return row, characters
        characters -= len(chunk.errors.get(row - chunk.start, ""))
    return min(chunk.stop, first + rollouts), characters


def _take(
    columns: dict[str, list[object]],
    phase: str,
    iteration: int,
    chunk: Chunk,
    worker: str | None,
    first: int,
    stop: int,
) -> None:
    """Add rows [first, stop) of the chunk."""
    n, within = stop - first, slice(first - chunk.start, stop - chunk.start)
    columns["phase"] += [phase] * n
    columns["iteration"] += [iteration] * n
    columns["row"] += range(first, stop)
    columns["f"] += finite(np.asarray(chunk.f[within]).tolist())
    columns["outcome"] += [
        OUTCOME_NAMES.get(code, f"code {code}") for code in chunk.outcomes[within].tolist()
    ]
    columns["steps"] += chunk.steps[within].tolist()
    columns["error"] += [chunk.errors.get(row - chunk.start) for row in range(first, stop)]
    columns["worker"] += [worker] * n
    contacts = chunk.contacts or {}
    columns["contact"] += [contacts.get(row - chunk.start) for row in range(first, stop)]


def _place(after: str) -> Place:
    """What `next` of a page says; ApiError for anything else."""
    if not after:
        return BEGIN
    phase, *numbers = after.split(",")
    if (
        phase.isascii()
        and phase.isalpha()
        and len(numbers) == 4
        and all(n.isascii() and n.isdigit() and len(n) <= 18 for n in numbers)
    ):
        iteration, start, epoch, row = map(int, numbers)
        if max(iteration, start, epoch) < 2**31:
            return phase, iteration, start, epoch, row
    expected = "what `next` of the page before says"
    wrong = Wrong("after", short(after), expected)
    raise ApiError("bad-parameter", f"after is {short(after)!r}: give {expected}", (wrong,))
