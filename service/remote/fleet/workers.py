"""The workers that the scheduler knows, the leases they hold and the questions they wait with."""

from dataclasses import dataclass, field

from service.remote.fleet.messages import Ask, Capabilities, ChunkKey
from service.remote.fleet.peers import NOBODY, Peer
from service.world.egos.open import REMOTE


@dataclass(frozen=True)
class Held:
    """A lease as its giver remembers it."""

    id: int
    worker: str
    slot: int
    key: ChunkKey
    audit: bool
    since: float
    until: float
    expected_s: float | None


@dataclass(frozen=True)
class Waiting:
    """A slot's question that has no answer yet."""

    request: int
    ask: Ask
    until: float


@dataclass
class Tally:
    """What became of chunks since the scheduler began.

    lost: taken back without an answer, because the worker was gone or its time was up
    copied: given to a second worker because the first took long
    audited: run again by another worker and judged
    wrong: of those, values that were not the others'
    """

    lost: int = 0
    copied: int = 0
    audited: int = 0
    wrong: int = 0


@dataclass
class WorkerState:
    """A worker that has said hello."""

    id: str
    capabilities: Capabilities
    since: float
    peer: Peer = NOBODY
    leases: set[int] = field(default_factory=set)
    draws_wrong: bool = False  # its random draws are not the scheduler's: it gets the rows themselves
    garbled: int = 0
    chunks: int = 0
    rollouts: int = 0
    worker_s: float = 0.0

    def can_run(self, ego: str) -> bool:
        """Whether it has the ego; egos over the network (`zenoh:NAME`) are anybody's."""
        return ego in self.capabilities.egos or ego.startswith(REMOTE)


class Workers:
    """All of them, those in quarantine by name, certificate and host."""

    def __init__(self, quarantined: dict[str, str]):
        self.here: dict[str, WorkerState] = {}
        self.quarantined = dict(quarantined)
        self.leases: dict[int, Held] = {}
        self.waiting: dict[tuple[str, int], Waiting] = {}
        self.tally = Tally()
        self.slots = 0  # of all who are here
        self._last_lease = 0

    def refusal(self, name: str, peer: Peer) -> str:
        """Why a worker is refused for good, "" where it is not: by its name, certificate or host."""
        for what in (name, *peer.banned):
            if what in self.quarantined:
                whom = f"worker {what}" if what == name else what
                return f"{whom} is in quarantine: {self.quarantined[what]}"
        return ""

    def identity(self, name: str) -> str:
        """Whose vote a worker's answers are; one that is not here any more has none that another could confirm."""
        return self.here[name].peer.identity if name in self.here else ""

    def join(self, worker: WorkerState) -> None:
        """One that is not here yet."""
        self.here[worker.id] = worker
        self.slots += worker.capabilities.procs

    def leave(self, worker: str) -> None:
        """One that is here; its leases are somebody else's to take back."""
        self.slots -= self.here.pop(worker).capabilities.procs

    def lease(
        self, slot: Ask, key: ChunkKey, audit: bool, now: float, limit_s: float, expected_s: float | None
    ) -> Held:
        """A new lease for a slot."""
        self._last_lease += 1
        held = Held(self._last_lease, slot.worker, slot.slot, key, audit, now, now + limit_s, expected_s)
        self.leases[held.id] = held
        self.here[slot.worker].leases.add(held.id)
        return held

    def release(self, lease: int, worker: str | None = None) -> Held | None:
        """Take a lease back, where it is there and (if given) that worker's."""
        held = self.leases.get(lease)
        if held is None or (worker is not None and held.worker != worker):
            return None
        del self.leases[lease]
        if held.worker in self.here:
            self.here[held.worker].leases.discard(lease)
        return held

    def of_slot(self, worker: str, slot: int) -> list[int]:
        return [i for i in self.here[worker].leases if self.leases[i].slot == slot]

    def expired(self, now: float) -> list[int]:
        return [held.id for held in self.leases.values() if held.until <= now]
