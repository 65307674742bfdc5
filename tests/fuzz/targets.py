"""What is fuzzed: everything that reads something from outside. Each target tells how a payload ended, and raises where
it did not end as it must: in what was asked for, or in an error of the type that is promised."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from google.protobuf.message import DecodeError
from hypothesis import strategies as st

from service.errors import EgoError, InputError
from service.evaluation.job import make_job
from service.evaluation.store.jobs import JobStore
from service.front.cli.question_options import option_of
from service.remote.api.application import Application
from service.remote.api.catalogue import Catalogue
from service.remote.api.limits import Limits
from service.remote.api.objects import Problem
from service.remote.api.problems import URN
from service.remote.fleet.answers import chunk_of
from service.remote.fleet.hub import Hub
from service.remote.fleet.messages import (
    Answer,
    Ask,
    BadMessage,
    Bye,
    Capabilities,
    ChunkKey,
    Drawn,
    Explicit,
    Failed,
    GetJob,
    Hello,
    JobSpec,
    Lease,
    Noted,
    Refused,
    Welcome,
    decode_reply,
    decode_request,
    encode,
)  # fmt: skip
from service.remote.fleet.policy import Policy
from service.remote.fleet.service import Fleet
from service.world.egos import ego_pb2 as pb
from service.world.egos.messages import action_of, frame_of, reply_of, vector_of
from service.world.scenario.load import load_scenario
from tests.fuzz.file_targets import I80, FileTargets
from tests.fuzz.payloads import bodies, damaged, json_of, parameters, text
from tests.fuzz.target import Target

OPEN_BYTES = 150_000_000  # that open jobs may hold together
SUBMISSION = {"scenario": "i80-paper-10s", "ego": "idm", "gamma": 0.5, "method": "ce", "budget": 20_000,
              "rel_error": 0.5, "confidence": 0.9, "options": {"rho": 0.2, "iterations": 2}, "seed": 3,
              "priority": 1, "weight": 2.0, "label": "a label"}  # fmt: skip
KEYS = (
    "about", "health", "scenarios", "egos", "workers", "jobs", "jobs/{job}", "jobs/{job}/estimate", "jobs/{job}/curve",
    "jobs/{job}/iterations", "jobs/{job}/events", "jobs/{job}/pause", "jobs/{job}/resume", "jobs/{job}/failures",
    "jobs/{job}/rollouts", "jobs/{job}/rollouts/0", "jobs/{job}/rollouts/x", "schemas/Job", "jobs/x", "jobs/x/estimate",
    "jobs/x/failures", "jobs/x/rollouts/1", "jobs/x/cancel", "schemas/x",
    "comparison", "jobs/x/learned", "jobs/x/scatter", "jobs/x/risk", "jobs/x/report", "jobs/x/report.json",
    "jobs/x/rollouts/1/export",
)  # fmt: skip


class Targets:
    """All targets, with what they need in `folder`; use as a context manager."""

    def __init__(self, folder: Path):
        self._store = JobStore(f"sqlite:///{folder / 'fleet.sqlite'}")
        self._hub = Hub(self._store, Policy(open_bytes=OPEN_BYTES))
        self._hub.start()
        limits = Limits(requests_per_s=1e9, submissions_per_s=1e9, open_bytes=OPEN_BYTES)
        self._application = Application(Fleet(self._hub), Catalogue(), limits)
        self._job = self._submit()
        scenario = SUBMISSION | {"scenario": I80}
        self.all = (
            Target("api keys and parameters", st.tuples(st.sampled_from(KEYS) | text, parameters), self._query, 0.08),
            Target("api submissions", bodies(SUBMISSION), self._submission, 0.2),
            Target("api scenarios by value", bodies(scenario), self._submission, 0.1),
            Target("worker messages", _wrong_messages(), _message, 0.36),
            Target("ego messages", _wrong_ego_messages(), _ego_message, 0.05),
            Target("options", text, _option, 0.0375),
            *FileTargets(folder).all,
        )  # fmt: skip

    def __enter__(self) -> Targets:
        return self

    def __exit__(self, *_: object) -> None:
        self._application.close()
        self._hub.stop()
        self._store.close()

    def _submit(self) -> str:
        return json.loads(self._application.answer("jobs", "", json_of(SUBMISSION)).body)["id"]

    def _query(self, payload: tuple[str, str]) -> str:
        key, asked = payload
        return self._told(key.replace("{job}", self._job), asked, None)

    def _submission(self, payload: bytes) -> str:
        """An accepted job is opened by the scheduler as any other, and cancelled."""
        told, job = self._asked("jobs", "", payload)
        if told == "answered" and "id" in job:
            self._told(f"jobs/{job['id']}/cancel", "", None)
            return "accepted"
        return told

    def _told(self, key: str, asked: str, payload: bytes | None) -> str:
        return self._asked(key, asked, payload)[0]

    def _asked(self, key: str, asked: str, payload: bytes | None) -> tuple[str, dict[str, Any]]:
        """How it ended, and what was answered."""
        answer = self._application.answer(key, asked, payload)
        if answer.ok:
            return "answered", json.loads(answer.body)
        problem = msgspec.json.decode(answer.body, type=Problem)
        assert problem.status == answer.status != 500, (key, asked, payload, problem)
        assert problem.detail
        assert len(answer.body) < 10_000
        return problem.type.removeprefix(URN), {}


def _message(payload: bytes) -> str:
    with contextlib.suppress(BadMessage):
        decode_reply(payload)
    try:
        message = decode_request(payload)
        if isinstance(message, Answer):
            chunk_of(message)
    except BadMessage:
        return "BadMessage"
    return "accepted"


def _ego_message(payload: bytes) -> str:
    """As the world takes an answer, and a service an observation."""
    with contextlib.suppress(EgoError):
        action_of(reply_of(payload, "action").action, "r1", 3, 12.0, 4.5)
        return "accepted"
    try:
        request = pb.Request.FromString(payload)
        vector_of(request.observation)
        frame_of(request.observation.picture)
    except (EgoError, DecodeError):
        return "EgoError"
    return "accepted"


def _option(payload: str) -> str:
    try:
        option_of(payload)
    except InputError:
        return "InputError"
    return "accepted"


def _messages() -> list[bytes]:
    """Every message of the fleet, as it should be."""
    key = ChunkKey("j1", "train", 0, 0, 2, "00" * 16)
    job = make_job(load_scenario("i80-paper-10s"), "idm", 0.5, "naive", 1, {"budget": 100})
    n = np.zeros(2)
    every = [
        Hello("w1", Capabilities(2, ("idm",), True, False, {"tailroad": "1"}, "host", 7)),
        Ask("w1", 0, "j1"),
        GetJob("w1", "j1"),
        Answer(
            "w1",
            1,
            key,
            n.tobytes(),
            n.astype(np.uint8).tobytes(),
            n.astype(np.int32).tobytes(),
            {1: "why"},
            0.5,
        ),
        Failed("w1", 1, key, "why"),
        Bye("w1"),
        Welcome(1.0),
        Lease(1, key, Drawn(1, n.tobytes()), 9.0),
        Lease(1, key, Explicit(n.tobytes(), n.tobytes()), 9.0),
        JobSpec("j1", job, {"road": "1"}),
        Noted(True),
        Refused("why"),
    ]
    return [encode(one) for one in every]


def _wrong_messages() -> st.SearchStrategy[bytes]:
    return st.one_of([damaged(message) for message in _messages()]) | st.binary(max_size=100)


def _wrong_ego_messages() -> st.SearchStrategy[bytes]:
    picture = pb.Picture(encoding=pb.CAMERA_RAW, width=2, height=2, data=bytes(12))
    seen = pb.Observation(worker="w1", rollout="r1", step=3, time_s=0.3, ego=pb.EgoState(speed_mps=12.0),
                          lidar=pb.Lidar(limit_m=100.0, range_m=[9.0] * 20, range_rate_mps=[-1.0] * 20),
                          picture=picture)  # fmt: skip
    motion = pb.Motion(acceleration_mps2=1.0, turn_rate_radps=0.1)
    pedals = pb.Pedals(steering_rad=0.1, throttle=-0.5)
    messages = (
        pb.Request(observation=seen),
        pb.Reply(action=pb.Action(rollout="r1", step=3, motion=motion)),
        pb.Reply(action=pb.Action(rollout="r1", step=3, pedals=pedals)),
        pb.Reply(refusal=pb.Refusal(reason="why")),
        pb.Reply(welcome=pb.Welcome(version=1, instance="i1")),
    )
    return st.one_of([damaged(message.SerializeToString()) for message in messages]) | st.binary(max_size=64)
