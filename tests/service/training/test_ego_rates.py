"""An ego's contacts per million km: rollouts those of the service, chunks kept, added up and told apart."""

import json

import pytest

import ce
from policies.drivers import load_drivers
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.training import rates
from service.world.safety.contact import Contact
from service.world.scenario import load_scenario
from service.world.sim.without_sumo import WithoutSumo


def contact(striking: str, speed_mps: float) -> Contact:
    return Contact(1, speed_mps, -speed_mps, 0.0, "front", "left", "rear", "right", striking)


def test_a_chunk_holds_what_its_rollouts_came_to(monkeypatch):
    monkeypatch.setattr(rates, "CHUNK", 30)
    scenario = load_scenario("i80-paper-10s")
    driven = rates.Driven(scenario, "lidar-paper", 1)
    found = driven.chunk(0)
    driven.close()
    drivers = load_drivers(scenario.drivers.weights)
    problem = Problem(make_job(scenario, "lidar-paper", 0.0, "naive", 1, {}))
    alone = WithoutSumo(scenario, problem.corridor, drivers, "lidar-paper")
    x, seeds = ce.draw(problem.base, 1, "estimate", 0, 0, 30)
    expected = [alone.run(row, int(seed)) for row, seed in zip(x, seeds, strict=True)]
    assert sum(found.outcomes.values()) == 30
    assert found.outcomes["horizon"] == sum(one.outcome == "horizon" for one in expected)
    assert [touch.contact for touch in found.contacts] == [one.contact for one in expected if one.contact]
    assert 0.1 * 30 < found.km < 0.2 * 30


def test_contacts_are_rated_by_who_ran_into_whom_and_by_impact_speed():
    scenario = load_scenario("i80-10s")
    touches = [rates.Touch(3, 1.2, contact("ego", 6.0)), rates.Touch(7, 9.0, contact("other", 1.5))]
    chunks = [rates.Chunk("k", 0, 80.0, {"horizon": 498, "collision": 2}, touches, 5),
              rates.Chunk("k", 1, 120.0, {"horizon": 500}, [], 4)]  # fmt: skip
    found = rates.facts(scenario, "lidar", chunks)
    assert (found["rollouts"], found["km"], found["in_sumo"]) == (2 * rates.CHUNK, 200.0, 9)
    assert found["outcomes"] == {"horizon": 998, "collision": 2}
    assert found["contacts"]["per_million_km"] == 10_000.0
    assert found["runs_into_the_other"]["count"] == 1
    assert found["share_that_it_runs_into"]["value"] == 0.5
    assert {row["mps"]: row["count"] for row in found["contacts_by_impact_speed"]} == {
        1.0: 2,
        2.0: 1,
        5.0: 1,
        10.0: 0,
    }
    assert found["sides"] == {"front to rear": 2}


def test_the_command_goes_on_from_what_is_kept_and_refuses_what_is_another_runs(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(rates, "CHUNK", 4)
    card = tmp_path / "ego-mine.json"
    card.write_text('{"name": "ego-mine"}')
    given = ["rates", "--ego", "idm", "--out", str(tmp_path), "--card", str(card)]
    monkeypatch.setattr("sys.argv", [*given, "--rollouts", "5"])
    rates.main()
    path = tmp_path / "rates-idm.jsonl"
    first = path.read_bytes()
    assert first.count(b"\n") == 2
    path.write_bytes(first[:-10])  # cut off while the second was written
    rates.main()
    assert path.read_bytes() == first
    told = json.loads(card.read_text())
    assert told["name"] == "ego-mine"
    assert told["rates"]["i80-10s"]["rollouts"] == 8
    assert told["rates"]["i80-10s"]["command"].endswith("--rollouts 8 --seed 1 --out DIR")
    monkeypatch.setattr("sys.argv", [*given, "--seed", "2"])
    with pytest.raises(InputError, match="another scenario, ego or seed"):
        rates.main()
    path.write_bytes(b"nothing\n")
    with pytest.raises(InputError, match="does not hold chunks of rates"):
        rates.main()
    monkeypatch.setattr("sys.argv", [*given, "--rollouts", "0"])
    with pytest.raises(InputError, match="expected at least 1"):
        rates.main()
