"""What jobs come to beyond numbers, over the API: what the search learned, comparison, risk, report."""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import msgspec

from service.analysis.comparison.compare import comparison_of
from service.analysis.comparison.objects import Comparison
from service.analysis.exposure import exposure_of
from service.analysis.failures.rerun import Rerunner
from service.analysis.learned.learn import learned_of
from service.analysis.learned.objects import Learned
from service.analysis.learned.scatter import scatter_of
from service.analysis.learned.scatter_objects import Scatter
from service.analysis.report import Made, report_of
from service.analysis.report.objects import Report
from service.analysis.risk import Risk, baseline_of, risk_of
from service.evaluation.record import JobRecord
from service.remote.api.files import File
from service.remote.api.problems import ApiError, Wrong, short
from service.remote.api.requests import AskComparison, AskLearned, AskReport, AskRisk, AskScatter
from service.remote.api.rerunning import RerunningAnswers

Found = TypeVar("Found")


class FindingAnswers(RerunningAnswers):
    """What is answered on jobs/ID/learned, scatter, risk, report, report.json, and on comparison."""

    def learned(self, asked: AskLearned, job: str) -> Learned:
        return self._searched("learned", job, asked.rollouts, learned_of)

    def scatter(self, asked: AskScatter, job: str) -> Scatter:
        return self._searched("scatter", job, asked.rollouts, scatter_of)

    def _searched(
        self, name: str, job: str, asked: int, found: Callable[[str, JobRecord, Rerunner, int], Found]
    ) -> Found:
        """What a search found, by rollouts that are run again: as many as are asked for, within limits."""
        state, rollouts = self._records.state(job), min(asked, self._limits.examine)

        def compute() -> Found:
            record = self._records.record(state)
            with self._reruns.of(record.job) as rerunner:
                return found(job, record, rerunner, rollouts)

        return self._background.get((name, state, rollouts), compute)

    def risk(self, asked: AskRisk, job: str) -> Risk:
        baseline = baseline_of(asked.baseline, asked.source)
        state = self._records.state(job)

        def compute() -> Risk:
            record = self._records.record(state, asked.gamma)
            estimate = record.estimate
            if asked.confidence is not None:
                estimate = replace(estimate, confidence=asked.confidence)
            with self._reruns.of(record.job) as rerunner:
                exposure = exposure_of(record.job, record.problem.base, rerunner, estimate.confidence)
            if exposure is None:
                raise ApiError(
                    "unavailable", "no rollout of P0 could be run to measure how far the ego drives"
                )
            return risk_of(record.job, estimate, exposure, baseline)

        return self._background.get(("risk", state, asked), compute)

    def comparison(self, asked: AskComparison) -> Comparison:
        jobs = [name for name in asked.jobs.split(",") if name]
        if not 2 <= len(set(jobs)) == len(jobs) <= self._limits.compared:
            expected = f"2 to {self._limits.compared} different jobs, separated by commas"
            wrong = Wrong("jobs", short(asked.jobs), expected)
            raise ApiError("bad-parameter", f"jobs is {short(asked.jobs)!r}: give {expected}", (wrong,))
        states = tuple(self._records.state(job) for job in jobs)
        most = self._limits.examine if asked.examine is None else min(asked.examine, self._limits.examine)

        def compute() -> Comparison:
            found = [self._records.record(state, asked.gamma) for state in states]
            return comparison_of(found, jobs, most, opened=self._reruns.of)

        return self._background.get(("comparison", states, asked.gamma, most), compute)

    def report(self, asked: AskReport, job: str) -> File:
        return File("text/html", self._made(asked, job).html.encode())

    def report_json(self, asked: AskReport, job: str) -> Report:
        return msgspec.convert(self._made(asked, job).facts, Report)

    def _made(self, asked: AskReport, job: str) -> Made:
        baseline = baseline_of(asked.baseline, asked.source)
        state = self._records.state(job)

        def compute() -> Made:
            record = self._records.record(state)
            return report_of(job, [record], asked.drawn, baseline=baseline, opened=self._reruns.of)

        return self._background.get(("report", state, asked), compute)
