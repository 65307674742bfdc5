"""What the scheduler knows, and the instructions it collects: all of its parts work on this one value."""

from dataclasses import dataclass, field

from service.remote.fleet import events as E
from service.remote.fleet.auditing import Auditing
from service.remote.fleet.jobs import JobState
from service.remote.fleet.messages import Reply
from service.remote.fleet.policy import Policy
from service.remote.fleet.tickets import Ticket
from service.remote.fleet.workers import Workers


@dataclass
class SchedulerState:
    """The scheduler's memory; nothing of it outlives the process, and nothing of it has to.

    versions: what a worker must be made of (service.remote.fleet.versions)
    jobs: those that are not over, by id
    tickets: answers on their way to the record, by number
    trouble: why the database takes nothing, "" where it does
    now: s, of a clock that never goes back
    voiding: wrong workers whose chunks are still in the record
    instructions: what is to be done, not handed out yet
    """

    policy: Policy
    versions: dict[str, str]
    workers: Workers
    auditing: Auditing
    jobs: dict[str, JobState] = field(default_factory=dict)
    tickets: dict[int, Ticket] = field(default_factory=dict)
    trouble: str = ""
    now: float = float("-inf")
    voiding: set[str] = field(default_factory=set)
    instructions: list[E.Instruction] = field(default_factory=list)
    last_ticket: int = 0

    def do(self, instruction: E.Instruction) -> None:
        """Have it done after what was asked for before."""
        self.instructions.append(instruction)

    def send(self, request: int, reply: Reply) -> None:
        """Answer a worker that waits."""
        self.do(E.Send(request, reply))
