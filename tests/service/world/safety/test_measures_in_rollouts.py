"""Every measure as the f of rollouts: the smallest of its trace, the same bits again, part of the job."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

import ce
from service.analysis.trace import record
from service.errors import InputError, ScenarioError
from service.evaluation.job import Job, Problem, make_job
from service.world.safety.measure import with_measure
from service.world.scenario.measures import MEASURES, STL, measure_kind

FORMULA = "stl: always(ttc_s >= 1.0 or eventually[0:0.5 s](acceleration_mps2 < 0))"
NAMES = [FORMULA if name == STL else name for name in MEASURES]
TWO_SECONDS = {"horizon_s = 10.0": "horizon_s = 2.0"}
BACKGROUND = "\n[background]\ndensity_veh_per_km_lane = 12.0\nspeed_mps = 15.0\n"


@pytest.mark.parametrize("more", ["", BACKGROUND], ids=["alone", "with background"])
@pytest.mark.parametrize("measure", NAMES, ids=lambda name: name[:12])
def test_f_is_the_smallest_value_of_the_trace_and_the_same_bits_again(make_scenario, measure, more):
    scenario = with_measure(make_scenario(TWO_SECONDS, more), measure)
    job = make_job(scenario, "idm", 0.5, "naive", 1, {})
    assert msgspec.json.decode(msgspec.json.encode(job), type=Job) == job
    problem = Problem(job)
    x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 3)
    with problem.simulator() as simulator:
        traces = [
            record(problem, simulator, row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)
        ]
        again = [simulator.run(row, int(seed)) for row, seed in zip(x, noise_seeds, strict=True)]
    for trace, second in zip(traces, again, strict=True):
        assert trace.rollout.error is None
        assert trace.rollout == second
        assert trace.measured.shape == trace.time_s.shape
        expected = trace.measured[0] if measure == FORMULA else trace.measured.min()
        assert trace.rollout.f == expected
        assert not np.isnan(trace.measured).any()
        assert trace.table()["f"].n_unique() == len(set(trace.measured))


def test_the_formula_of_the_time_to_collision_is_the_time_to_collision(make_scenario):
    scenario = make_scenario(TWO_SECONDS)
    f = {}
    for measure in ("ttc", "stl: always(ttc_s >= 0.25)", "box-ttc", "stl: always(box_ttc_s > 0)"):
        problem = Problem(make_job(with_measure(scenario, measure), "idm", 0.5, "naive", 1, {}))
        x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 5)
        with problem.simulator() as simulator:
            f[measure] = [
                min(simulator.run(row, int(seed)).f, 1000.0) for row, seed in zip(x, noise_seeds, strict=True)
            ]
    margins = [value - 0.25 for value in f["ttc"]]
    assert [v for v in f["stl: always(ttc_s >= 0.25)"] if v < 999] == [v for v in margins if v < 999]
    assert f["stl: always(box_ttc_s > 0)"] == f["box-ttc"]


def test_background_traffic_is_measured_too(make_scenario):
    """The vehicles that SUMO drives come closer than the six controlled ones."""
    closest = []
    for more in ("", BACKGROUND):
        scenario = with_measure(make_scenario(TWO_SECONDS, more), "stl: always(clearance_m >= 0)")
        problem = Problem(make_job(scenario, "idm", 0.5, "naive", 1, {}))
        x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 6)
        with problem.simulator() as simulator:
            closest.append(
                [simulator.run(row, int(seed)).f for row, seed in zip(x, noise_seeds, strict=True)]
            )
    alone, among = (np.array(values) for values in closest)
    assert (alone < 1000.0).all()
    assert (among < 1000.0).all()
    assert (among != alone).any()


@pytest.mark.parametrize(
    ("measure", "told"),
    [
        ("rsss", "no such measure; did you mean 'rss'"),
        ("stl:", "give its formula too"),
        ("ttc: always(ttc_s > 1)", "only stl has a formula"),
        ("stl: always(ttc > 1)", "no signal 'ttc'"),
        ("", "there are ttc, box-ttc"),
    ],
)
def test_a_measure_that_cannot_be_is_refused(make_scenario, measure, told):
    with pytest.raises(InputError, match=told):
        with_measure(make_scenario(), measure)


def test_a_scenario_file_names_its_measure_and_its_parameters(make_scenario):
    scenario = make_scenario(
        {'measure = "ttc"': 'measure = "rss"', "rays = 20": "rays = 20\nrss.response_s = 0.5"}
    )
    assert scenario.safety.measure == "rss"
    assert scenario.safety.rss.response_s == 0.5
    assert measure_kind(scenario.safety.measure).unit == "m"
    with pytest.raises(ScenarioError, match=r"safety\.measure is 'rs': no such measure; did you mean 'rss'"):
        make_scenario({'measure = "ttc"': 'measure = "rs"'})
    with pytest.raises(ScenarioError, match=r"safety\.rss\.response_s is 0\.0: give 0\.01 to 100"):
        make_scenario({"rays = 20": "rays = 20\nrss.response_s = 0.0"})
    formula = make_scenario({'measure = "ttc"': 'measure = "stl: always(ttc > 1)"'})
    with pytest.raises(InputError, match="no signal 'ttc'"):
        make_job(formula, "idm", 0.5, "naive", 1, {})


def test_a_failed_rollout_has_no_value(make_scenario):
    scenario = with_measure(make_scenario(TWO_SECONDS), "rss")
    problem = Problem(make_job(scenario, "idm", 0.5, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 1)
    with problem.simulator() as simulator:
        trace = record(problem, simulator, np.full_like(x[0], np.nan), int(noise_seeds[0]))
    assert trace.rollout.error is not None
    assert math.isnan(trace.rollout.f)
    assert np.isnan(trace.measured).all()
