"""A client without any tailroad code: plain Zenoh and JSON."""

from __future__ import annotations

import json
import queue
import tomllib

import jsonschema
import pytest

from service.world.scenario import load as loading

JOB = {"scenario": "i80-paper-10s", "ego": "idm", "gamma": 0.5, "method": "naive", "budget": 400, "seed": 7}


def checked(foreign, name: str, answer: dict) -> dict:
    """The answer, valid by the schema that the service publishes for it."""
    jsonschema.validate(answer, foreign.get(f"schemas/{name}"))
    return answer


def finish(foreign, job: dict) -> dict:
    told: queue.Queue = queue.Queue()
    key = f"tailroad/v1/jobs/{job['id']}/events"
    subscriber = foreign.session.declare_subscriber(key, lambda s: told.put(json.loads(s.payload.to_bytes())))
    try:
        kept = foreign.get(f"jobs/{job['id']}/events")["items"]
        while not any(e["kind"] == "status" and e["body"]["status"] == "done" for e in kept):
            kept.append(checked(foreign, "Event", told.get(timeout=60)))
    finally:
        subscriber.undeclare()
    return foreign.get(f"jobs/{job['id']}")


def test_submits_follows_and_reads_an_estimate(foreign) -> None:
    job = checked(foreign, "Job", foreign.get("jobs", JOB))
    assert finish(foreign, job)["status"] == "done"
    at = f"jobs/{job['id']}"
    estimate = checked(foreign, "Estimate", foreign.get(f"{at}/estimate"))
    assert estimate["rollouts"]["total"] == 400
    assert estimate["ci"][0] < estimate["p"] < estimate["ci"][1]
    narrower = foreign.get(f"{at}/estimate?gamma=0.25;confidence=0.5")
    assert narrower["gamma"] == 0.25
    assert narrower["p"] < estimate["p"]
    curve = checked(foreign, "Curve", foreign.get(f"{at}/curve?gammas=0.25,0.5;confidence=0.5"))
    assert [point["p"] for point in curve["points"]] == [narrower["p"], estimate["p"]]
    assert curve["points"][0]["ci"] == narrower["ci"]
    steps = checked(foreign, "Iterations", foreign.get(f"{at}/iterations"))
    assert steps["items"][-1]["p"] == estimate["p"]


@pytest.mark.parametrize("name", ["about", "health", "scenarios", "egos", "workers", "jobs"])
def test_answers_are_as_their_schemas_say(foreign, name: str) -> None:
    answer = checked(foreign, name.capitalize(), foreign.get(name))
    assert answer


def test_about_names_every_key_with_its_parameters_and_schemas(foreign) -> None:
    about = foreign.get("about")
    estimate = next(e for e in about["endpoints"] if e["key"] == "tailroad/v1/jobs/{job}/estimate")
    assert {p["name"] for p in estimate["parameters"]} == {"gamma", "confidence"}
    for endpoint in about["endpoints"]:
        assert (
            endpoint["answer"] in about["schemas"] if endpoint["media"] == [] else endpoint["answer"] is None
        )
    for name in about["schemas"]:
        jsonschema.Draft202012Validator.check_schema(foreign.get(f"schemas/{name}"))


def test_jobs_come_in_pages(foreign) -> None:
    ids = [foreign.get("jobs", JOB | {"budget": 5, "seed": seed})["id"] for seed in range(5)]
    seen, after = [], 0
    while after is not None:
        page = foreign.get(f"jobs?limit=2;after={after}")
        assert len(page["items"]) <= 2
        seen += [job["id"] for job in page["items"]]
        after = page["next"]
    assert [job for job in seen if job in ids] == ids
    assert len(seen) == len(set(seen))


def test_a_scenario_is_submitted_by_value(foreign) -> None:
    data = tomllib.loads((loading.FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8"))
    data |= {"name": "mine"}
    job = foreign.get("jobs", JOB | {"scenario": data, "budget": 20})
    assert job["scenario"] == "mine"
    assert finish(foreign, job)["status"] == "done"


def test_paused_resumed_and_cancelled(foreign) -> None:
    job = foreign.get("jobs", JOB | {"budget": 10_000_000})["id"]
    assert foreign.get(f"jobs/{job}/pause") == {"job": job, "order": "pause"}
    assert foreign.get(f"jobs/{job}/resume")["order"] == "resume"
    assert foreign.get(f"jobs/{job}/cancel")["order"] == "cancel"
    ended = {"cancelled"}
    while foreign.get(f"jobs/{job}")["status"] not in ended:  # each question is a wait for its answer
        pass
    assert foreign.problem(f"jobs/{job}/resume")["status"] == 400
    told = [e["body"]["status"] for e in foreign.get(f"jobs/{job}/events")["items"] if e["kind"] == "status"]
    assert told == ["running", "paused", "running", "cancelled"]
