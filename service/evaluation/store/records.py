"""The chunks of a database: added once, read back to the bit."""

import hashlib
from collections import Counter
from collections.abc import Generator, Iterable, Iterator

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.store.chunk import Chunk, Origin, chunk_of, row_of
from service.evaluation.store.database import add_to_tally, cannot_read, insert_once, reason, shown, writing
from service.evaluation.store.tables import chunks, tallies, voids

ChunkName = tuple[str, int, int, int]  # phase, iteration, start, epoch
_KEY = ("job", "phase", "iteration", "start", "epoch")


class ChunkRecord:
    """The table of chunks, less those that are voided."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine

    def append(self, finished: Iterable[tuple[str, str, int, Chunk, Origin]]) -> None:
        """Record finished chunks for good, all or none; one that is there already is left as it is."""
        rows = [row_of(*one) for one in finished]
        try:
            with writing(self._engine) as connection:
                added = connection.execute(insert_once(self._engine, chunks).returning(chunks.c.job), rows)
                for job, count in Counter(added.scalars()).items():
                    connection.execute(add_to_tally(self._engine), {"job": job, "chunks": count})
        except SQLAlchemyError as error:
            raise StoreError(f"cannot record rollouts in {shown(self._engine)}: {reason(error)}") from error

    def chunks(
        self, job: str, phase: str, iteration: int, start: int = 0, stop: int | None = None
    ) -> list[tuple[Chunk, Origin]]:
        """The chunks of a batch that hold any of rows [start, stop), by start; stop = None: to its end."""
        query = (
            self._of(job)
            .where(chunks.c.phase == phase, chunks.c.iteration == iteration)
            .where(chunks.c.stop > start, sa.true() if stop is None else chunks.c.start < stop)
            .order_by(chunks.c.start, chunks.c.epoch)
        )
        return [(chunk_of(row), Origin(row.worker, row.epoch)) for row in self._read(query)]

    def all_chunks(self, job: str) -> Iterator[tuple[str, int, Chunk]]:
        """Every chunk of a job as (phase, iteration, chunk)."""
        for phase, iteration, chunk, _ in self.with_origins(job):
            yield phase, iteration, chunk

    def with_origins(self, job: str) -> Iterator[tuple[str, int, Chunk, Origin]]:
        """Every chunk of a job as (phase, iteration, chunk, origin)."""
        for row in self.rows(job):
            yield row.phase, row.iteration, chunk_of(row), Origin(row.worker, row.epoch)

    def from_chunk(
        self, job: str, key: tuple[str, int, int, int]
    ) -> Generator[tuple[str, int, Chunk, Origin], None, None]:
        """The chunks of a job from (phase, iteration, start, epoch) on, in the order of `with_origins`."""
        ordered = (chunks.c.phase, chunks.c.iteration, chunks.c.start, chunks.c.epoch)
        query = self._of(job).where(sa.tuple_(*ordered) >= sa.tuple_(*key)).order_by(*ordered)
        for row in self._read(query):
            yield row.phase, row.iteration, chunk_of(row), Origin(row.worker, row.epoch)

    def names(self, job: str) -> list[ChunkName]:
        """Phase, iteration, start and epoch of every chunk, in the order of `rows`, without reading what they hold."""
        key = (chunks.c.phase, chunks.c.iteration, chunks.c.start, chunks.c.epoch)
        return [tuple(row) for row in self._read(self._of(job).with_only_columns(*key).order_by(*key))]

    def digest(self, job: str) -> str:
        """Of all that decides what the job comes to: its chunks' rows, draws, values and epochs."""
        digest = hashlib.blake2b(digest_size=16)
        for phase, iteration, chunk, origin in self.with_origins(job):
            digest.update(
                repr((phase, iteration, chunk.start, chunk.stop, origin.epoch, chunk.draws)).encode()
            )
            digest.update(chunk.fingerprint())
        return digest.hexdigest()

    def rows(self, job: str) -> Iterator[sa.Row]:
        """Every chunk of a job as its row, sound or not."""
        query = self._of(job).order_by(chunks.c.phase, chunks.c.iteration, chunks.c.start, chunks.c.epoch)
        yield from self._read(query)

    def jobs(self) -> Iterator[str]:
        """The jobs of which there are chunks."""
        for row in self._read(sa.select(chunks.c.job).distinct()):
            yield row.job

    def missing(self) -> dict[str, int]:
        """How many chunks that were once recorded are not there any more, by job; jobs that miss none are left out."""
        there = (
            sa.select(sa.func.count()).where(chunks.c.job == tallies.c.job).scalar_subquery().label("there")
        )
        rows = self._read(sa.select(tallies.c.job, tallies.c.chunks, there))
        return {row.job: row.chunks - row.there for row in rows if row.chunks > row.there}

    def count_anew(self, job: str) -> None:
        """Take the chunks of the job that are there for all that were recorded."""
        there = sa.select(sa.func.count()).where(chunks.c.job == job).scalar_subquery()
        try:
            with writing(self._engine) as connection:
                connection.execute(sa.update(tallies).where(tallies.c.job == job).values(chunks=there))
        except SQLAlchemyError as error:
            raise StoreError(f"cannot count rollouts in {shown(self._engine)}: {reason(error)}") from error

    def without_checksum(self) -> int:
        """Chunks that were recorded before there were checksums."""
        (row,) = self._read(sa.select(sa.func.count()).where(chunks.c.checksum == ""))
        return row[0]

    def _of(self, job: str) -> sa.Select:
        same = sa.and_(*(chunks.c[name] == voids.c[name] for name in _KEY))
        return sa.select(chunks).where(chunks.c.job == job, ~sa.exists().where(same))

    def _read(self, query: sa.Select) -> Iterator[sa.Row]:
        try:
            with self._engine.connect() as connection:
                yield from connection.execute(query.execution_options(yield_per=256))
        except (SQLAlchemyError, UnicodeError) as error:
            raise cannot_read(self._engine, error) from error
