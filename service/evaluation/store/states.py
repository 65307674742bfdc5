"""The last states of jobs that are over, kept so that an estimate is told without a replay of minutes.

A state follows from the chunks: it is used only where its checksum holds and the record is still the one that it is of.
"""

import hashlib
from datetime import UTC, datetime
from importlib.metadata import version

import msgspec
import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.software import software
from service.evaluation.store.database import read_rows, reason, shown, writing
from service.evaluation.store.tables import states


class LastState(msgspec.Struct, frozen=True):
    """What a job that is over has come to.

    epoch, number: of the job's record, and how many batches the state has taken in
    record: digest of the chunks that it follows from (`ChunkRecord.digest`); "" in a row of before there were digests
    state: as the algorithm's to_bytes writes it
    """

    job: str
    epoch: int
    number: int
    record: str
    state: bytes

    def checksum(self) -> str:
        """Of all that it says."""
        digest = hashlib.blake2b(digest_size=16)
        digest.update(repr((self.job, self.epoch, self.number, self.record)).encode())
        digest.update(self.state)
        return digest.hexdigest()


class KeptState(msgspec.Struct, frozen=True):
    """A state as it is read.

    sound: its checksum is there and holds
    """

    last: LastState
    sound: bool


class StateRecord:
    """The table of last states. One that other software has written is not used: that may come to other states."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine

    def keep(self, last: LastState, unreadable: bytes | None = None) -> None:
        """Keep a state in place of the one that is there; one that is sound and of the same record stays, unless it is
        the one that this tailroad cannot read."""
        row = msgspec.structs.asdict(last) | {
            "tailroad": software().digest,
            "checksum": last.checksum(),
            "at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        }
        there = self.kept(last.job, last.epoch)
        same = there is not None and there.sound and there.last.record == last.record
        if there is not None and same and there.last.state != unreadable:
            return
        try:
            with writing(self._engine) as connection:
                connection.execute(sa.delete(states).where(self._of(last.job, last.epoch)))
                connection.execute(sa.insert(states), [row])
        except SQLAlchemyError as error:
            raise StoreError(
                f"cannot keep a job's state in {shown(self._engine)}: {reason(error)}"
            ) from error

    def kept(self, job: str, epoch: int) -> KeptState | None:
        """The state that is kept of an epoch of the job, where there is one."""
        for row in read_rows(self._engine, sa.select(states).where(self._of(job, epoch))):
            last = LastState(row.job, row.epoch, row.number, row.record, row.state)
            return KeptState(last, row.tailroad == software().digest and row.checksum == last.checksum())
        return None

    def without_checksum(self) -> list[str]:
        """The jobs of which a state is kept that was written before there were checksums."""
        query = sa.select(states.c.job).where(states.c.checksum == "", self._written_here())
        return sorted({row.job for row in read_rows(self._engine, query)})

    def _of(self, job: str, epoch: int) -> sa.ColumnElement[bool]:
        return sa.and_(states.c.job == job, states.c.epoch == epoch, self._written_here())

    def _written_here(self) -> sa.ColumnElement[bool]:
        """By this software, or by this version of tailroad when that was all that was written down."""
        return states.c.tailroad.in_((software().digest, version("tailroad")))
