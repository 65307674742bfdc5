"""A plan on a fleet: what is submitted once, found again, and read into the same results."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from service.analysis.estimate_parts import Rollouts
from service.errors import InputError
from service.evaluation.job import make_job
from service.remote.api import objects as O
from service.studies.reproduce.fleet import carry_out_on
from service.studies.reproduce.local import Watch
from service.studies.reproduce.page import page_of, write_page
from service.studies.reproduce.plans import plans_of
from service.world.scenario import load_scenario

P = {"naive": 0.002, "ce": 0.003, "splitting": 0.001}


class Service:
    """Answers as the API does; jobs are done at once, and estimates are P of their method at every threshold."""

    def __init__(self, fail: str = ""):
        self.jobs: list[SimpleNamespace] = []
        self.fail = fail

    def all_jobs(self):
        return iter(self.jobs)

    def submit(self, scenario, gamma, **others):
        options = others["options"] | {"budget": others["budget"]}
        make_job(
            load_scenario("i80-paper-10s"), others["ego"], gamma, others["method"], others["seed"], options
        )
        status = "failed" if others["method"] == self.fail else "done"
        job = SimpleNamespace(
            id=f"j{len(self.jobs)}", status=status, reason="no room", scenario=scenario, **others
        )
        self.jobs.append(job)
        return job

    def job(self, job):
        return next(j for j in self.jobs if j.id == job)

    def watch(self, job):
        budget = self.job(job).budget
        yield SimpleNamespace(kind="progress", body={"rollouts": budget // 2})
        yield SimpleNamespace(kind="status", body={})
        yield SimpleNamespace(kind="progress", body={"rollouts": budget})

    def estimate(self, job):
        found = self.job(job)
        n = Rollouts(total=found.budget, training=0, estimation=found.budget, failed=0)
        return SimpleNamespace(rollouts=n, method=found.method, warnings=(), variance_reliable=True, worker_s=1.0,
                               sim_s=1.0, wall_s=1.0, tailroad="1", max_weight_share=0.1)  # fmt: skip

    def curve(self, job, gammas):
        found = self.job(job)
        p = P[found.method]
        points = tuple(
            O.CurvePoint(
                gamma=g, p=p, std_error=p / 10, ci=(p / 2, 2 * p), events=round(p * found.budget), ess=9.0
            )
            for g in gammas
        )
        return O.Curve(job=job, confidence=0.95, points=points)


def test_jobs_are_submitted_once_and_their_results_make_the_page(tmp_path):
    (plan,) = plans_of("table1", "small")
    service, told = Service(), []
    outcome = carry_out_on(service, plan, Watch(on_rollouts=told.append))
    assert sum(told) == plan.rollouts
    assert len(service.jobs) == 1 + len(plan.runs)
    events = round(P["naive"] * plan.truth.rollouts)
    assert outcome.truth.at(plan.gammas)["events"].tolist() == [events] * len(plan.gammas)
    assert {r.run.method: r.readings[0].p for r in outcome.results} == {"ce": 0.003, "splitting": 0.001}
    again = carry_out_on(service, plan, Watch())
    assert len(service.jobs) == 1 + len(plan.runs)
    assert again.results == outcome.results
    path = write_page(page_of(outcome, "tailroad reproduce table1 --connect HOST"), tmp_path)
    text = path.read_text(encoding="utf-8")
    assert "1.5 (" in text  # the ratio of rare events, 0.003 / 0.002
    assert "all of them in SUMO" in text


def test_a_ground_truth_alone_tells_its_quantiles(tmp_path):
    (plan,) = plans_of("truth", "small")
    outcome = carry_out_on(Service(), plan, Watch())
    text = write_page(page_of(outcome, "tailroad reproduce truth"), tmp_path).read_text(encoding="utf-8")
    assert "| p | γ | 95% interval | events |" in text


def test_searched_noise_is_sent_by_value_and_can_be_run():
    (plan,) = plans_of("beyond", "smoke")
    service = Service()
    carry_out_on(service, plan, Watch())
    sent = [job.scenario for job in service.jobs if isinstance(job.scenario, dict)]
    assert sent
    assert all(scenario["drivers"]["noise_mode"] == "searched" for scenario in sent)
    assert sent[0]["format"] == 1


def test_a_job_that_failed_is_told_and_submitted_anew():
    (plan,) = plans_of("table1", "smoke")
    service = Service(fail="ce")
    with pytest.raises(InputError, match="no room"):
        carry_out_on(service, plan, Watch())
    service.fail = ""
    carry_out_on(service, plan, Watch())
