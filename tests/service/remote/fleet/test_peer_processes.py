"""Who may decide: connections are known by what the transport knows of them, and a name by one connection."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from service.evaluation.job import Problem, make_job
from service.evaluation.pool import LocalPool, Work
from service.evaluation.store import Chunk
from service.evaluation.store.draws import row_hashes, rows_digest
from service.remote.fleet.messages import PREFIX, Bye, ChunkKey, Drawn, JobSpec, Lease
from service.remote.fleet.peers import NOBODY, Peer, peer_of
from service.remote.fleet.referee import Referee
from service.remote.fleet.sessions import client_session, router_session
from service.remote.fleet.versions import digests
from service.remote.fleet.zenoh_link import HubLink, WorkerConnection
from tests.service.remote.fleet.light import LightWorker, free_port, light_fleet
from tests.service.remote.fleet.processes import LIMIT_S, Process, serve, wait

MAKE_SECURITY = Path(__file__).resolve().parents[4] / "deploy" / "zenoh" / "make-security"


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("tcp/192.168.0.7:41234", "192.168.0.7"),
        ("tls/[fe80::1]:7447", "fe80::1"),
        ("tcp/[::ffff:10.0.0.2]:5", "10.0.0.2"),
        ("", ""),
    ],
)
def test_an_address_gives_its_host(address, host):
    assert peer_of("s", None, address).host == host


def test_identity_and_what_is_refused_with_it():
    assert Peer("s", "", "127.0.0.1").identity == "this machine"
    assert Peer("s", "", "127.0.0.1").banned == ()
    assert Peer("s", "", "192.0.2.7").banned == ("host 192.0.2.7",)
    own = Peer("s", "tailroad-worker-a", "192.0.2.7")
    assert (own.identity, own.banned) == (
        "certificate tailroad-worker-a",
        ("certificate tailroad-worker-a", "host 192.0.2.7"),
    )
    shared = Peer("s", "tailroad-worker", "192.0.2.7")
    assert (shared.identity, shared.banned) == ("host 192.0.2.7", ("host 192.0.2.7",))
    assert NOBODY.identity == "unknown"


class Listening:
    """A hub that only notes who speaks."""

    def __init__(self) -> None:
        self.peers: list[Peer] = []

    def receive(self, worker, kind, data, answer, peer) -> None:
        self.peers.append(peer)
        answer(b"")

    def gone(self, worker) -> None:
        pass


def test_a_certificate_is_known_to_the_scheduler_and_a_session_cannot_be_another_s(tmp_path):
    made = subprocess.run(
        ["sh", str(MAKE_SECURITY), str(tmp_path), "localhost", "127.0.0.1"], capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    hub, where = Listening(), [f"tls/localhost:{free_port()}"]
    with router_session(where, str(tmp_path / "scheduler.json5")) as router:
        link = HubLink(router, hub)
        with client_session(where, str(tmp_path / "worker.json5")) as session:
            WorkerConnection(session, "w").ask("hello", Bye("w"), LIMIT_S)
            assert hub.peers[-1] == Peer(str(session.info.zid()), "tailroad-worker", "127.0.0.1")
            for _ in session.get(f"{PREFIX}/w/hello", payload=b"x", timeout=LIMIT_S):
                pass
            assert hub.peers[-1] == NOBODY
        link.close()


def fleet_has(fleet, name: str) -> None:
    wait(lambda: name in {known.id for known in fleet.fleet.workers()})


def test_a_name_that_is_taken_is_refused_and_comes_free_with_its_worker(tmp_path, monkeypatch):
    monkeypatch.setattr("service.remote.fleet.worker.TAKEN_S", 0.0)
    with light_fleet(tmp_path) as fleet:
        first = LightWorker(fleet.port, "same")
        fleet_has(fleet, "same")
        second = LightWorker(fleet.port, "same")
        second.join()
        assert "there is a worker named same already" in second.refusal
        first.stop()
        third = LightWorker(fleet.port, "same")
        fleet_has(fleet, "same")
        assert third.refusal == ""
        third.stop()


def test_a_second_process_of_one_name_ends_and_says_why(tmp_path):
    port = free_port()
    service = serve(tmp_path, port)
    service.wait_line("serving on")
    named = ("--connect", f"tcp/127.0.0.1:{port}", "--procs", "1", "--name", "same")
    first = Process("worker", *named)
    first.wait_line("is connected")
    second = Process("worker", *named)
    assert second.process.wait(LIMIT_S) == 2
    second.wait_line("there is a worker named same already")
    assert first.alive
    first.stop()
    service.stop()


def test_this_machine_replays_a_chunk_to_the_bits_of_a_worker(make_scenario):
    job = make_job(
        make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"}), "idm", 2.0, "naive", 1, {"budget": 8}
    )
    problem = Problem(job)
    batch = problem.algorithm.propose(problem.algorithm.init(problem.stream_seed))
    with LocalPool(job, 1) as pool:
        (chunk,) = pool.run([Work(0, batch.x, batch.noise)])
    key = ChunkKey("j", batch.phase, batch.iteration, 0, 8, rows_digest(row_hashes(batch.x, batch.noise)))
    lease = Lease(0, key, Drawn(batch.seed, batch.parameters.astype("<f8").tobytes()), 60.0)
    referee = Referee()
    try:
        again = referee.replay(JobSpec("j", job, digests(problem)), lease)
        assert isinstance(again, Chunk)
        assert again.fingerprint() == chunk.fingerprint()
        told = referee.replay(JobSpec("k", job, digests(problem) | {"road": "0"}), lease)
        assert "differ from the scheduler's" in told
    finally:
        referee.close()
