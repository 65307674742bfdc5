"""Audits: a chunk that two workers ran must agree to the bit; where it does not, a third one decides."""

import hashlib
from collections import Counter
from dataclasses import dataclass, field

from service.remote.fleet.messages import ChunkKey, Drawn, Explicit

OPINIONS = 3  # that all differ: the rollouts are not reproducible


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

    @property
    def disputed(self) -> bool:
        return len(set(self.opinions.values())) > 1

    def verdict(self) -> "Verdict | None":
        """Who is right and who is wrong; None while that is open."""
        bits, times = Counter(self.opinions.values()).most_common(1)[0]
        if times >= 2:
            right = tuple(w for w, b in self.opinions.items() if b == bits)
            return Verdict(right, tuple(w for w in self.opinions if w not in right))
        return Verdict((), ()) if len(self.opinions) >= OPINIONS else None


@dataclass(frozen=True)
class Verdict:
    """Both empty: nobody agrees with anybody."""

    right: tuple[str, ...]
    wrong: tuple[str, ...]


def chosen(key: ChunkKey, share: float, secret: bytes) -> bool:
    """Whether a chunk is among the audited ones: a share of all, which workers cannot tell as they lack the secret."""
    word = hashlib.blake2b(f"{key.job}/{key.digest}/{key.start}".encode(), digest_size=8, key=secret).digest()
    return int.from_bytes(word, "little") < share * 2**64
