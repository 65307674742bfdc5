"""Rollouts of a job run once more, over the API: its failures, and any one of them. Both take a while."""

import threading
from collections import OrderedDict
from typing import Any

import msgspec
import numpy as np

from service.api.background import Background
from service.api.limits import Limits
from service.api.objects import RolloutView
from service.api.problems import ApiError
from service.api.requests import AskFailures, AskRollout
from service.api.results import finite
from service.failures.find import find_failures
from service.failures.objects import Failures
from service.failures.rerun import Rerunner
from service.failures.scenario_file import scenario_text
from service.fleet.service import Fleet
from service.record import JobRecord

KEPT_RECORDS = 2
State = tuple[str, str, int | None]  # job, status, rollouts: what a record is of


class DangerousAnswers:
    """What is answered on jobs/ID/failures and jobs/ID/rollouts/N."""

    def __init__(self, fleet: Fleet, background: Background, limits: Limits):
        self._fleet, self._background, self._limits = fleet, background, limits
        self._records: OrderedDict[State, JobRecord] = OrderedDict()
        self._lock = threading.Lock()

    def failures(self, asked: AskFailures, job: str) -> Failures:
        state = self._state(job)
        most = min(asked.examine or self._limits.examine, self._limits.examine)

        def compute() -> Failures:
            record = self._record(state)
            with Rerunner(record.job, self._limits.rerun_procs) as rerunner:
                found = find_failures(job, record, rerunner, asked.by, asked.limit, most)
            return msgspec.structs.replace(found.failures, job=job)

        return self._background.get(("failures", state, asked.by, asked.limit, most), compute)

    def rollout(self, asked: AskRollout, job: str, row: str) -> RolloutView:
        if not (row.isascii() and row.isdigit() and len(row) <= 18):
            raise ApiError("not-found", f"rollouts/{row[:50]}: give the row as a whole number")
        state = self._state(job)
        return self._background.get(
            ("rollout", state, asked, row), lambda: self._rollout(state, asked, int(row))
        )

    def _state(self, job: str) -> State:
        view = self._fleet.job(job)
        return job, view.status, view.rollouts

    def _record(self, state: State) -> JobRecord:
        with self._lock:
            known = self._records.get(state)
        if known is None:
            known = self._fleet.record(state[0])
            with self._lock:
                for old in [s for s in self._records if s[0] == state[0]]:
                    del self._records[old]
                self._records[state] = known
                while len(self._records) > KEPT_RECORDS:
                    self._records.popitem(last=False)
        return known

    def _rollout(self, state: State, asked: AskRollout, row: int) -> RolloutView:
        job, record = state[0], self._record(state)
        iteration = asked.iteration
        if iteration is None:
            iteration = record.estimate_iteration if asked.phase == "estimate" else 0
        recorded = self._fleet.reader(job).chunks(job, asked.phase, iteration, row, row + 1)
        if not recorded or (asked.phase, iteration) not in record.parameters:
            raise ApiError(
                "not-found",
                f"the record has no rollout {row} of phase {asked.phase}, iteration {iteration}; "
                f"{sum(1 for phase, _ in record.parameters if phase == asked.phase)} iterations of it are complete",
            )
        f = float(recorded[0].f[row - recorded[0].start])
        x, noise = record.redraw(asked.phase, iteration, row)
        with Rerunner(record.job) as runner:
            (again,) = runner.run([(x, noise)], [0] if asked.trace else ())
        same = np.float64(again.f).tobytes() == np.float64(f).tobytes() or (np.isnan(again.f) and np.isnan(f))
        title = f"Rollout {row} of phase {asked.phase}, iteration {iteration}, job {job}"
        return RolloutView(
            job=job,
            phase=asked.phase,
            iteration=iteration,
            row=row,
            noise_seed=str(noise),
            f=finite(f),
            f_again=finite(float(again.f)),
            same_to_the_bit=bool(same),
            dangerous=f <= record.job.gamma,
            outcome=again.outcome,
            error=again.error,
            motion=None if again.motion is None else finite(msgspec.to_builtins(again.motion)),
            scenario=scenario_text(record.problem, x, noise, again.f, title),
            trace=None if again.trace is None else _columns(again.trace),
        )


def _columns(trace: Any) -> dict[str, list[Any]]:
    return finite(trace.table().to_dict(as_series=False))
