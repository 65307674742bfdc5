"""An answer on its way to the record."""

from dataclasses import dataclass

from service.evaluation.store import Chunk
from service.remote.fleet.messages import ChunkKey


@dataclass(frozen=True)
class Ticket:
    """A request that is answered once what it brought is recorded.

    request: who waits to hear that it is recorded
    """

    key: ChunkKey
    chunk: Chunk
    worker: str
    request: int | None
    generation: int
