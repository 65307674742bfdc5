"""Timing other simulators: what runs is timed, what does not is told with its reason. No network."""

from __future__ import annotations

import os
import sys

import pytest

from service.studies.reproduce.page import write_page
from service.studies.reproduce.peers import page as paging
from service.studies.reproduce.peers import timed as timing
from service.studies.reproduce.peers.timed import Peer

GOOD = 'import json; print("noise"); print(json.dumps({"sim_s": [10, 20, 30], "core_s": [1, 4, 1], "what": "counts"}))'
BAD = "import sys; sys.exit('no such road')"


@pytest.fixture
def peers(tmp_path, monkeypatch):
    """Two peers whose environments are there already, and one that cannot be made."""
    scripts = {"good": GOOD, "bad": BAD}
    for name, code in scripts.items():
        (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")
        python = tmp_path / "out" / "peers" / name / "bin" / "python"
        python.parent.mkdir(parents=True)
        os.symlink(sys.executable, python)
        (python.parents[1] / "ready").write_text("", encoding="utf-8")
    monkeypatch.setattr(
        timing, "PEERS", tuple(Peer(name, ("x==1",), str(tmp_path / f"{name}.py")) for name in scripts)
    )
    monkeypatch.setattr(timing, "_own", lambda ego, rollouts: {"idm": 900.0, "lidar": 800.0}[ego])
    return tmp_path


def test_what_runs_is_timed_and_what_fails_says_why(peers):
    found = {one.name: one for one in timing.timed(2, 5, peers / "out" / "peers", lambda what: None)}
    assert found["good"].speed == (10.0, 10.0)  # the median of 10, 5 and 30 simulated seconds a second
    assert found["good"].what == "counts"
    assert found["bad"].speed == ()
    assert found["bad"].failed == "cannot be run: no such road"
    assert found["tailroad, ego idm"].speed == (900.0, 900.0)


def test_an_environment_that_cannot_be_made_is_told(peers, monkeypatch):
    monkeypatch.setattr(timing, "_failed", lambda command, limit_s: ("no network", ""))
    (peers / "out" / "peers" / "good" / "ready").unlink()
    found = {one.name: one for one in timing.timed(1, 5, peers / "out" / "peers", lambda what: None)}
    assert found["good"].failed == "cannot be installed: no network"


def test_the_page_has_them_all(peers):
    page = paging.peers_page("smoke", peers / "out", "tailroad reproduce peers", lambda what: None)
    text = write_page(page, peers / "pages").read_text(encoding="utf-8")
    assert "| tailroad, ego idm | 900 (900 to 900) |" in text
    assert "| good | 10.0 (10.0 to 10.0) | counts |" in text
    assert "| bad | – | cannot be run: no such road |" in text
