import json

import msgspec
import pytest

import ce
from service.analysis.exposure import Exposure, exposure_of
from service.analysis.failures.rerun import Rerun, Rerunner
from service.analysis.risk import BASELINES, POLICE_REPORTED, Risk, baseline_of, event_of, rate_of
from service.errors import InputError
from service.evaluation.job import Problem, make_job

EXPOSURE = Exposure(rollouts=40, km=0.2, km_ci=(0.19, 0.21), hours=0.003, confidence=0.95)
EVENT = "a time to collision of at most 0.5 s"


def test_a_rate_is_p_over_the_kilometres_and_holds_the_uncertainty_of_both():
    risk = rate_of(4e-4, (2e-4, 8e-4), 0.95, EXPOSURE, EVENT)
    assert risk.per_million_km == pytest.approx(2000.0)
    assert risk.per_million_km_ci == pytest.approx((2e-4 / 0.21 * 1e6, 8e-4 / 0.19 * 1e6))
    assert risk.km_between == pytest.approx(500.0)
    assert risk.km_between_ci == pytest.approx((0.19 / 8e-4, 0.21 / 2e-4))
    assert risk.times_baseline == pytest.approx(2000.0 / POLICE_REPORTED.per_million_km)
    assert "about 2,000 times per million km (95% interval 950 to 4,200)" in risk.summary
    assert "(240 to 1,000)" in risk.summary


def test_without_an_event_it_says_at_most():
    risk = rate_of(0.0, (0.0, 1e-4), 0.95, EXPOSURE, EVENT)
    assert risk.per_million_km == 0.0
    assert risk.km_between is None
    assert risk.km_between_ci[1] is None
    assert "at most 530 times per million km" in risk.summary
    assert "at least 1,900 km" in risk.summary


def test_what_it_assumes_goes_with_it():
    said = " ".join(rate_of(1e-4, (1e-5, 1e-3), 0.95, EXPOSURE, EVENT).assumptions)
    assert "0.200 km" in said
    assert "not a crash" in said
    assert POLICE_REPORTED.source in said


def test_it_goes_through_json_and_back():
    risk = rate_of(0.0, (0.0, 1e-4), 0.95, msgspec.structs.replace(EXPOSURE, km_ci=(0.0, 0.5)), EVENT)
    assert msgspec.convert(json.loads(msgspec.json.encode(risk)), Risk) == risk


def test_baselines_count_vehicles_as_an_ego_s_rate_does():
    assert baseline_of(None).per_million_km * 1.609344 == pytest.approx(4.68)
    assert baseline_of("any-injury").per_million_km * 1.609344 == pytest.approx(2.80)
    assert baseline_of("any-crash").per_million_km == pytest.approx(28.3, abs=0.05)
    for one in BASELINES.values():
        assert "vehicle" in one.name or one.name.startswith("near-crashes")
        assert "million vehicle miles" in one.source
    assert baseline_of("near-crash") == BASELINES["near-crash"]
    assert baseline_of("2.5", "our fleet, 2025").source == "our fleet, 2025"


@pytest.mark.parametrize("given", ["0", "-1", "nan", "inf", "many", ""])
def test_a_baseline_that_is_none_is_refused(given):
    with pytest.raises(InputError, match="events per million km"):
        baseline_of(given)


def test_the_event_is_named_after_the_measure(make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {})
    assert event_of(job) == EVENT


class Drives(Rerunner):
    """Drives of 100 m and more, every tenth failing."""

    asked = 0

    def run(self, drawn, traced=(), on_done=lambda count: None):
        self.asked += 1
        return [
            Rerun(1.0, "horizon", "lost" if k % 10 == 9 else None, driven_m=100.0 + k, time_s=10.0)
            for k in range(len(drawn))
        ]


def test_kilometres_are_measured_on_rollouts_of_p0_and_remembered(make_scenario, tmp_path):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {})
    base = Problem(job).base
    drives = Drives(job)
    first = exposure_of(job, base, drives, folder=tmp_path)
    assert first is not None
    assert first.rollouts == 36
    assert first.km == pytest.approx(0.119)
    assert first.km_ci[0] < first.km < first.km_ci[1]
    assert first.hours == pytest.approx(10 / 3600)
    assert exposure_of(job, base, drives, folder=tmp_path) == first
    assert drives.asked == 1
    other = make_job(job.scenario, "lidar", 0.5, "naive", 1, {})
    exposure_of(other, base, drives, folder=tmp_path)
    assert drives.asked == 2


def test_where_nothing_runs_no_kilometres_are_known(make_scenario):
    class Lost(Rerunner):
        def run(self, drawn, traced=(), on_done=lambda count: None):
            return [Rerun(float("nan"), "error", "lost") for _ in drawn]

    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {})
    assert exposure_of(job, ce.Product(list(Problem(job).base.blocks)), Lost(job)) is None
