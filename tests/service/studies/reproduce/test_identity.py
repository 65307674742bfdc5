"""What a ground truth's digest covers: all that decides rollouts, and nothing else."""

from pathlib import Path

import msgspec
import pytest

from service.evaluation.job import Job, make_job
from service.evaluation.sources import code_alone
from service.studies.reproduce.identity import decisive, digest_of
from service.studies.reproduce.local import truth_path
from service.studies.reproduce.plans import Truth, plans_of
from service.studies.reproduce.truth import read_truth, truth_job
from service.world.scenario import load_scenario
from service.world.scenario.schema import Rss, Scenario
from service.world.scenario.schema import Safety as SafetyTable

TRUTHS = Path(__file__).parents[4] / "deploy/results/truths"
KEPT = sorted(TRUTHS.glob("*.npz"))


def job_of(scenario: Scenario, ego: str = "lidar", seed: int = 3) -> Job:
    return make_job(scenario, ego, 0.5, "naive", seed, {"budget": 10})


def test_names_descriptions_and_values_at_their_defaults_do_not_matter():
    scenario = load_scenario("i80-paper-10s")
    renamed = msgspec.structs.replace(scenario, name="other", description="another text")
    assert digest_of(job_of(renamed)) == digest_of(job_of(scenario))
    assert "safety" not in decisive(scenario)
    assert decisive(scenario)["time"] == {"horizon_s": 10.0}


def test_whatever_decides_rollouts_does():
    scenario = load_scenario("i80-paper-10s")
    replace = msgspec.structs.replace
    others = [
        job_of(replace(scenario, safety=SafetyTable(measure="drac"))),
        job_of(replace(scenario, safety=SafetyTable(rss=Rss(response_s=0.5)))),
        job_of(replace(scenario, time=replace(scenario.time, horizon_s=9.0))),
        job_of(replace(scenario, drivers=replace(scenario.drivers, weights="drivers-bc"))),
        job_of(
            replace(scenario, network=replace(scenario.network, road="us101"), vehicles=scenario.vehicles[:5])
        ),
        job_of(load_scenario("i80-paper")),
        job_of(scenario, ego="idm"),
        job_of(scenario, ego="sumo:Krauss"),
        job_of(scenario, ego="sumo:IDM"),
        job_of(scenario, seed=4),
    ]
    digests = {digest_of(job) for job in (job_of(scenario), *others)}
    assert len(digests) == len(others) + 1


def test_code_is_read_without_its_comments_its_types_and_its_form():
    code = 'def f(a):\n    """Says so."""\n    b = 1\n    return f"{a} b" if a else {"x": 1}  # why\n'
    same = (
        "from collections.abc import Sequence\n\n\n"
        'def f(\n    a: Sequence[int],\n) -> object:\n    """Says it otherwise,\n    and longer."""\n\n    b: int = 1\n'
        '    return f"{a} b" if a else {\n"x": 1}\n'
    )
    assert code_alone(code) == code_alone(same)
    assert code_alone(code) != code_alone(code.replace('"x": 1', '"x": 2'))
    assert code_alone(code) != code_alone(code.replace("    return", "    a += 1\n    return"))
    assert code_alone(code) != code_alone("from math import exp\n" + code)
    nested = "if a:\n    b()\n    c()\n"
    assert code_alone(nested) != code_alone("if a:\n    b()\nc()\n")


@pytest.mark.parametrize("path", KEPT, ids=[path.stem for path in KEPT])
def test_the_kept_ground_truths_are_of_todays_rollouts(path):
    ran = read_truth(path).ran
    truth = Truth(scenario=ran.scenario, ego=ran.ego, rollouts=1, seed=ran.seed)
    assert digest_of(truth_job(truth)) == ran.digest, (
        "code that may decide these rollouts has changed: see service/studies/reproduce/spot_check.py"
    )
    assert truth_path(truth, TRUTHS) == path


def test_the_plans_go_on_from_the_kept_ground_truths():
    wanted = {
        truth_path(plan.truth, TRUTHS)
        for name in ("truth", "table2", "worlds")
        for plan in plans_of(name, "smoke")
    }
    assert set(KEPT) == {path for path in wanted if "zenoh" not in path.name}
