"""What a job's dangerous rollouts come to, over the API: severity, what a competent driver would have prevented, and
which cells of the domain were tested."""

import msgspec

from service.analysis.coverage.cover import coverage_of
from service.analysis.coverage.objects import Coverage
from service.analysis.failures.events import events_of
from service.analysis.prevention.objects import Prevention
from service.analysis.prevention.onset import TTC_S
from service.analysis.prevention.prevent import DEFAULT, prevent
from service.analysis.severity.objects import Severity
from service.analysis.severity.severe import examine_severity, severity_of
from service.remote.api.requests import AskPrevention, AskSeverity, Nothing
from service.remote.api.rerunning import RerunningAnswers


class VerdictAnswers(RerunningAnswers):
    """What is answered on jobs/ID/severity, jobs/ID/prevention and jobs/ID/coverage."""

    def severity(self, asked: AskSeverity, job: str) -> Severity:
        state = self._records.state(job)
        most = self._limits.examined(asked.examine)

        def compute() -> Severity:
            record = self._records.record(state)
            with self._reruns.of(record.job) as rerunner:
                examined = examine_severity(events_of(record), rerunner, most=most)
            return msgspec.structs.replace(severity_of(job, examined), job=job)

        return self._background.get(("severity", state, most), compute)

    def prevention(self, asked: AskPrevention, job: str) -> Prevention:
        state = self._records.state(job)
        most = self._limits.examined(asked.examine)
        references = DEFAULT if asked.reference is None else (asked.reference,)
        ttc_s = TTC_S if asked.onset_ttc_s is None else asked.onset_ttc_s

        def compute() -> Prevention:
            record = self._records.record(state)
            found = prevent(
                job, record, references, most=most, onset_ttc_s=ttc_s, workers=self._limits.rerun_procs
            )
            return msgspec.structs.replace(found, job=job)

        return self._background.get(("prevention", state, references, most, ttc_s), compute)

    def coverage(self, asked: Nothing, job: str) -> Coverage:
        state = self._records.state(job)

        def compute() -> Coverage:
            return msgspec.structs.replace(coverage_of(job, self._records.record(state)), job=job)

        return self._background.get(("coverage", state), compute)
