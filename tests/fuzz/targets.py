"""What is fuzzed: everything that reads something from outside. Each target tells how a payload ended, and raises where
it did not end as it must: in what was asked for, or in an error of the type that is promised."""

from __future__ import annotations

import contextlib
import itertools
import json
import shutil
import sqlite3
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from hypothesis import strategies as st

from policies.data.ngsim_import import import_file
from policies.data.scenes import DataError
from policies.drivers import WeightsError, load_drivers, shipped
from service.api.application import Application
from service.api.catalogue import Catalogue
from service.api.limits import Limits
from service.api.objects import Problem
from service.api.problems import URN
from service.cli.submit import option_of
from service.errors import InputError, ScenarioError, StoreError
from service.fleet.answers import chunk_of
from service.fleet.hub import Hub
from service.fleet.messages import (
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
from service.fleet.service import Fleet
from service.job import Job, make_job
from service.matrix.plan import cells, read_batch
from service.record import replay
from service.scenario import load as loading
from service.scenario.check import check_road
from service.scenario.load import load_scenario, parse_scenario, read_toml
from service.store import FAILED, Chunk, RunDirectory
from service.store.jobs import JobStore
from tests.fuzz.payloads import bodies, changed, damaged, json_of, parameters, text

I80 = tomllib.loads((loading.FOLDER / "i80-10s.toml").read_text(encoding="utf-8"))
SUBMISSION = {"scenario": "i80-10s", "ego": "idm", "gamma": 0.5, "method": "ce", "budget": 20_000, "rel_error": 0.5,
              "confidence": 0.9, "options": {"rho": 0.2, "iterations": 2}, "seed": 3, "priority": 1, "weight": 2.0,
              "label": "a label"}  # fmt: skip
BATCH = """format = 1
name = "nightly"
scenarios = ["i80-10s", "us101-10s"]
egos = ["lidar", "idm"]
gammas = [0.5, 0.2]
methods = ["auto", "ce"]
budget = 2000
fail_above = 1e-3
[options.ce]
rho = 0.1
"""
KEYS = (
    "about", "health", "scenarios", "egos", "workers", "jobs", "jobs/{job}", "jobs/{job}/estimate", "jobs/{job}/curve",
    "jobs/{job}/iterations", "jobs/{job}/events", "jobs/{job}/pause", "jobs/{job}/resume", "schemas/Job", "jobs/x",
    "jobs/x/estimate", "jobs/x/failures", "jobs/x/rollouts/1", "jobs/x/cancel", "schemas/x",
)  # fmt: skip


@dataclass(frozen=True)
class Target:
    """share: of all payloads."""

    name: str
    payloads: st.SearchStrategy[Any]
    run: Callable[[Any], str]
    share: float


class Targets:
    """All targets, with what they need in `folder`; use as a context manager."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._names = (str(n) for n in itertools.count())
        self._store = JobStore(f"sqlite:///{folder / 'fleet.sqlite'}")
        self._hub = Hub(self._store)
        self._hub.start()
        limits = Limits(requests_per_s=1e9, submissions_per_s=1e9, open_jobs=1)
        fleet = Fleet(self._hub)
        self._application = Application(fleet, Catalogue(), limits)
        self._job = self._submit()
        self._run = self._recorded_run()
        folder_of_weights = loading.FOLDER.parents[1] / "policies" / "weights"
        weights = folder_of_weights / f"{shipped()[0]}.safetensors"
        self._weights = weights.read_bytes()
        self.all = (
            Target("api keys and parameters", st.tuples(st.sampled_from(KEYS) | text, parameters), self._query, 0.08),
            Target("api submissions", bodies(SUBMISSION), self._submission, 0.2),
            Target("api scenarios by value", bodies(SUBMISSION | {"scenario": I80}), self._submission, 0.1),
            Target("worker messages", _wrong_messages(), _message, 0.45),
            Target("scenario files", damaged(_toml_bytes()) | changed(I80), self._scenario, 0.05),
            Target("batch files", damaged(BATCH.encode()), self._batch, 0.05),
            Target("options", text, _option, 0.04),
            Target("run.json", damaged((self._run / "run.json").read_bytes()), self._run_json, 0.01),
            Target("run databases", damaged((self._run / "rollouts.sqlite").read_bytes()), self._database, 0.005),
            Target("chunks in run databases", st.tuples(st.sampled_from(("f", "outcomes", "steps", "errors", "stop")),
                   st.binary(max_size=40) | text | st.integers(-9, 2**40)), self._chunk, 0.005),
            Target("recordings as text", damaged(_recording()), self._recording, 0.0025),
            Target("driver weights", damaged(self._weights[:4000]), self._weights_file, 0.0025),
        )  # fmt: skip

    def __enter__(self) -> Targets:
        return self

    def __exit__(self, *_: object) -> None:
        self._application.close()
        self._hub.stop()
        self._store.close()

    # -- the API ---------------------------------------------------------------------------------------------

    def _submit(self) -> str:
        return json.loads(self._application.answer("jobs", "", json_of(SUBMISSION)).body)["id"]

    def _query(self, payload: tuple[str, str]) -> str:
        key, asked = payload
        return self._told(key.replace("{job}", self._job), asked, None)

    def _submission(self, payload: bytes) -> str:
        return self._told("jobs", "", payload)

    def _told(self, key: str, asked: str, payload: bytes | None) -> str:
        answer = self._application.answer(key, asked, payload)
        if answer.ok:
            json.loads(answer.body)
            return "answered"
        problem = msgspec.json.decode(answer.body, type=Problem)
        assert problem.status == answer.status != 500, (key, asked, payload, problem)
        assert problem.detail
        assert len(answer.body) < 10_000
        return problem.type.removeprefix(URN)

    # -- files -----------------------------------------------------------------------------------------------

    def _scenario(self, payload: bytes | dict) -> str:
        try:
            if isinstance(payload, bytes):
                path = self._folder / "fuzzed.toml"
                path.write_bytes(payload)
                payload = read_toml(path, "fuzzed")
            scenario = parse_scenario(
                payload if isinstance(payload, dict) else {"x": payload}, "fuzzed", self._folder
            )
            check_road(scenario, "fuzzed")
        except ScenarioError:
            return "ScenarioError"
        return "accepted"

    def _batch(self, payload: bytes) -> str:
        path = self._folder / "fuzzed-batch.toml"
        path.write_bytes(payload)
        try:
            list(cells(read_batch(path), self._folder))
        except InputError as error:
            return type(error).__name__
        return "accepted"

    def _run_json(self, payload: bytes) -> str:
        folder = self._copy()
        (folder / "run.json").write_bytes(payload)
        return self._opened(folder)

    def _database(self, payload: bytes) -> str:
        folder = self._copy()
        (folder / "rollouts.sqlite").write_bytes(payload)
        return self._opened(folder)

    def _chunk(self, payload: tuple[str, object]) -> str:
        folder, (column, value) = self._copy(), payload
        connection = sqlite3.connect(folder / "rollouts.sqlite")
        connection.execute(f"UPDATE chunks SET {column} = ?", (value,))
        connection.commit()
        connection.close()
        return self._opened(folder)

    def _opened(self, folder: Path) -> str:
        try:
            with RunDirectory.open(folder) as run:
                for job in run.jobs:
                    for _ in run.all_chunks(job.id):
                        pass
        except (StoreError, InputError) as error:
            return type(error).__name__
        finally:
            shutil.rmtree(folder)
        return "accepted"

    def _copy(self) -> Path:
        folder = self._folder / f"run-{next(self._names)}"
        shutil.copytree(self._run, folder)
        return folder

    def _recorded_run(self) -> Path:
        """A run directory with chunks on record, replayed once."""
        job = _job()
        path = self._folder / "run"
        with RunDirectory.create(path, (job,)) as run:
            f = np.linspace(0.1, 3.0, 50)
            errors = {3: "no answer"}
            outcomes = np.zeros(50, np.uint8)
            outcomes[3] = FAILED
            for start in (0, 50):
                run.append(
                    job.id,
                    "estimate",
                    0,
                    Chunk(start, start + 50, f, outcomes, np.full(50, 9, np.int32), errors, 1.0),
                )
            assert replay(run, job).recorded == 100
        connection = sqlite3.connect(path / "rollouts.sqlite")
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        connection.close()
        return path

    def _recording(self, payload: bytes) -> str:
        path, out = self._folder / "fuzzed.txt", self._folder / "imported"
        path.write_bytes(payload)
        try:
            import_file(path, out)
        except DataError:
            return "DataError"
        return "accepted"

    def _weights_file(self, payload: bytes) -> str:
        path = self._folder / f"fuzzed-{next(self._names)}.safetensors"
        path.write_bytes(payload + self._weights[4000:])
        try:
            load_drivers(path)
        except WeightsError:
            return "WeightsError"
        finally:
            path.unlink()
        return "accepted"


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


def _option(payload: str) -> str:
    try:
        option_of(payload)
    except InputError:
        return "InputError"
    return "accepted"


def _job() -> Job:
    return make_job(load_scenario("i80-10s"), "idm", 0.5, "naive", 1, {"budget": 100})


def _messages() -> list[bytes]:
    """Every message of the fleet, as it should be."""
    key = ChunkKey("j1", "train", 0, 0, 2, "00" * 16)
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
        JobSpec("j1", _job(), {"road": "1"}),
        Noted(True),
        Refused("why"),
    ]
    return [encode(one) for one in every]


def _wrong_messages() -> st.SearchStrategy[bytes]:
    return st.one_of([damaged(message) for message in _messages()]) | st.binary(max_size=100)


def _toml_bytes() -> bytes:
    return (loading.FOLDER / "i80-10s.toml").read_bytes()


def _recording() -> bytes:
    """A few lines as NGSIM wrote them."""
    rows = []
    for vehicle in (1, 2):
        for frame in range(1, 6):
            y = 40.0 * vehicle + 4.0 * frame
            rows.append(f"{vehicle} {frame} 5 {1113433135300 + 100 * frame} 16.467 {y:.3f} 6042842.0 2133117.0 "
                        f"14.5 4.9 2 40.0 0.0 2 0 0 0.0 0.0")  # fmt: skip
    return ("\n".join(rows) + "\n").encode()
