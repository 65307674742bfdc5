"""What can go wrong in asking a service: it refuses, or nobody answers."""

from service.errors import TailroadError
from service.remote.api.objects import Problem


class Refused(TailroadError):
    """The service's problem details are in `problem`; its `type` ends with the kind."""

    def __init__(self, problem: Problem):
        super().__init__(problem.detail or problem.title)
        self.problem = problem

    @property
    def kind(self) -> str:
        """The last part of the problem's type, as in no-such-job."""
        return self.problem.type.rpartition(":")[2]


class NoAnswer(TailroadError):
    """Nobody answered in time."""
