"""What the scheduler knows, and the instructions it collects: the first of the layers that it is made of."""

from service.remote.fleet import events as E
from service.remote.fleet.auditing import Auditing
from service.remote.fleet.dealing import Dealing
from service.remote.fleet.jobs import JobState
from service.remote.fleet.policy import Policy
from service.remote.fleet.tickets import Ticket
from service.remote.fleet.workers import Workers


class Ledger:
    """versions: what a worker must be made of (service.remote.fleet.versions); secret: decides what is audited."""

    def __init__(
        self,
        versions: dict[str, str],
        policy: Policy,
        quarantined: dict[str, str],
        secret: bytes,
    ):
        self.policy = policy
        self.versions = versions
        self.jobs: dict[str, JobState] = {}
        self.workers = Workers(quarantined)
        self.tickets: dict[int, Ticket] = {}
        self.trouble = ""  # why the database takes nothing
        self.now = float("-inf")
        self._out: list[E.Instruction] = []
        self._last_ticket = 0
        self._voiding: set[str] = set()  # wrong workers whose chunks are still in the record
        self._auditing = Auditing(policy, secret)
        self._dealing = Dealing(policy, self.jobs, self.workers, self._auditing)

    def _deal(self, slots: list[tuple[str, int]] | None = None, copies: bool = False) -> None:
        """Give work to these slots, or to all that wait; copies: of stragglers, too."""
        if not self.trouble:
            self._out += self._dealing.deal(self.now, slots, copies)
