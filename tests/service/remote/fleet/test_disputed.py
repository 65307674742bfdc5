"""While workers disagree, whatever is made of a job's record says so beside p; afterwards it does not."""

from __future__ import annotations

import threading
from datetime import UTC, datetime

import msgspec
import numpy as np

from service.analysis.report import report_of
from service.evaluation.job import make_job
from service.remote.api.records import Records
from service.remote.fleet.messages import Answer, Lease
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import (
    LIMIT_S,
    LightFleet,
    LightReferee,
    LightRunner,
    LightWorker,
    light_answer,
    light_fleet,
)

POLICY = Policy(first_rows=20, max_rows=40, hold_s=0.3, audit_share=1.0, copy_s=1e6, open_audits=1000)
NOW = datetime(2026, 1, 1, tzinfo=UTC)


class SlowReferee(LightReferee):
    """Settles nothing before it is let."""

    def __init__(self) -> None:
        super().__init__()
        self.let = threading.Event()

    def replay(self, spec, lease):
        assert self.let.wait(LIMIT_S)
        return super().replay(spec, lease)


class Wrong(LightRunner):
    """A little too high, always."""

    def run(self, lease: Lease) -> Answer:
        good = light_answer(self.worker, lease)
        return msgspec.structs.replace(good, f=np.nextafter(np.frombuffer(good.f), np.inf).tobytes())


def report(fleet: LightFleet, job: str) -> tuple[dict, str]:
    records = Records(fleet.fleet)
    made = report_of(job, [records.record(records.state(job))], drawn=0, now=NOW)
    return made.facts, made.html


def named(fleet: LightFleet, job: str) -> list[str]:
    return [warning["name"] for warning in fleet.fleet.estimate(job)["warnings"]]


def test_report_estimate_and_show_say_disputed_while_a_dispute_lasts(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 200, "batch_size": 100})
    referee = SlowReferee()
    with light_fleet(tmp_path, POLICY, referee=referee) as fleet:
        name = fleet.fleet.submit(job).id
        workers = [LightWorker(fleet.port, "wrong", Wrong), LightWorker(fleet.port, "right")]
        fleet.wait(lambda told: any(e.kind == "disputed" for e in told))
        assert fleet.fleet.job(name).disputed
        assert named(fleet, name)[0] == "disputed"
        facts, html = report(fleet, name)
        assert facts["headline"]["doubt"].startswith("Disputed: workers disagree on some of its rollouts")
        assert facts["headline"]["settled"] is False
        assert '<p id="doubt"><strong>Disputed: workers disagree on some of its rollouts' in html
        referee.let.set()
        fleet.wait_status(name, "done")
        assert "disputed" not in named(fleet, name)
        facts, html = report(fleet, name)
        assert facts["headline"]["doubt"] == ""
        assert 'id="doubt"' not in html
        for worker in workers:
            worker.stop()


def test_the_report_of_a_job_that_failed_says_so_beside_p(tmp_path, make_scenario):
    class Clueless(LightReferee):
        def replay(self, spec, lease):
            return "there is no SUMO here"

    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 200, "batch_size": 100})
    with light_fleet(tmp_path, POLICY, referee=Clueless()) as fleet:
        name = fleet.fleet.submit(job).id
        workers = [LightWorker(fleet.port, "wrong", Wrong), LightWorker(fleet.port, "right")]
        fleet.wait_status(name, "failed")
        facts, _ = report(fleet, name)
        assert facts["headline"]["doubt"].startswith("Job failed: the job has failed: disputed: ")
        assert facts["headline"]["settled"] is False
        for worker in workers:
            worker.stop()
