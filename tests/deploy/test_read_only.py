"""The read-only role, with a real service over TLS: it sees everything, and the scheduler takes no order from it."""

from __future__ import annotations

import subprocess
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from service.evaluation.store.jobs import JobStore
from service.remote.client import Client, Refused
from service.remote.fleet.sessions import client_session
from tests.service.remote.fleet.light import LIMIT_S, free_port
from tests.service.remote.fleet.processes import Process

MAKE_SECURITY = Path(__file__).resolve().parents[2] / "deploy" / "zenoh" / "make-security"
JOB = {"ego": "idm", "method": "naive", "budget": 1000}


def test_a_reader_sees_jobs_and_its_orders_are_refused_by_name(tmp_path):
    keys, web = tmp_path / "keys", free_port()
    subprocess.run(["sh", str(MAKE_SECURITY), str(keys), "localhost"], check=True, capture_output=True)
    where = f"tls/localhost:{free_port()}"
    dashboard = ("--dashboard", str(web), "--dashboard-config", str(keys / "reader.json5"))
    config = ("--zenoh-config", str(keys / "scheduler.json5"), "--home", str(tmp_path / "home"))
    service = Process("serve", "--listen", where, "--workers", "0", *dashboard, *config)
    service.wait_line("serving on")
    theirs = str(keys / "reader.json5")
    with Client(where, str(keys / "client.json5")) as client, Client(where, theirs) as reader:
        job = client.submit("i80-paper-10s", 0.5, **JOB).id
        assert reader.read_only
        assert [one.id for one in reader.jobs().items] == [job]
        assert reader.estimate(job).status == "running"
        for order in (reader.cancel, reader.pause, reader.resume):
            with pytest.raises(Refused, match="the read-only role may not") as refused:
                order(job)
            assert refused.value.kind == "forbidden"
        with pytest.raises(Refused, match="the read-only role may not submit"):
            reader.submit("i80-paper-10s", 0.5, **JOB)
        with client_session([where], theirs) as raw:  # it asks at a client's keys in spite of its role
            for key in ("jobs", f"jobs/{job}/cancel"):
                found = raw.get(f"tailroad/v1/{key}", payload=b"{}", timeout=LIMIT_S)
                assert [reply for reply in found if reply.ok is not None] == []
        assert [one.status for one in client.jobs().items] == ["running"]
        service.wait_line("the service answers")
        own = f"http://127.0.0.1:{web}"
        with urllib.request.urlopen(f"{own}/parts/jobs", timeout=LIMIT_S) as page:
            assert job in page.read().decode()
        post = urllib.request.Request(
            f"{own}/jobs/{job}/cancel", b"", {"Origin": own, "Sec-Fetch-Site": "same-origin"}
        )
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(post, timeout=LIMIT_S)
    said = Process("cancel", job, "--connect", where, "--zenoh-config", theirs)
    assert said.process.wait(LIMIT_S) == 2
    said.wait_line("the read-only role may not cancel")
    with JobStore(f"sqlite:///{tmp_path / 'home' / 'fleet.sqlite'}") as store:
        told = [(entry.who, entry.did, entry.job, bool(entry.refused)) for entry in store.log.entries()]
        assert store.log.wrong() == []
    client, reader = "tailroad-client from this machine", "tailroad-reader from this machine"
    orders = [(reader, did, job, True) for did in ("cancel", "pause", "resume")]
    assert told == [(client, "submit", job, False), *orders, (reader, "submit", "", True), orders[0]]
    service.kill()
