"""What a job keeps beside its chunks comes back to the bit, once, and damage is noticed."""

import sqlite3

import pytest

from service.errors import StoreError
from service.evaluation.job import make_job
from service.evaluation.store import RunDirectory
from service.world.scenario import load_scenario


@pytest.fixture
def run(tmp_path):
    job = make_job(load_scenario("i80-paper-10s"), "idm", 0.5, "naive", 1, {})
    with RunDirectory.create(tmp_path / "run", (job,)) as store:
        yield store


def test_what_is_kept_comes_back_and_the_first_one_stays(run):
    data = bytes(range(256)) * 5000
    assert run.artefacts.kept("naive", "committor") is None
    run.artefacts.keep("naive", "committor", data)
    run.artefacts.keep("naive", "committor", b"another")
    assert run.artefacts.kept("naive", "committor") == data
    assert list(run.artefacts.names("naive")) == ["committor"]
    assert list(run.artefacts.names("other")) == []


def test_damage_is_noticed(run):
    run.artefacts.keep("naive", "committor", b"abc")
    with sqlite3.connect(run.path / "rollouts.sqlite") as connection:
        connection.execute("UPDATE artefacts SET data = ?", (b"abd",))
    with pytest.raises(StoreError, match="is damaged"):
        run.artefacts.kept("naive", "committor")
