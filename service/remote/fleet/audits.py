"""Audits: a chunk that two workers ran must agree to the bit; where it does not, this machine runs it and decides."""

import hashlib
from dataclasses import dataclass, field

from service.remote.fleet.messages import ChunkKey, Drawn, Explicit


@dataclass
class Audit:
    """A chunk that is run by more than one worker and compared.

    opinions: the bits by worker
    counted: whose answer is in the record, of `epoch`
    lease: of who runs it now
    """

    key: ChunkKey
    rows: Drawn | Explicit
    counted: str
    epoch: int
    opinions: dict[str, bytes] = field(default_factory=dict)
    lease: int | None = None
    losses: int = 0  # leases that ended without an answer
    settling: bool = False  # this machine runs it

    @property
    def disputed(self) -> bool:
        return len(set(self.opinions.values())) > 1


def chosen(key: ChunkKey, share: float, secret: bytes) -> bool:
    """Whether a chunk is among the audited ones: a share of all, which workers cannot tell as they lack the secret."""
    word = hashlib.blake2b(f"{key.job}/{key.digest}/{key.start}".encode(), digest_size=8, key=secret).digest()
    return int.from_bytes(word, "little") < share * 2**64
