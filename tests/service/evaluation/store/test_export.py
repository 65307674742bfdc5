"""The Parquet file of a record: a row for each rollout, of run directories and fleets."""

from __future__ import annotations

import numpy as np
import polars as pl
from click.testing import CliRunner

from service.evaluation.store import Chunk, Origin, RunDirectory
from service.evaluation.store.jobs import JobStore
from service.front.cli import main
from service.world.safety.contact import Contact

TOUCH = Contact(4, 3.0, -3.0, 0.25, "front", "left", "rear", "right", "ego")


def chunk(start: int, contacts: dict[int, Contact] | None = None) -> Chunk:
    outcomes = np.array([0, 255, 2], np.uint8)
    return Chunk(
        start,
        start + 3,
        np.array([0.5, np.nan, np.inf]),
        outcomes,
        np.arange(3, dtype=np.int32),
        {1: "no"},
        1.0,
        contacts=contacts,
    )


def export(*arguments: str):
    return CliRunner().invoke(main, ["export", *arguments])


def test_a_run_directory_becomes_a_table(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, chunk(3))
        run.append("naive", "estimate", 0, chunk(0))
    result = export(str(tmp_path / "run"), "--parquet", str(tmp_path / "t.parquet"))
    assert result.exit_code == 0, result.output
    assert result.output.startswith("6 rollouts of 1 jobs")
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table["row"].to_list() == [0, 1, 2, 3, 4, 5]
    assert table["f"].to_list()[:3] == [0.5, None, np.inf]
    assert table["outcome"].to_list()[:3] == ["horizon", "error", "collision"]
    assert table["error"].to_list()[:3] == [None, "no", None]
    assert table["worker"].null_count() == 6


def test_a_fleet_s_jobs_are_exported_together_or_one_by_one(tmp_path, job):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        for i, name in enumerate(("a", "b")):
            store.add_job(name, job, 0, 1.0, "", "running")
            store.append([(name, "estimate", 0, chunk(3 * i), Origin("w", 0))])
    assert export(str(tmp_path), "--parquet", str(tmp_path / "t.parquet")).exit_code == 0
    assert pl.read_parquet(tmp_path / "t.parquet")["job"].to_list() == ["a"] * 3 + ["b"] * 3
    assert export(str(tmp_path), "--parquet", str(tmp_path / "t.parquet"), "--job", "b").exit_code == 0
    assert pl.read_parquet(tmp_path / "t.parquet")["worker"].to_list() == ["w"] * 3


def test_bad_input_is_exit_code_2(tmp_path, job):
    RunDirectory.create(tmp_path / "run", (job,)).close()
    run, file = str(tmp_path / "run"), str(tmp_path / "t.parquet")
    for arguments in ((str(tmp_path), "--parquet", file), (run, "--parquet", file, "--job", "ce"),
                      (run, "--parquet", str(tmp_path / "no" / "t.parquet")), (run,)):  # fmt: skip
        assert export(*arguments).exit_code == 2
    result = export(run, "--parquet", file)  # no rollouts yet: a table without rows
    assert result.exit_code == 0
    assert pl.read_parquet(file).height == 0


def test_how_vehicles_touched_is_there_and_an_older_record_says_that_it_is_not(tmp_path, job):
    with RunDirectory.create(tmp_path / "run", (job,)) as run:
        run.append("naive", "estimate", 0, chunk(0, {2: TOUCH}))
        run.append("naive", "estimate", 0, chunk(3))
        assert [c.contacts for c in run.chunks("naive", "estimate", 0)] == [{2: TOUCH}, None]
    assert export(str(tmp_path / "run"), "--parquet", str(tmp_path / "t.parquet")).exit_code == 0
    table = pl.read_parquet(tmp_path / "t.parquet")
    assert table["contact_recorded"].to_list() == [None, None, True, None, None, False]
    row = {name: value for name, value in table.row(2, named=True).items() if name.startswith("contact_")}
    assert row == {
        "contact_recorded": True, "contact_other": 4, "contact_mps": 3.0, "contact_ahead_mps": -3.0,
        "contact_left_mps": 0.25, "contact_ego_side": "front", "contact_ego_part": "left",
        "contact_other_side": "rear", "contact_other_part": "right", "contact_striking": "ego",
    }  # fmt: skip
    assert table["contact_ego_side"].null_count() == 5
