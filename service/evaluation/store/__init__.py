"""What was run, kept for good: run directories of `tailroad estimate`, and the database of a fleet."""

from typing import TYPE_CHECKING, Any

from service.evaluation.store.chunk import FAILED, Chunk, Origin, failed_chunk
from service.evaluation.store.source import ChunkSource

if TYPE_CHECKING:
    from service.evaluation.store.directory import RunDirectory

__all__ = ["FAILED", "Chunk", "ChunkSource", "Origin", "RunDirectory", "failed_chunk"]


def __getattr__(name: str) -> Any:
    """RunDirectory when it is first asked for: workers, which keep nothing, load no database."""
    if name != "RunDirectory":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from service.evaluation.store.directory import RunDirectory

    return RunDirectory
