"""The shipped Zenoh configuration: who gets in, and what each role may do, over real TLS sessions."""

import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from functools import partial
from pathlib import Path

import pytest
import zenoh
from click.testing import CliRunner

from service.errors import InputError
from service.front.cli.main import main
from service.remote.api.routes import READ as READ_KEYS
from service.remote.api.routes import TOPS
from service.remote.client import Client, NoAnswer
from service.remote.fleet.zenoh_link import client_session, router_session

SCRIPT = Path(__file__).parents[2] / "deploy" / "zenoh" / "make-security"
WORK = "tailroad/v1/fleet/w1/work"
ALIVE = "tailroad/v1/fleet/{}/alive"
JOB = "tailroad/v1/jobs/a"
READ = "tailroad/v1/read/jobs/a"
EVENTS = "tailroad/v1/jobs/a/events"
PATIENCE_S = 30.0


def make_security(folder: Path, *arguments: str) -> Path:
    subprocess.run([SCRIPT, folder, *arguments, "head.example.org"], check=True, capture_output=True)
    return folder


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Scheduler:
    """The scheduler's session with something to ask for under the fleet's keys and under the API's."""

    def __init__(self, keys: Path):
        self.endpoint = f"tls/127.0.0.1:{free_port()}"
        self.session = router_session([self.endpoint], str(keys / "scheduler.json5"))
        self.asked: list[str] = []
        self.put: list[str] = []
        self.queryables = [
            self.session.declare_queryable(key, self._reply) for key in ("tailroad/v1/**", "other/**")
        ]
        self._heard = threading.Semaphore(0)
        self.subscriber = self.session.declare_subscriber("**", self._hear)
        self.events = self.session.declare_publisher(EVENTS)

    def _hear(self, sample: zenoh.Sample) -> None:
        self.put.append(str(sample.key_expr))
        self._heard.release()

    def tell(self, news: bytes) -> None:
        """Publish an event; this side's own subscriber, which hears it in a thread of its own, is done with it."""
        self.events.put(news)
        assert self._heard.acquire(timeout=PATIENCE_S)

    def _reply(self, query: zenoh.Query) -> None:
        self.asked.append(str(query.key_expr))
        query.reply(query.key_expr, b"granted")
        query.drop()

    def alive(self) -> list[str]:
        return [
            str(r.ok.key_expr) for r in self.session.liveliness().get("tailroad/v1/fleet/*/alive") if r.ok
        ]


of_kind = partial(pytest.mark.parametrize, "keys", indirect=True, scope="module")


@pytest.fixture(scope="module", params=["certificates", "passwords"])
def keys(request, tmp_path_factory):
    options = ["--passwords"] if request.param == "passwords" else []
    return make_security(tmp_path_factory.mktemp(request.param), *options)


@pytest.fixture(scope="module")
def scheduler(keys):
    scheduler = Scheduler(keys)
    yield scheduler
    scheduler.session.close()


@pytest.fixture
def session_of(scheduler, keys):
    """Opens the session of a role; it is connected when this returns."""
    opened = []
    scheduler.asked.clear()
    scheduler.put.clear()

    def open_session(role: str) -> zenoh.Session:
        session = client_session([scheduler.endpoint], str(keys / f"{role}.json5"))
        opened.append(session)
        assert list(session.info.routers_zid()), f"the {role} is not connected"
        return session

    yield open_session
    for session in opened:
        session.close()


def answers(session: zenoh.Session, key: str) -> list[bytes]:
    return [r.ok.payload.to_bytes() for r in session.get(key, timeout=PATIENCE_S) if r.ok is not None]


def test_a_worker_asks_for_work_and_is_seen_alive(scheduler, session_of):
    worker = session_of("worker")
    assert answers(worker, WORK) == [b"granted"]
    token = worker.liveliness().declare_token(ALIVE.format("w1"))
    assert answers(worker, WORK) == [b"granted"]  # what was sent before it has arrived
    assert ALIVE.format("w1") in scheduler.alive()
    token.undeclare()


def test_a_worker_can_neither_submit_nor_read_jobs(scheduler, session_of):
    worker = session_of("worker")
    assert answers(worker, JOB) == []
    assert answers(worker, "tailroad/v1/**") == []
    worker.put(EVENTS, b"a lie")
    assert answers(worker, WORK) == [b"granted"]  # what was sent before it has been refused
    assert scheduler.asked == [WORK]
    assert scheduler.put == []


def assert_follows_events(scheduler, session, key):
    """A session whose queries at `key` are granted is told what jobs do."""
    assert answers(session, key) == [b"granted"]
    received = zenoh.handlers.FifoChannel(8)
    subscriber = session.declare_subscriber("tailroad/v1/jobs/*/events", received)
    assert answers(session, key) == [b"granted"]  # the subscription has arrived
    scheduler.tell(b"news")
    assert subscriber.recv().payload.to_bytes() == b"news"


def test_a_client_submits_and_reads_and_follows_events(scheduler, session_of):
    assert_follows_events(scheduler, session_of("client"), JOB)


def test_a_reader_asks_below_read_and_follows_events_and_does_nothing_else(scheduler, session_of):
    reader = session_of("reader")
    assert_follows_events(scheduler, reader, READ)
    for key in ("tailroad/v1/jobs", JOB, f"{JOB}/cancel", f"{JOB}/pause", WORK, "tailroad/v1/**"):
        assert [r for r in reader.get(key, payload=b"{}", timeout=PATIENCE_S) if r.ok] == []
    scheduler.put.clear()
    reader.put(EVENTS, b"a lie")
    assert answers(reader, READ) == [b"granted"]  # what was sent before it has been refused
    assert set(scheduler.asked) == {READ}
    assert scheduler.put == []


def test_a_client_cannot_pass_for_a_worker(scheduler, session_of):
    client = session_of("client")
    token = client.liveliness().declare_token(ALIVE.format("liar"))
    assert answers(client, WORK) == []
    assert answers(client, "tailroad/v1/fleet/*/*") == []
    client.put("tailroad/v1/fleet/w1/answer", b"a lie")
    assert answers(client, JOB) == [b"granted"]
    assert scheduler.asked == [JOB]
    assert scheduler.put == []
    assert ALIVE.format("liar") not in scheduler.alive()
    token.undeclare()


@pytest.mark.parametrize("role", ["worker", "client"])
def test_nobody_answers_in_the_scheduler_s_place(scheduler, session_of, role):
    intruder, client = session_of(role), session_of("client")
    heard = []
    intruder.declare_queryable("tailroad/v1/jobs/**", lambda query: heard.append(query))
    # all has arrived
    assert answers(intruder, WORK if role == "worker" else "tailroad/v1/egos") == [b"granted"]
    assert answers(client, JOB) == [b"granted"]
    assert heard == []


@pytest.mark.parametrize("role", ["worker", "client", "reader"])
def test_no_role_reaches_keys_outside_the_service(scheduler, session_of, role):
    session = session_of(role)
    assert answers(session, "other/thing") == []
    assert "other/thing" not in scheduler.asked


def refused(scheduler: Scheduler, config: zenoh.Config, within_ms: int = 2000) -> bool:
    """Whether no session can be opened with `config`."""
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{scheduler.endpoint}"]')
    config.insert_json5("connect/timeout_ms", str(within_ms))
    config.insert_json5("connect/exit_on_failure", "true")
    try:
        zenoh.open(config).close()
    except zenoh.ZError:
        return True
    return False


def test_a_stranger_gets_no_session(scheduler, keys):
    stranger = zenoh.Config()
    stranger.insert_json5("transport/link/tls/root_ca_certificate", f'"{keys}/authority.pem"')
    assert refused(scheduler, stranger)


def test_keys_of_another_authority_get_no_session(scheduler, keys, tmp_path):
    options = ["--passwords"] if (keys / "passwords.txt").exists() else []
    other = make_security(tmp_path / "other", *options)
    assert not refused(scheduler, zenoh.Config.from_file(str(keys / "client.json5")), within_ms=60_000)
    assert refused(scheduler, zenoh.Config.from_file(str(other / "client.json5")))  # distrusts the scheduler
    trusting = zenoh.Config.from_file(str(other / "client.json5"))
    trusting.insert_json5("transport/link/tls/root_ca_certificate", f'"{keys}/authority.pem"')
    assert refused(scheduler, trusting)  # and is itself distrusted


def shown_as(keys: Path, user: str, password: str) -> zenoh.Config:
    config = zenoh.Config.from_file(str(keys / "client.json5"))
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": user, "password": password}))
    return config


@of_kind(["passwords"])
def test_a_wrong_password_or_name_gets_no_session(scheduler, keys):
    lines = (keys / "passwords.txt").read_text(encoding="utf-8").split()
    right = dict(line.split(":") for line in lines)
    assert not refused(scheduler, shown_as(keys, "client", right["client"]), within_ms=60_000)
    assert refused(scheduler, shown_as(keys, "client", right["client"][:-1]))
    assert refused(scheduler, shown_as(keys, "client", right["worker"]))
    assert refused(scheduler, shown_as(keys, "admin", right["client"]))


@of_kind(["certificates"])
def test_the_scheduler_s_own_certificate_opens_no_client_s_session(scheduler, keys):
    config = zenoh.Config.from_file(str(keys / "client.json5"))
    config.insert_json5("transport/link/tls/connect_certificate", f'"{keys}/scheduler.pem"')
    config.insert_json5("transport/link/tls/connect_private_key", f'"{keys}/scheduler-key.pem"')
    assert refused(scheduler, config)


def test_plain_tcp_is_not_listened_to(keys):
    with pytest.raises(InputError, match="cannot listen"):
        router_session([f"tcp/127.0.0.1:{free_port()}"], str(keys / "scheduler.json5"))


def test_keys_are_for_their_owner_only(keys):
    assert not [path.name for path in keys.iterdir() if path.stat().st_mode & 0o077]


def test_the_authority_is_kept_and_used_again(tmp_path):
    keys = make_security(tmp_path / "keys")
    authority = (keys / "authority.pem").read_bytes()
    make_security(tmp_path / "keys")
    assert (keys / "authority.pem").read_bytes() == authority


@pytest.mark.parametrize(
    "arguments", [[], ["out"], ["out", "--at"], ["out", "--unknown", "host"], ["o'ut", "host"]]
)
def test_wrong_use_of_the_script_is_refused(arguments, tmp_path):
    done = subprocess.run([SCRIPT, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "make-security" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_one_command_serves_over_tls_with_local_workers_and_a_dashboard_for_clients_alone(tmp_path):
    keys = make_security(tmp_path / "keys")
    port, web = free_port(), free_port()
    endpoint = f"tls/localhost:{port}"
    tailroad = [sys.executable, "-m", "service.front.cli"]
    config = ["--zenoh-config", keys / "scheduler.json5", "--home", tmp_path / "home"]
    listen = ["--listen", f"tls/0.0.0.0:{port}", "--procs", "1", "--dashboard", str(web)]
    with subprocess.Popen(
        [*tailroad, "serve", *listen, *config], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as server:
        try:
            assert server.stdout is not None
            said = []
            for line in server.stdout:  # ends with the server
                said.append(line)
                if all(any(text in one for one in said) for text in ("serving on", "the service answers")):
                    break
            with Client(endpoint, str(keys / "client.json5"), timeout_s=10.0) as client:
                deadline = time.monotonic() + 120.0
                while client.health().procs != 1:  # the local worker has come in by its own certificate
                    assert time.monotonic() < deadline, said
                    time.sleep(0.1)
            with urllib.request.urlopen(f"http://127.0.0.1:{web}/parts/jobs", timeout=60.0) as page:
                assert "There are no jobs yet" in page.read().decode()
            worker = Client(endpoint, str(keys / "worker.json5"), timeout_s=3.0, patience_s=0.0)
            with worker, pytest.raises(NoAnswer):
                worker.health()
        finally:
            server.send_signal(signal.SIGTERM)


@pytest.mark.parametrize(
    ("given", "said"),
    [(("--procs", "2"), "--worker-config"), (("--dashboard", "0"), "--dashboard-config")],
    ids=["workers", "dashboard"],
)
def test_without_keys_of_their_own_workers_and_dashboard_are_refused_with_what_to_do(
    keys, tmp_path, given, said
):
    alone = tmp_path / "scheduler.json5"
    alone.write_bytes((keys / "scheduler.json5").read_bytes())
    arguments = ["serve", "--zenoh-config", str(alone), "--home", str(tmp_path / "home"), *given]
    answered = CliRunner().invoke(main, arguments)
    assert answered.exit_code == 2
    assert said in answered.output


def test_clients_have_a_right_to_every_key_of_the_api():
    text = (SCRIPT.parent / "scheduler.json5").read_text(encoding="utf-8")
    granted = set(re.findall(r'"tailroad/v1/([a-z]+)(?:/\*{1,2})?"', text))
    assert granted == {*TOPS, READ_KEYS}


def test_a_worker_host_has_a_certificate_of_its_own_and_is_shut_out_by_it_alone(tmp_path):
    keys = make_security(tmp_path, "--worker", "a", "--worker", "b")
    before = {
        name: (keys / name).read_bytes() for name in ("authority.pem", "worker-b.pem", "worker-b-key.pem")
    }
    for revoked, may in (((), {"a": True, "b": True}), (("--revoke", "a"), {"a": False, "b": True})):
        if revoked:
            make_security(tmp_path, *revoked)
        scheduler = Scheduler(keys)
        try:
            for name, granted in may.items():
                with client_session(
                    [scheduler.endpoint], str(keys / f"worker-{name}.json5"), PATIENCE_S
                ) as own:
                    answers = [r.ok for r in own.get(WORK, payload=b"x", timeout=PATIENCE_S) if r.ok]
                    assert bool(answers) == granted, name
                    links = {link.auth_identifier for link in scheduler.session.info.links()}
                    assert f"tailroad-worker-{name}" in links
        finally:
            scheduler.session.close()
    assert before == {name: (keys / name).read_bytes() for name in before}
    again = subprocess.run(
        [SCRIPT, keys, "--worker", "a", "head.example.org"], capture_output=True, text=True
    )
    assert (again.returncode, "a was revoked" in again.stderr) == (2, True)
