"""What was run, kept for good: run directories of `tailroad estimate`, and the database of a fleet."""

from service.evaluation.store.chunk import FAILED, Chunk, Origin, failed_chunk
from service.evaluation.store.directory import RunDirectory
from service.evaluation.store.source import ChunkSource

__all__ = ["FAILED", "Chunk", "ChunkSource", "Origin", "RunDirectory", "failed_chunk"]
