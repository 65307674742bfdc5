"""The page of the verdict on egos: run, judged, written, and gone on with."""

import json
from pathlib import Path

import pytest

from service.studies.reproduce import verdict
from service.studies.reproduce.page import write_page


def test_an_ego_is_judged_and_what_was_run_is_not_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verdict, "EGOS", {"lidar-paper": (1_500_000, 1_500_000)})
    monkeypatch.setattr(verdict, "GAMMA", 0.5)
    said: list[str] = []
    page = verdict.verdict_page("smoke", 1, tmp_path, 2, said.append, "COMMAND")
    assert said == ["lidar-paper in i80-10s: 450 rollouts", "lidar-paper in i80-paper-10s: 450 rollouts"]
    text = write_page(page, tmp_path / "pages").read_text()
    assert [table.title for table in page.tables] == [
        "Contacts in `i80-10s`, beside people", "Contacts in `i80-paper-10s`", "Severity",
        "Preventable share of p(contact)", "By failure mode, by r157-cc",
    ]  # fmt: skip
    assert "Made by `COMMAND`" in text
    people, kept = json.loads((tmp_path / "pages" / "verdict-smoke" / "results.json").read_text())
    assert (people["scenario"], kept["scenario"]) == ("i80-10s", "i80-paper-10s")
    assert kept["rollouts"] == people["rollouts"] == 450
    assert kept["contact"]["events"] > people["contact"]["events"]
    assert {row[0] for row in page.tables[2].rows} <= {"`i80-10s`", "`i80-paper-10s`"}
    assert kept["prevention"]["p"] == kept["contact"]["p"]
    assert kept["severity"]["injury"]["ci"][1] <= kept["contact"]["ci"][1]
    again = verdict.verdict_page("smoke", 1, tmp_path, 2, said.append, "COMMAND")
    assert again.tables == page.tables
