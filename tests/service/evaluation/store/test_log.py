"""The audit log: rows are only added, and whoever changes or takes out one breaks the chain."""

from __future__ import annotations

import sqlite3

import pytest
import sqlalchemy as sa
from click.testing import CliRunner
from sqlalchemy.exc import DBAPIError

from service.evaluation.store.database import open_engine, writing
from service.evaluation.store.jobs import JobStore
from service.front.cli.main import main


def test_rows_are_only_added_and_each_has_a_hash_of_all_before(url):
    with JobStore(url) as store:
        first = store.log.add("tailroad-client from 192.0.2.7", "submit", "j1")
        second = store.log.add("unknown", "cancel", "j1", "there is no job 'j1'")
        assert [*store.log.entries()] == [first, second]
        assert [*store.log.entries(after=1)] == [second]
        assert (first.number, second.number, second.hash != first.hash) == (1, 2, True)
        assert store.log.wrong() == store.log.wrong(head=first.hash) == []
        assert store.log.submitted_by("tailroad-client from 192.0.2.7") == {"j1"}
    engine = open_engine(url)
    for statement in ("UPDATE audit_log SET who = 'nobody'", "DELETE FROM audit_log WHERE number = 2"):
        with pytest.raises(DBAPIError, match="rows are only added"), writing(engine) as connection:
            connection.execute(sa.text(statement))
    engine.dispose()


@pytest.mark.parametrize(
    ("deed", "told"),
    [
        (
            "UPDATE audit_log SET who = 'me' WHERE number = 2",
            "line 2 of the audit log, or one before it, is not",
        ),
        (
            "UPDATE audit_log SET job = 'j9', hash = 'x' WHERE number = 4",
            "line 4 of the audit log, or one before",
        ),
        ("DELETE FROM audit_log WHERE number IN (2, 3)", "goes from line 1 to line 4"),
        ("DELETE FROM audit_log WHERE number > 2", "it has lost its end"),
    ],
)
def test_what_was_changed_or_taken_out_is_told_by_log_and_by_verify(tmp_path, deed, told):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        for job in ("j1", "j2", "j3", "j4"):
            head = store.log.add("somebody else", "submit", job).hash
    log, verify = ["log", str(tmp_path), "--has", head], ["verify", "--store", str(tmp_path)]
    assert CliRunner().invoke(main, log).exit_code == CliRunner().invoke(main, verify).exit_code == 0
    connection = sqlite3.connect(tmp_path / "fleet.sqlite")
    for trigger in ("update", "delete"):
        connection.execute(f"DROP TRIGGER audit_log_no_{trigger}")
    connection.execute(deed)
    connection.commit()
    connection.close()
    said = CliRunner().invoke(main, log)
    assert (said.exit_code, told in said.output) == (2, True), said.output
    if "end" not in told:  # which only a hash that was noted tells
        said = CliRunner().invoke(main, verify)
        assert (said.exit_code, told in said.output) == (2, True), said.output


def test_the_log_reads_like_this(tmp_path):
    with JobStore(f"sqlite:///{tmp_path / 'fleet.sqlite'}") as store:
        store.log.add("this machine", "submit", "j1")
        last = store.log.add("this machine", "cancel", "j2", "there is no job 'j2'")
    lines = CliRunner().invoke(main, ["log", str(tmp_path)]).output.splitlines()
    assert lines[0].endswith("this machine  submit j1")
    assert lines[1].endswith("this machine  cancel j2: refused, there is no job 'j2'")
    assert CliRunner().invoke(main, ["log", str(tmp_path), "--head"]).output.strip() == last.hash
