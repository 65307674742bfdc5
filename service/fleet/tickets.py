"""An answer on its way to the record."""

from dataclasses import dataclass

from service.fleet.messages import ChunkKey
from service.store import Chunk


@dataclass(frozen=True)
class Ticket:
    """request: who waits to hear that it is recorded."""

    key: ChunkKey
    chunk: Chunk
    worker: str
    request: int | None
    generation: int
