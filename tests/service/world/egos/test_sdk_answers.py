"""What an ego service answers, without a network: sessions, batches, and requests that make no sense."""

from __future__ import annotations

import numpy as np
import pytest

from policies import layout
from policies.egos import Observation
from service.errors import InputError
from service.world import agents as A
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages, sdk
from service.world.egos.sdk import Answering, Pedals


class Counting:
    """Answers with how often it was asked since its reset."""

    def reset(self, seed: int) -> None:
        self.seed, self.asked = seed, 0

    def act(self, seen):
        self.asked += 1
        return float(self.asked), 0.001 * (self.seed % 1000)


def request(**kind) -> bytes:
    return pb.Request(**kind).SerializeToString()


def hello(version: int = 1) -> bytes:
    return request(hello=pb.Hello(version=version, worker="a"))


def reset(worker: str, seed: int = 1) -> bytes:
    return request(reset=pb.Reset(worker=worker, rollout=f"{worker}-1", seed=seed))


def observation(worker: str, step: int = 0) -> bytes:
    seen = Observation(np.zeros(layout.OBSERVATION_SIZE), 0.1 * step, np.zeros(A.COLUMNS))
    return request(observation=messages.observation_of(worker, f"{worker}-1", step, seen, 1.0))


def one(answering: Answering, payload: bytes) -> pb.Reply:
    (reply,) = answering.answer([payload])
    assert reply is not None
    return reply


def test_each_worker_has_an_ego_of_its_own():
    answering = Answering(Counting)
    for worker, seed in (("a", 2**64 - 1), ("b", 5)):
        assert one(answering, reset(worker, seed)).ready.rollout == f"{worker}-1"
    answers = answering.answer([observation("a"), observation("b"), observation("a", 1)])
    assert [r.action.motion.acceleration_mps2 for r in answers] == [1.0, 1.0, 2.0]
    assert [(r.action.rollout, r.action.step) for r in answers] == [("a-1", 0), ("b-1", 0), ("a-1", 1)]
    assert answers[0].action.motion.turn_rate_radps == 0.001 * ((2**64 - 1) % 1000)
    assert one(answering, hello()).welcome.sessions == 2
    assert answering.answer([request(goodbye=pb.Goodbye(worker="a"))]) == [None]
    assert one(answering, hello()).welcome.sessions == 1
    assert "before a reset" in one(answering, observation("a")).refusal.reason


def test_all_that_wait_come_in_one_call_where_the_ego_can_do_batches():
    sizes = []

    class Batching(Counting):
        @staticmethod
        def act_batch(pairs):
            sizes.append(len(pairs))
            return [ego.act(seen) for ego, seen in pairs]

    answering = Answering(Batching)
    answering.answer([reset(worker) for worker in "abcd"])
    found = answering.answer([observation(worker) for worker in "abcd"])
    assert sizes == [4]
    assert [r.action.rollout for r in found] == ["a-1", "b-1", "c-1", "d-1"]

    class Blind(Counting):
        @staticmethod
        def act_batch(pairs):
            return [ValueError("no picture"), *[ego.act(seen) for ego, seen in pairs[1:]]]

    answering = Answering(Blind)
    answering.answer([reset(worker) for worker in "ab"])
    blind, other = answering.answer([observation(worker) for worker in "ab"])
    assert blind.refusal.reason == "ValueError: no picture"
    assert other.action.rollout == "b-1"

    class Short(Counting):
        @staticmethod
        def act_batch(pairs):
            return [(0.0, 0.0)]

    answering = Answering(Short)
    answering.answer([reset(worker) for worker in "ab"])
    assert all(
        "act_batch gave 1 actions for 2" in r.refusal.reason
        for r in answering.answer([observation("a"), observation("b")])
    )


def test_what_makes_no_sense_is_refused_and_the_service_goes_on():
    answering = Answering(Counting)
    assert "not a Request" in one(answering, b"\xff\xff").refusal.reason
    assert "empty" in one(answering, b"").refusal.reason
    assert "speaks version 1" in one(answering, hello(2)).refusal.reason
    one(answering, reset("a"))
    short = pb.Request.FromString(observation("a"))
    del short.observation.lidar.range_m[:]
    assert "has 51 values, not 31" in one(answering, short.SerializeToString()).refusal.reason
    blurred = pb.Request.FromString(observation("a"))
    blurred.observation.picture.CopyFrom(pb.Picture(encoding="CAMERA_RAW", width=10, height=10, data=b"1"))
    assert "raw picture of 10 x 10" in one(answering, blurred.SerializeToString()).refusal.reason
    assert one(answering, observation("a")).action.motion.acceleration_mps2 == 1.0


@pytest.mark.parametrize("answer", [None, (1.0,), ("x", 1.0), 3.0, (1.0, 2.0, 3.0)])
def test_a_policy_s_own_nonsense_is_refused(answer):
    class Odd(Counting):
        def act(self, seen):
            return answer

    answering = Answering(Odd)
    one(answering, reset("a"))
    assert "the policy answered" in one(answering, observation("a")).refusal.reason


def test_pedals_are_sent_as_pedals():
    class Driver(Counting):
        def act(self, seen):
            return Pedals(0.1, -0.5)

    answering = Answering(Driver)
    one(answering, reset("a"))
    assert one(answering, observation("a")).action.pedals == pb.Pedals(steering_rad=0.1, throttle=-0.5)


def test_the_longest_idle_worker_is_forgotten_when_there_are_too_many(monkeypatch):
    monkeypatch.setattr(sdk, "MAX_WORKERS", 3)
    answering = Answering(Counting)
    for worker in "abc":
        one(answering, reset(worker))
    one(answering, observation("a"))
    one(answering, reset("d"))
    assert "before a reset" in one(answering, observation("b")).refusal.reason
    assert one(answering, observation("a", 1)).action.motion.acceleration_mps2 == 2.0


def test_an_unknown_kind_of_picture_is_refused():
    with pytest.raises(InputError, match="give None, 'raw' or 'jpeg'"):
        Answering(Counting, camera="png")
