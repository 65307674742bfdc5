"""The typed client and the commands on top of it, against a service with a light worker."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner

from service.evaluation.pool import OUTCOME_NAMES
from service.evaluation.store.export import SCHEMA, table_of
from service.front.cli.main import main
from service.remote.api import rollouts
from service.remote.api.requests import Submission
from service.remote.client import Client, NoAnswer, Refused
from service.remote.client.service import RemoteRun
from service.world.scenario.load import parse_scenario
from tests.service.remote.fleet.light import expected, formula, free_port

JOB = {"ego": "idm", "method": "naive", "budget": 300}


def cli(service, *args: str) -> tuple[int, str]:
    result = CliRunner().invoke(
        main, [*args, "--connect", f"tcp/127.0.0.1:{service.port}", "--timeout", "60"]
    )
    return result.exit_code, result.output


def test_what_is_said_of_a_job_stays_and_tells_whoever_listens(service, client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB, seed=12)
    client.cancel(job.id)
    with client.subscribe() as heard:
        client.note(job.id, "look; at=this", ["night", "rain"])
        assert b'"note"' in next(body for body in iter(lambda: heard.get(20.0), None) if b'"note"' in body)
    client.note(job.id, archived=True)
    found = client.job(job.id)
    assert (found.note, found.tags, found.archived) == ("look; at=this", ("night", "rain"), True)
    client.note(job.id, tags=[])
    assert client.job(job.id).tags == ()
    with pytest.raises(Refused, match="at most 20 words"):
        client.note(job.id, tags=[f"t{i}" for i in range(21)])


def test_a_job_from_submission_to_estimate(service, client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB, seed=11, label="typed")
    kinds = [(event.kind, event.body.get("status")) for event in client.watch(job.id)]
    assert kinds[0] == ("status", "running")
    assert kinds[-1] == ("status", "done")
    assert client.job(job.id).status == "done"
    estimate = client.estimate(job.id)
    assert estimate.p == expected(service.light.store.job(job.id).job).p
    curve = client.curve(job.id, [0.25, 0.5])
    assert curve.points[1].p == estimate.p
    assert client.iterations(job.id).items[-1].number == 0
    assert job.id in {j.id for j in client.all_jobs()}
    # nothing new: the kept ones, and the end
    assert [e.kind for e in client.watch(job.id)] == [
        "status",
        "status",
    ]


def test_refusals_carry_their_problem(client: Client) -> None:
    with pytest.raises(Refused, match="no job 'nope'") as caught:
        client.job("nope")
    assert caught.value.kind == "no-such-job"
    assert caught.value.problem.status == 404


def test_nobody_there() -> None:
    with (
        Client(f"tcp/127.0.0.1:{free_port()}", timeout_s=0.2) as nobody,
        pytest.raises(NoAnswer, match="tailroad serve"),
    ):
        nobody.health()


def test_watching_goes_on_where_an_answer_is_late(service, monkeypatch: pytest.MonkeyPatch) -> None:
    with Client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as client:
        job = client.submit("i80-paper-10s", 0.5, **JOB, seed=14).id
        real, silences = client._line.ask, []
        late = iter([False, True, False, True, True])  # the first one is not

        def ask(selector: str, payload: bytes | None = None) -> tuple[bool, bytes]:
            if next(late, False):
                raise NoAnswer("nothing came in time")
            return real(selector, payload)

        monkeypatch.setattr(client._line, "ask", ask)
        client.health()
        told = [event.body.get("status") for event in client.watch(job, on_silence=silences.append)]
        assert told[-1] == "done"
        assert silences
        client._patience_s = 0.0
        late = iter([True])
        with pytest.raises(NoAnswer):
            next(client.watch(job))


def test_what_the_service_offers(client: Client) -> None:
    assert "i80-paper-10s" in {entry.name for entry in client.scenarios().items}
    assert {"idm", "lidar"} <= {ego.name for ego in client.egos().items}
    assert [worker.id for worker in client.workers().items] == ["w1"]
    assert client.health().procs == 1
    assert {e.key for e in client.about().endpoints} >= {
        "tailroad/v1/jobs",
        "tailroad/v1/jobs/{job}/failures",
    }


def test_failures_of_a_job_without_any(client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.0, **JOB).id
    client.wait(job)
    found = client.failures(job)
    assert (found.events, found.failures, found.job) == (0, (), job)


def test_rollouts_that_the_record_does_not_have(client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB, seed=12).id
    client.wait(job)
    with pytest.raises(Refused, match="no rollout 300"):
        client.rollout(job, 300)


def test_commands(service) -> None:
    code, job = cli(service, "submit", "i80-paper-10s", "--ego", "idm", "--gamma", "0.5", "--method", "naive",
                    "--budget", "200", "--label", "by command")  # fmt: skip
    assert code == 0
    job = job.strip()
    code, lines = cli(service, "watch", job, "--json")
    assert code == 0
    assert json.loads(lines.splitlines()[-1])["body"]["status"] == "done"
    code, shown = cli(service, "show", job, "--json", "--gamma", "0.25")
    assert json.loads(shown)["estimate"]["gamma"] == 0.25
    assert cli(service, "show", job)[0] == 0
    code, listed = cli(service, "jobs", "--label", "by command", "--json")
    assert [j["id"] for j in json.loads(listed)["items"]] == [job]
    assert job in cli(service, "jobs")[1]
    assert cli(service, "cancel", job)[0] == 0  # it is over: it stays as it is
    assert cli(service, "pause", job)[0] == 2
    assert json.loads(cli(service, "get", f"jobs/{job}/estimate?gamma=0.25")[1])["gamma"] == 0.25
    assert cli(service, "get", "jobs/nope")[0] == 2
    assert cli(service, "health", "--workers", "1")[0] == 0
    assert cli(service, "health", "--workers", "2")[0] == 1


def test_a_scenario_file_is_sent_by_value(service, tmp_path: Path) -> None:
    from service.world.scenario.load import FOLDER

    text = (FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.toml"
    mine.write_text(text.replace('name = "i80-paper-10s"', 'name = "mine"'), encoding="utf-8")
    code, out = cli(service, "submit", str(mine), "--ego", "idm", "--gamma", "0.5", "--budget", "20",
                    "--method", "naive", "--json")  # fmt: skip
    assert code == 0
    assert json.loads(out)["scenario"] == "mine"


def test_health_of_nobody_is_exit_code_1() -> None:
    result = CliRunner().invoke(
        main, ["health", "--connect", f"tcp/127.0.0.1:{free_port()}", "--timeout", "0.2"]
    )
    assert result.exit_code == 1
    assert "nobody answers" in result.output


def test_the_methods_of_submit_are_those_of_ce() -> None:
    import msgspec

    import ce
    from service.front.cli.submit import METHODS

    schema = msgspec.json.schema(Submission)["$defs"]["Submission"]["properties"]["method"]
    assert set(METHODS) == set(ce.METHODS) == set(schema["enum"])


def test_a_rollout_is_run_once_more(client: Client) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB, seed=13).id
    client.wait(job)
    found = client.rollout(job, 7, trace=True)
    # what the light worker said
    assert found.f == formula(np.array([int(found.noise_seed)], np.uint64))[0][0]
    assert not found.same_to_the_bit  # which is not what the simulation says
    assert found.trace is not None
    assert {"time_s", "speed_mps"} <= set(found.trace)
    brought_back = parse_scenario(tomllib.loads(found.scenario), "rollout 7", Path())
    assert brought_back.fixed is not None
    assert brought_back.fixed.noise_seed == found.noise_seed


def test_a_service_gives_the_same_objects_as_this_machine(service, tmp_path) -> None:
    import tailroad

    told = []
    with tailroad.client(f"tcp/127.0.0.1:{service.port}", timeout_s=60.0) as fleet:
        run = fleet.estimate(
            "i80-10s", "idm", gamma=0.5, method="naive", budget=300, seed=21, progress=told.append
        )
        assert isinstance(run.estimate, tailroad.Estimated)
        assert run.estimate.p == expected(service.light.store.job(run.job).job).p
        assert run.estimates[run.job].rollouts.total == 300
        assert run.status == "done"
        assert "95% interval" in run._repr_html_()
        assert run.job in repr(fleet.run(run.job))
        other = fleet.estimate("i80-10s", "idm", gamma=0.5, method="naive", budget=300, seed=22)
        compared = fleet.compare([run, other], examine=0)
        assert [side.p for side in compared.comparison.sides] == [run.estimate.p, other.estimate.p]
        assert "interval" in compared._repr_html_()
        with pytest.raises(tailroad.TailroadError, match="runs egos by name"):
            fleet.submit("i80-10s", object(), gamma=0.5)
    assert all(one.total == 300 for one in told)


def test_every_rollout_comes_as_a_table_in_pages_of_any_size(service, client: Client) -> None:
    run = RemoteRun(
        client, client.submit("i80-paper-10s", 0.5, **JOB | {"method": "ce", "budget": 3000}, seed=14).id
    )
    table = run.wait().to_polars()
    assert table.schema == pl.Schema(SCHEMA)
    chunks = service.light.store.chunks.with_origins(run.job)
    assert table.equals(table_of({run.job: chunks}, OUTCOME_NAMES))
    assert table.height == run.estimate.rollouts.total == 3000
    assert table["f"].null_count() == table["error"].count() > 0
    for limit in (97, 1000, 3000):
        rows, after = [], ""
        while after is not None:
            page = client.rollouts(run.job, after, limit)
            assert len(page.row) <= limit
            rows += zip(page.phase, page.iteration, page.row, page.f, strict=True)
            after = page.next
        assert rows == list(table.select("phase", "iteration", "row", "f").iter_rows())


def test_a_page_ends_early_where_many_rollouts_tell_long_reasons(
    monkeypatch, service, client: Client
) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB | {"budget": 3000}, seed=15).id
    client.wait(job)
    whole = client.rollouts(job)
    monkeypatch.setattr(rollouts, "ERROR_CHARACTERS", 1)
    first = client.rollouts(job)
    assert 0 < len(first.row) < len(whole.row)
    assert first.error[-1] is not None
    assert not any(first.error[:-1])
    assert [row for page in client.all_rollouts(job) for row in page.row] == list(whole.row)


@pytest.mark.parametrize(
    "after", ["x", "train,1,2", "train,1,2,3,4,5", "train,-1,0,0,0", "train,1,0,0,9999999999999999999999"]
)
def test_a_place_that_no_page_told_is_refused_by_name(client: Client, service, after: str) -> None:
    job = client.submit("i80-paper-10s", 0.5, **JOB, seed=15).id
    with pytest.raises(Refused, match="`next` of the page before"):
        client.rollouts(job, after)


def test_a_replay_of_a_service_has_its_trace_as_a_table(client: Client, tmp_path: Path) -> None:
    run = RemoteRun(client, client.submit("i80-paper-10s", 0.5, **JOB | {"budget": 16}, seed=13).id).wait()
    trace = pl.read_parquet(run.replay(1).trace(tmp_path / "worst.parquet"))
    assert {"time_s", "vehicle", "speed_mps"} <= set(trace.columns)


@pytest.mark.parametrize("by_command", [True, False])
def test_a_job_takes_the_measure_and_the_noise_mode(service, client: Client, by_command: bool) -> None:
    if by_command:
        code, out = cli(service, "submit", "i80-10s", "--ego", "idm", "--gamma", "-0.5", "--method", "naive",
                        "--budget", "300", "--seed", "31", "--measure", "rss", "--noise-mode", "frozen")  # fmt: skip
        assert code == 0, out
        job = out.strip()
    else:
        job = client.submit("i80-10s", -0.5, **JOB, seed=32, measure="rss", noise_mode="frozen").id
    asked = service.light.store.job(job).job.scenario
    assert (asked.safety.measure, asked.drivers.noise_mode) == ("rss", "frozen")
    seen = client.job(job)
    assert (seen.measure, seen.noise_mode, seen.unit) == ("rss", "frozen", "m")


def test_a_measure_that_there_is_not_is_refused_by_name(client: Client) -> None:
    with pytest.raises(Refused, match="did you mean 'rss'"):
        client.submit("i80-10s", 0.5, **JOB, measure="rrs")


def test_an_option_of_another_method_is_refused_by_name(service, client: Client) -> None:
    with pytest.raises(Refused, match=r"options\.rho: method naive has no such option"):
        client.submit("i80-10s", 0.5, **JOB, options={"rho": 0.1})
    code, out = cli(
        service, "submit", "i80-10s", "--gamma", "0.5", "--method", "naive", "--option", "rho=0.1"
    )
    assert code == 2
    assert "rho" in out
