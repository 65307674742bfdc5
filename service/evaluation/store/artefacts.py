"""What a job keeps beside its chunks, by name: written once, read back to the bit, each with a checksum."""

import hashlib
from collections.abc import Iterator

import sqlalchemy as sa
from sqlalchemy.exc import SQLAlchemyError

from service.errors import StoreError
from service.evaluation.store.database import insert_once, read_rows, reason, shown, writing
from service.evaluation.store.tables import artefacts


class ArtefactRecord:
    """The table of artefacts."""

    def __init__(self, engine: sa.Engine):
        self._engine = engine

    def keep(self, job: str, name: str, data: bytes) -> None:
        """Keep it for good; one of that name that is there already is left as it is."""
        row = {"job": job, "name": name, "data": data, "checksum": _checksum(job, name, data)}
        try:
            with writing(self._engine) as connection:
                connection.execute(insert_once(self._engine, artefacts), [row])
        except SQLAlchemyError as error:
            raise StoreError(f"cannot keep {name} in {shown(self._engine)}: {reason(error)}") from error

    def kept(self, job: str, name: str) -> bytes | None:
        """What is kept under that name; None for nothing. StoreError where it is damaged."""
        query = sa.select(artefacts).where(artefacts.c.job == job, artefacts.c.name == name)
        for row in read_rows(self._engine, query):
            if row.checksum != _checksum(job, name, row.data):
                raise StoreError(
                    f"{name} of job {job} in {shown(self._engine)} is damaged; take the file from a copy"
                )
            return bytes(row.data)
        return None

    def names(self, job: str) -> Iterator[str]:
        """Of what is kept, in their order."""
        for row in read_rows(
            self._engine, sa.select(artefacts.c.name).where(artefacts.c.job == job).order_by(artefacts.c.name)
        ):
            yield row.name


def _checksum(job: str, name: str, data: bytes) -> str:
    digest = hashlib.blake2b(digest_size=16)
    digest.update(repr((job, name, len(data))).encode())
    digest.update(data)
    return digest.hexdigest()
