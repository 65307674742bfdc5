"""Files that are fuzzed: scenarios, batches, formulas, runs, roads, recordings and their tables, weights and cards."""

from __future__ import annotations

import itertools
import shutil
import sqlite3
import tomllib
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from policies.data.ngsim_import import import_file
from policies.data.scenes import DataError
from policies.data.tables import is_table, read_tables
from policies.drivers import WEIGHTS_FOLDER, WeightsError, load_drivers, shipped
from service.analysis.failures.memory import Memory
from service.analysis.failures.rerun import Rerun
from service.errors import InputError, ScenarioError, StoreError
from service.evaluation.job import Job, make_job
from service.evaluation.record import replay
from service.evaluation.store import FAILED, Chunk, RunDirectory
from service.front.matrix.plan import cells, read_batch
from service.world.safety.formula import FormulaMonitor
from service.world.scenario import load as loading
from service.world.scenario.check import check_road
from service.world.scenario.load import load_scenario, parse_scenario, read_toml
from sumo_nets.corridor import read_corridor
from sumo_nets.errors import NetworkError
from tests.fuzz.payloads import changed, damaged, json_of, text
from tests.fuzz.target import Target, ending
from tests.sumo_nets.conftest import net_text

I80 = tomllib.loads((loading.FOLDER / "i80-paper-10s.toml").read_text(encoding="utf-8"))
BATCH = """format = 1
name = "nightly"
scenarios = ["i80-paper-10s", "us101-paper-10s"]
egos = ["lidar", "idm"]
gammas = [0.5, 0.2]
methods = ["auto", "ce"]
budget = 2000
fail_above = 1e-3
[options.ce]
rho = 0.1
"""
FORMULA = "always(ttc_s >= 1.0) and (box_ttc_s < 2 implies eventually[0:1 s](acceleration_mps2 <= -2))"


class FileTargets:
    """Targets that read files, which lie in `folder`."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._names = (str(n) for n in itertools.count())
        self._job = _job()
        self._run = self._recorded_run()
        weights = WEIGHTS_FOLDER / f"{shipped()[0]}.safetensors"
        self._weights, card = weights.read_bytes(), weights.with_suffix(".json").read_bytes()
        self._drivers = folder / "drivers.safetensors"
        self._drivers.write_bytes(self._weights)
        self._scenario_10s = load_scenario("i80-paper-10s")
        (folder / "recording.txt").write_bytes(_recording())
        import_file(folder / "recording.txt", folder / "imported")
        table = (folder / "imported" / "recording.parquet").read_bytes()
        columns = ("f", "outcomes", "steps", "errors", "stop")
        values = st.binary(max_size=40) | text | st.integers(-9, 2**40)
        run = self._run
        self.all = (
            Target("scenario files", damaged(_toml_bytes()) | changed(I80), self._scenario, 0.05),
            Target("batch files", damaged(BATCH.encode()), self._batch, 0.05),
            Target("formulas", damaged(FORMULA.encode()).map(_text), self._formula, 0.015),
            Target("run.json", damaged((run / "run.json").read_bytes()), self._run_json, 0.01),
            Target("run databases", damaged((run / "rollouts.sqlite").read_bytes()), self._database, 0.005),
            Target("chunks in run databases", st.tuples(st.sampled_from(columns), values), self._chunk, 0.005),
            Target("remembered rollouts", damaged(self._remembered()), self._memory, 0.005),
            Target("road networks", damaged(_network()), self._road, 0.02),
            Target("recordings as text", damaged(_recording()), self._recording, 0.0025),
            Target("imported tables", damaged(table), self._table, 0.0025),
            Target("driver weights", damaged(self._weights[:4000]), self._weights_file, 0.0025),
            Target("cards of drivers", damaged(card) | changed({"name": "x"}).map(json_of), self._card, 0.005),
        )  # fmt: skip

    def _scenario(self, payload: bytes | dict) -> str:
        def read() -> None:
            content: object = payload
            if isinstance(payload, bytes):
                path = self._folder / "fuzzed.toml"
                path.write_bytes(payload)
                content = read_toml(path, "fuzzed")
            scenario = parse_scenario(
                content if isinstance(content, dict) else {"x": content}, "fuzzed", self._folder
            )
            check_road(scenario, "fuzzed")

        return ending(read, ScenarioError)

    def _batch(self, payload: bytes) -> str:
        path = self._folder / "fuzzed-batch.toml"
        path.write_bytes(payload)
        return ending(lambda: list(cells(read_batch(path), self._folder)), InputError)

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
        def read() -> None:
            with RunDirectory.open(folder) as run:
                for job in run.jobs:
                    for _ in run.all_chunks(job.id):
                        pass

        try:
            return ending(read, StoreError, InputError)
        finally:
            shutil.rmtree(folder)

    def _copy(self) -> Path:
        folder = self._folder / f"run-{next(self._names)}"
        shutil.copytree(self._run, folder)
        return folder

    def _recorded_run(self) -> Path:
        """A run directory with chunks on record, replayed once."""
        job = self._job
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
        return ending(lambda: import_file(path, out), DataError)

    def _weights_file(self, payload: bytes) -> str:
        path = self._folder / f"fuzzed-{next(self._names)}.safetensors"
        path.write_bytes(payload + self._weights[4000:])
        try:
            return ending(lambda: load_drivers(path), WeightsError)
        finally:
            path.unlink()

    def _formula(self, payload: str) -> str:
        return ending(lambda: FormulaMonitor(payload, self._scenario_10s), InputError)

    def _remembered(self) -> bytes:
        memory = Memory(self._job, self._folder)
        for row in range(3):
            memory.add((0, row), 0.3, Rerun(0.3, "collision", None))
        memory.save()
        (path,) = (self._folder / "failures").iterdir()
        return path.read_bytes()

    def _memory(self, payload: bytes) -> str:
        (path,) = (self._folder / "failures").iterdir()
        path.write_bytes(payload)
        found = Memory(self._job, self._folder).get((0, 1), 0.3)
        return "remembered" if found else "as good as none"

    def _road(self, payload: bytes) -> str:
        path = self._folder / "fuzzed.net.xml"
        path.write_bytes(payload)
        return ending(lambda: read_corridor(path, ("west", "east")), NetworkError)

    def _table(self, payload: bytes) -> str:
        path = self._folder / "fuzzed.parquet"
        path.write_bytes(payload)
        return ending(lambda: (is_table(path), read_tables(path)), DataError)

    def _card(self, payload: bytes) -> str:
        path = self._folder / f"drivers-{next(self._names)}.safetensors"
        path.hardlink_to(self._drivers)
        path.with_suffix(".json").write_bytes(payload)
        try:
            return ending(lambda: load_drivers(path), WeightsError)
        finally:
            path.unlink()
            path.with_suffix(".json").unlink()


def _text(payload: bytes) -> str:
    return payload.decode("utf-8", "replace")


def _network() -> bytes:
    """Two straight edges of two lanes, one after the other."""
    edges = {
        "west": (np.array([[0.0, 15.0], [60.0, 15.0]]), [3.66, 3.66]),
        "east": (np.array([[64.0, 15.0], [120.0, 15.0]]), [3.66, 3.66]),
    }
    return net_text(edges, [("west", "east", 0, 0), ("west", "east", 1, 1)]).encode()


def _job() -> Job:
    return make_job(load_scenario("i80-paper-10s"), "idm", 0.5, "naive", 1, {"budget": 100})


def _toml_bytes() -> bytes:
    return (loading.FOLDER / "i80-paper-10s.toml").read_bytes()


def _recording() -> bytes:
    """A few lines as NGSIM wrote them."""
    rows = []
    for vehicle in (1, 2):
        for frame in range(1, 6):
            y = 40.0 * vehicle + 4.0 * frame
            rows.append(f"{vehicle} {frame} 5 {1113433135300 + 100 * frame} 16.467 {y:.3f} 6042842.0 2133117.0 "
                        f"14.5 4.9 2 40.0 0.0 2 0 0 0.0 0.0")  # fmt: skip
    return ("\n".join(rows) + "\n").encode()
