"""The records of jobs as answers need them, the last few kept: replaying one reads all of it."""

import threading
from collections import OrderedDict
from dataclasses import replace

import ce
from service.evaluation.doubts import with_doubts
from service.evaluation.record import JobRecord
from service.evaluation.store.jobs import Mark
from service.remote.fleet.service import Fleet

KEPT = 4
# a job, how its record is, and what is doubted of it: equal ones give equal answers
State = tuple[str, Mark, tuple[ce.EstimateWarning, ...]]


class Records:
    """Of one fleet; may be called from any thread."""

    def __init__(self, fleet: Fleet):
        self.fleet = fleet
        self._kept: OrderedDict[tuple[State, float | None, str | None], JobRecord] = OrderedDict()
        self._lock = threading.Lock()

    def state(self, job: str) -> State:
        """What a record of the job would be of now; NoSuchJob where there is no such job."""
        return job, self.fleet.mark(job), self.fleet.doubts(job)

    def record(self, state: State, gamma: float | None = None, outcome: str | None = None) -> JobRecord:
        """The record.

        gamma: of the event f <= gamma instead of the job's own
        outcome: of the event that a rollout ends so
        """
        key = state, gamma, outcome
        with self._lock:
            known = self._kept.get(key)
            if known is not None:
                self._kept.move_to_end(key)
        if known is None:
            known = self.fleet.record(state[0], gamma, outcome)
            known = replace(known, estimate=with_doubts(known.estimate, state[2]))
            with self._lock:
                for old in [k for k in self._kept if k[0][0] == state[0] and k[0] != state]:
                    del self._kept[old]
                self._kept[key] = known
                while len(self._kept) > KEPT:
                    self._kept.popitem(last=False)
        return known
