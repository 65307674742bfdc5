"""Black-box egos in a process of their own over TCP: the same bits as in process, and every way to fail."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import pytest

import ce
from policies.drivers import DriverModel
from policies.egos import EgoPolicy
from policies.egos.idm import IdmEgo
from service.errors import EgoError, InputError
from service.evaluation.job import Problem, make_job
from service.evaluation.pool import LocalPool, Work
from service.world.egos import ego_pb2 as pb
from service.world.egos.open import meet_ego, open_ego
from service.world.egos.sdk import Service
from service.world.egos.settings import EgoSettings
from service.world.scenario import Scenario
from service.world.scenario.base import base_distribution
from service.world.sim.rollout import Rollout, Simulator

# on a busy machine a process may take long to start; nobody waits that long for one that is there
PATIENT = 120.0


@pytest.fixture
def scenario(make_scenario) -> Scenario:
    return make_scenario({"horizon_s = 10.0": "horizon_s = 2.0"})


@pytest.fixture
def rollouts(scenario, i80, drivers: DriverModel):
    """rollouts(ego, n): the first n rollouts of the scenario with that ego."""
    x, noise_seeds = ce.draw(base_distribution(scenario, drivers), 3, "estimate", 0, 0, 16)

    def run(ego: EgoPolicy, n: int) -> list[Rollout]:
        with Simulator(scenario, i80, drivers, ego) as simulator:
            return [simulator.run(row, int(seed)) for row, seed in zip(x[:n], noise_seeds[:n], strict=True)]

    return run


@pytest.fixture
def remote(scenario, i80, address):
    """remote(name, deadline_s): the ego `zenoh:NAME` at the test's address."""

    def connect(name: str, deadline_s: float = PATIENT, patience_s: float = PATIENT) -> EgoPolicy:
        settings = EgoSettings(address=address, deadline_s=deadline_s, patience_s=patience_s)
        return open_ego(f"zenoh:{name}", scenario, i80, settings)

    return connect


def test_an_ego_served_in_its_own_process_gives_the_bits_of_the_same_ego_in_process(
    start_service, address, remote, rollouts
):
    start_service(f"from policies.egos.idm import IdmEgo\nserve(IdmEgo, 'idm', listen={address!r})")
    expected = rollouts(IdmEgo(), 8)
    assert rollouts(remote("idm"), 8) == expected
    assert all(r.error is None for r in expected)


REASONS = {  # how the ego of a rollout answers its fourth observation: what is recorded
    "nan": "acceleration_mps2 is nan",
    "infinite": "turn_rate_radps is inf",
    "too much": "turn_rate_radps is -1e+06, beyond 10 either way",
    "text": "the policy answered ('a', 'b')",
    "nothing": "the policy answered None",
    "throttle": "throttle is -2, beyond 1 either way",
    "raises": "RuntimeError: sensor lost",
    "dead": "ego service 'broken' is gone",
}
BROKEN = """
import os, threading
HOW = {hows!r}
class Broken:
    rollouts = 0
    def reset(self, seed):
        self.how, self.steps = HOW[self.rollouts // 2] if self.rollouts % 2 else "good", 0
        self.rollouts += 1
    def act(self, seen):
        self.steps += 1
        if self.steps <= 3 or self.how == "good":
            return 0.0, 0.0
        if self.how == "late":
            threading.Event().wait()
        if self.how == "dead":
            os._exit(1)
        if self.how == "raises":
            raise RuntimeError("sensor lost")
        answers = (float("nan"), 0.0), (0.0, float("inf")), (0.0, -1e6), ("a", "b"), None, Pedals(0.0, -2.0)
        return answers[HOW.index(self.how)]
serve(Broken, "broken", listen={address!r})
"""


class Straight:
    name = "straight"

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation) -> tuple[float, float]:
        return 0.0, 0.0


def test_an_ego_that_fails_makes_its_rollouts_recorded_errors_and_the_others_go_on(
    start_service, address, remote, rollouts
):
    """Every second rollout is driven well, and has the bits of the same ego in process."""
    start_service(BROKEN.format(hows=list(REASONS), address=address))
    found = rollouts(remote("broken"), 2 * len(REASONS))
    assert found[::2] == rollouts(Straight(), 2 * len(REASONS))[::2]
    for failed, reason in zip(found[1::2], REASONS.values(), strict=True):
        assert failed.outcome == "error"
        assert math.isnan(failed.f)
        assert failed.error is not None
        assert failed.error.startswith("EgoError: ")
        assert reason in failed.error


def test_a_late_answer_makes_the_rollout_a_recorded_error(start_service, address, remote, rollouts):
    start_service(BROKEN.format(hows=["late"], address=address))
    (good,) = rollouts(remote("broken"), 1)
    assert good.error is None
    _, late = rollouts(remote("broken", deadline_s=0.5), 2)  # of which the first one may be late, too
    assert late.error == "EgoError: no answer of ego service 'broken' within its deadline of 0.5 s"


class Looking:
    """Accelerates by what it sees."""

    name = "looking"
    wants_camera = True

    def reset(self, seed: int) -> None:
        pass

    def act(self, observation) -> tuple[float, float]:
        return float(observation.frame[20:].mean()) / 100.0 - 1.0, 0.0


def test_pictures_reach_a_service_raw_to_the_bit_and_as_jpeg_nearly(address, remote, rollouts):
    here = rollouts(Looking(), 1)
    assert here[0].error is None
    for camera in ("raw", "jpeg"):
        with Service(Looking, "looking", listen=address, camera=camera) as service:
            thread = threading.Thread(target=service.run)
            thread.start()
            ego = remote("looking")
            there = rollouts(ego, 1)
        thread.join()
        assert there[0].error is None
        if camera == "raw":
            assert there == here
        else:
            assert there[0].f == pytest.approx(here[0].f, rel=0.05)


def test_after_a_service_came_back_rollouts_go_on(start_service, address, remote, rollouts):
    code = f"from policies.egos.idm import IdmEgo\nserve(IdmEgo, 'idm', listen={address!r})"
    first = start_service(code)
    expected = rollouts(IdmEgo(), 2)

    class Killing:
        """Kills the service in the first rollout, and starts it again before the second."""

        name = "killing"
        resets = 0
        ego = remote("idm")

        def reset(self, seed: int) -> None:
            if self.resets == 1:
                start_service(code)
            self.ego.reset(seed)
            self.resets += 1
            if self.resets == 1:
                first.kill()
                first.wait()

        def act(self, observation):
            return self.ego.act(observation)

    failed, good = rollouts(Killing(), 2)
    assert "is gone" in failed.error
    assert good == expected[1]
    Killing.ego.close()


def test_services_of_one_name_share_the_workers(address, remote, scenario, i80):
    """Two services meet at one address: each new worker is served by the one with fewer workers."""
    with (
        Service(IdmEgo, "idm", listen=address) as first,
        Service(IdmEgo, "idm", listen=None, connect=address) as second,
    ):
        threads = [threading.Thread(target=service.run) for service in (first, second)]
        for thread in threads:
            thread.start()
        egos = []
        while len({ego.greet().instance for ego in egos}) < 2:
            assert len(egos) < 200, "the second service is never taken"
            egos.append(remote("idm"))
            egos[-1].reset(1)
        for ego in egos:
            ego.close()
    for thread in threads:
        thread.join()


def test_a_missing_service_is_told_before_a_job_begins(scenario, i80, address, monkeypatch):
    def wait(patience_s: float) -> None:
        for name, value in EgoSettings(address=address, patience_s=patience_s).as_environment().items():
            monkeypatch.setenv(name, value)

    wait(0.2)
    with pytest.raises(EgoError, match=f"no ego service and no Zenoh router can be reached at {address}"):
        meet_ego("zenoh:nobody", scenario, i80)
    wait(4.0)  # a busy machine may take that long to connect to the one that is there
    told = pytest.raises(EgoError, match=f"there is no ego service 'nobody' at {address}")
    with Service(IdmEgo, "somebody", listen=address), told:
        meet_ego("zenoh:nobody", scenario, i80)
    with pytest.raises(InputError, match="not one that this process may import"):
        meet_ego("os:system", scenario, i80)


INSTANCE = [""]  # of the service that the test runs


@pytest.fixture
def scripted(address):
    """scripted(answer): a bare Zenoh service named `odd` that answers `answer(request)` with bytes, run by the test."""
    opened: list[Service] = []

    class Odd(Service):
        def __init__(self, answer):
            super().__init__(IdmEgo, "odd", listen=address)
            INSTANCE[:] = [self._answering.instance]
            self._answering.answer = lambda payloads: [
                Bytes(answer(pb.Request.FromString(p))) for p in payloads
            ]

    def start(answer) -> None:
        opened.append(Odd(answer))
        threading.Thread(target=opened[-1].run, daemon=True).start()

    yield start
    for service in opened:
        service.close()


class Bytes:
    """A reply that is sent as it is."""

    def __init__(self, payload: bytes):
        self._payload = payload

    def SerializeToString(self) -> bytes:  # as protobuf calls it
        return self._payload


def polite(request: pb.Request) -> pb.Reply:
    """What a service should answer."""
    kind = request.WhichOneof("kind")
    if kind == "hello":
        return pb.Reply(welcome=pb.Welcome(version=1, instance=INSTANCE[0]))
    if kind == "reset":
        return pb.Reply(ready=pb.Ready(rollout=request.reset.rollout))
    seen = request.observation
    return pb.Reply(action=pb.Action(rollout=seen.rollout, step=seen.step, motion=pb.Motion()))


def twisted(kind: str, change) -> Callable[[pb.Request], bytes]:
    """Polite answers, but those to `kind` changed by `change(reply)`, which may give other bytes."""

    def answer(request: pb.Request) -> bytes:
        reply = polite(request)
        if request.WhichOneof("kind") == kind and (request.observation.step >= 3 or kind != "observation"):
            return change(reply)
        return reply.SerializeToString()

    return answer


def with_fields(message: str, **fields) -> Callable[[pb.Reply], bytes]:
    def change(reply: pb.Reply) -> bytes:
        for name, value in fields.items():
            setattr(getattr(reply, message), name, value)
        return reply.SerializeToString()

    return change


NONSENSE = {
    "another rollout": (
        "observation",
        with_fields("action", rollout="someone-1"),
        "rollout 'someone-1', not step 3",
    ),
    "another step": ("observation", with_fields("action", step=2), "for step 2 of rollout"),
    "oversized": ("observation", lambda reply: bytes(70_000), "has 70000 bytes; at most 65536"),
    "garbage": ("observation", lambda reply: b"\xff" * 30, "is not a Reply"),
    "empty": ("observation", lambda reply: b"", "the answer is empty where action was due"),
    "another kind": (
        "reset",
        lambda reply: pb.Reply(welcome=pb.Welcome()).SerializeToString(),
        "welcome where ready",
    ),
    "ready for another": ("reset", with_fields("ready", rollout="x"), "is ready for rollout 'x'"),
    "another version": ("hello", with_fields("welcome", version=2), "speaks version 2"),
    "a wild instance": ("hello", with_fields("welcome", instance="../**"), "not 1 to 64 letters"),
    "an unknown camera": ("hello", with_fields("welcome", camera=9), "unknown kind 9"),
}


@pytest.mark.parametrize("case", NONSENSE)
def test_nonsense_from_a_service_is_a_recorded_error_with_its_reason(scripted, remote, rollouts, case):
    kind, change, told = NONSENSE[case]
    scripted(twisted(kind, change))
    (failed,) = rollouts(remote("odd"), 1)
    assert failed.outcome == "error"
    assert failed.error is not None
    assert told in failed.error


def test_a_polite_service_drives(scripted, remote, rollouts):
    scripted(lambda request: polite(request).SerializeToString())
    assert rollouts(remote("odd"), 1) == rollouts(Straight(), 1)


def test_worker_processes_share_one_service_and_end_when_they_are_done(
    start_service, address, scenario, monkeypatch
):
    start_service(f"from policies.egos.idm import IdmEgo\nserve(IdmEgo, 'idm', listen={address!r})")
    settings = EgoSettings(address=address, deadline_s=PATIENT, patience_s=PATIENT)
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)
    found = {}
    for ego in ("idm", "zenoh:idm"):
        job = make_job(scenario, ego, 0.5, "naive", 1, {})
        x, noise_seeds = ce.draw(Problem(job).base, 1, "estimate", 0, 0, 12)
        work = [Work(i, x[i : i + 3], noise_seeds[i : i + 3]) for i in range(0, 12, 3)]
        with LocalPool(job, 2) as pool:
            chunks = sorted(pool.run(work), key=lambda chunk: chunk.start)
        found[ego] = [(chunk.f.tobytes(), chunk.errors) for chunk in chunks]
    assert found["idm"] == found["zenoh:idm"]
