"""Rollouts of a job run once more, over the API: its failures, any one of them, and exports. All take a while."""

import base64
from typing import Any

import msgspec
import numpy as np

import ce
from service.analysis.exports import FORMATS, export_bytes
from service.analysis.failures.events import CHAINS
from service.analysis.failures.find import find_failures
from service.analysis.failures.objects import Failures
from service.analysis.failures.play import playback_of
from service.analysis.failures.rerun import Rerun
from service.analysis.failures.scenario_file import scenario_text
from service.analysis.prevention.conflict import driven_by
from service.analysis.video import EgoView, jpeg_pictures
from service.evaluation.drawn_again import drawn_again
from service.evaluation.record import JobRecord
from service.remote.api.files import File
from service.remote.api.objects import CameraPicture, RolloutView
from service.remote.api.problems import ApiError, Wrong
from service.remote.api.records import State
from service.remote.api.requests import AskExport, AskFailures, AskRollout
from service.remote.api.rerunning import RerunningAnswers
from service.remote.api.results import finite
from service.world.scenario.noise import Noise


class DangerousAnswers(RerunningAnswers):
    """What is answered on jobs/ID/failures, jobs/ID/rollouts/ROW and its export."""

    def failures(self, asked: AskFailures, job: str) -> Failures:
        state = self._records.state(job)
        most = self._limits.examined(asked.examine)

        def compute() -> Failures:
            record = self._records.record(state, None, asked.outcome)
            with self._reruns.of(record.job) as rerunner:
                found = find_failures(job, record, rerunner, asked.by, asked.limit, most)
            return msgspec.structs.replace(found.failures, job=job)

        return self._background.get(("failures", state, asked.by, asked.limit, most, asked.outcome), compute)

    def rollout(self, asked: AskRollout, job: str, row: str) -> RolloutView:
        number = _row(row)
        if asked.camera > self._limits.camera_pictures:
            most = self._limits.camera_pictures
            wrong = Wrong("camera", str(asked.camera), f"at most {most}")
            raise ApiError(
                "bad-parameter", f"camera is {asked.camera}: give at most {most} pictures", (wrong,)
            )
        state = self._records.state(job)
        return self._background.get(
            ("rollout", state, asked, number), lambda: self._rollout(state, asked, number)
        )

    def export(self, asked: AskExport, job: str, row: str) -> File:
        number, state = _row(row), self._records.state(job)

        def compute() -> File:
            record = self._records.record(state)
            phase, iteration, _ = self._recorded(state, record, asked, number)
            x, noise_seed = self._drawn(state, record, phase, iteration, number)
            title = _title(job, phase, iteration, number)
            return File(
                FORMATS[asked.format][0], export_bytes(record.job, x, noise_seed, title, asked.format)
            )

        return self._background.get(("export", state, asked, number), compute)

    def _recorded(
        self, state: State, record: JobRecord, asked: AskRollout | AskExport, row: int
    ) -> tuple[str, int, float]:
        """The phase and iteration that are meant, and f on record; ApiError where the record has no such rollout.

        A method that moves chains calls all its batches training; its estimate is made of them.
        """
        phase: str = asked.phase
        iteration = asked.iteration
        if phase == "estimate" and isinstance(record.estimate, ce.ReplicatedEstimate):
            phase = CHAINS
        if iteration is None:
            iteration = record.estimate_iteration if phase == "estimate" else 0
        recorded = self._records.fleet.reader(state[0]).chunks(state[0], phase, iteration, row, row + 1)
        if not recorded or (phase, iteration) not in record.parameters:
            raise ApiError(
                "not-found",
                f"the record has no rollout {row} of phase {phase}, iteration {iteration}; "
                f"{sum(1 for known, _ in record.parameters if known == phase)} iterations of it are complete",
            )
        return phase, iteration, float(recorded[0].f[row - recorded[0].start])

    def _drawn(
        self, state: State, record: JobRecord, phase: str, iteration: int, row: int
    ) -> tuple[np.ndarray, Noise]:
        return drawn_again(self._records.fleet.reader(state[0]), record, phase, iteration, row)

    def _rollout(self, state: State, asked: AskRollout, row: int) -> RolloutView:
        job, record = state[0], self._records.record(state)
        phase, iteration, f = self._recorded(state, record, asked, row)
        x, noise_seed = self._drawn(state, record, phase, iteration, row)
        looked_at = asked.trace or asked.playback or asked.camera
        if asked.reference is not None:
            again = driven_by(record.job, asked.reference, x, noise_seed)
        else:
            with self._reruns.of(record.job) as runner:
                (again,) = runner.run([(x, noise_seed)], [0] if looked_at else ())
        same = np.float64(again.f).tobytes() == np.float64(f).tobytes() or (np.isnan(again.f) and np.isnan(f))
        title = _title(job, phase, iteration, row)
        trace = again.trace
        return RolloutView(
            job=job,
            phase=phase,
            iteration=iteration,
            row=row,
            noise_seed=str(noise_seed),
            f=finite(f),
            f_again=finite(float(again.f)),
            same_to_the_bit=bool(same),
            dangerous=f <= record.estimate.gamma,
            outcome=again.outcome,
            error=again.error,
            motion=None if again.motion is None else finite(msgspec.to_builtins(again.motion)),
            scenario=scenario_text(record.problem, x, noise_seed, again.f, title),
            trace=_columns(trace) if asked.trace and trace is not None else None,
            playback=_playback(record, again) if asked.playback else None,
            camera=self._camera(record, again, x, noise_seed, asked.camera) if asked.camera else None,
        )

    def _camera(
        self, record: JobRecord, again: Rerun, x: np.ndarray, noise_seed: Noise, count: int
    ) -> tuple[CameraPicture, ...] | None:
        if again.trace is None:
            return None
        view = EgoView(record.job.scenario, record.problem.corridor, x, int(noise_seed))
        time_s = again.trace.time_s
        return tuple(
            CameraPicture(state=k, time_s=float(time_s[k]), jpeg=base64.b64encode(jpeg).decode("ascii"))
            for k, jpeg in jpeg_pictures(view, again.trace, count, self._limits.camera_width_px)
        )


def _row(row: str) -> int:
    if not (row.isascii() and row.isdigit() and len(row) <= 18):
        raise ApiError("not-found", f"rollouts/{row[:50]}: give the row as a whole number")
    return int(row)


def _title(job: str, phase: str, iteration: int, row: int) -> str:
    return f"Rollout {row} of phase {phase}, iteration {iteration}, job {job}"


def _playback(record: JobRecord, again: Rerun) -> Any:
    if again.trace is None:
        return None
    threat = None if again.motion is None else again.motion.other
    rays = record.job.scenario.safety.rays
    return playback_of(again.trace, record.problem.corridor, record.job.gamma, threat, rays)


def _columns(trace: Any) -> dict[str, list[Any]]:
    return finite(trace.table().to_dict(as_series=False))
