"""An ego over the network whose f depends on what it did before is named on its job's estimate."""

from __future__ import annotations

import msgspec
import numpy as np

from service.evaluation.job import make_job
from service.remote.fleet.messages import Answer, Lease
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import LightRunner, LightWorker, light_answer, light_fleet

POLICY = Policy(first_rows=20, max_rows=40, hold_s=0.3, audit_share=0.2, copy_s=1e6, open_audits=1000)


class Remembering(LightRunner):
    """Drives a little less well each time."""

    chunks = 0

    def run(self, lease: Lease) -> Answer:
        self.chunks += 1
        good = light_answer(self.worker, lease)
        return msgspec.structs.replace(good, f=(np.frombuffer(good.f) + 1e-6 * self.chunks).tobytes())


def test_an_ego_that_remembers_is_named_on_the_estimate_and_its_worker_is_not_blamed(tmp_path, make_scenario):
    told = {}
    for runner in (Remembering, LightRunner):
        (tmp_path / runner.__name__).mkdir()
        job = make_job(make_scenario(), "zenoh:box", 0.5, "naive", 1, {"budget": 400, "batch_size": 200})
        with light_fleet(tmp_path / runner.__name__, POLICY) as fleet:
            name = fleet.fleet.submit(job).id
            worker = LightWorker(fleet.port, "w", runner)
            fleet.wait_status(name, "done")
            assert not any(w.quarantine for w in fleet.fleet.workers())
            worker.stop()
            warnings = {w["name"]: w["message"] for w in fleet.fleet.estimate(name)["warnings"]}
            told[runner] = warnings.get("ego-not-repeatable")
            events = fleet.store.events_of(name, "repeated")
        assert events
        assert {event.body["where"] for event in events} == {"same"}  # there is no other worker
    assert "on the worker that had run them, 0 of 0 on another one" in told[Remembering]
    assert told[LightRunner] is None
