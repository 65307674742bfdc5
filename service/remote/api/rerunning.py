"""What answers need that run rollouts of a job once more."""

from service.remote.api.background import Background
from service.remote.api.limits import Limits
from service.remote.api.records import Records
from service.remote.api.reruns import Reruns


class RerunningAnswers:
    """Answers from a job's record for which its rollouts are run again, in the background and within limits."""

    def __init__(self, records: Records, background: Background, limits: Limits, reruns: Reruns):
        self._records, self._background, self._limits = records, background, limits
        self._reruns = reruns
