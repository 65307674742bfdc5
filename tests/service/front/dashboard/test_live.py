"""What is told to browsers: everything that happened since their page was drawn, and nothing old in answers."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from service.front.dashboard.link import Link
from service.front.dashboard.live import REMEMBERED, EventLog, Live, Rates


def test_a_mark_leads_to_what_was_told_after_it():
    told = EventLog()
    told.add("j1", "status")
    mark = told.mark
    assert told.since(mark) == []
    told.add("j1", "iteration")
    told.add("j2", "status")
    assert told.since(mark) == [("j1", "iteration"), ("j2", "status")]
    assert told.since(told.mark) == []


@pytest.mark.parametrize(
    "mark", ["", "-", "x-1", "{run}-2", "{run}--1", "{run}-1x", "{run}-" + "9" * 400, "{run}-²"]
)
def test_a_mark_that_leads_nowhere_is_told_apart(mark: str):
    told = EventLog()
    told.add("j1", "status")
    assert told.since(mark.replace("{run}", told.mark.partition("-")[0])) is None


def test_a_mark_too_long_ago_leads_nowhere():
    told = EventLog()
    mark = told.mark
    for _ in range(REMEMBERED):
        told.add("j1", "progress")
    assert len(told.since(mark) or ()) == REMEMBERED
    told.add("j1", "progress")
    assert told.since(mark) is None


def test_the_pace_begins_with_the_first_rollouts_and_not_while_workers_start():
    now = [0.0]
    rates = Rates(lambda: now[0])
    for now[0], rollouts in ((0.0, 0), (8.0, 0), (20.0, 10)):
        rates.hear("j1", rollouts)
    assert rates.of("j1") is None
    now[0] = 21.0
    rates.hear("j1", 40)
    assert rates.of("j1") == 30.0


def first_told(live: Live, job: str | None, since: str) -> tuple[str, Any]:
    """Name and data of the first event about jobs that a browser hears."""

    async def listen() -> str:
        stream = live.stream(job, None, since)
        try:
            return [(await anext(stream)).decode() for _ in range(2)][1]
        finally:
            await stream.aclose()

    lines = dict(line.split(": ", 1) for line in asyncio.run(listen()).strip().splitlines())
    assert lines["id"] == live.mark
    return lines["event"], json.loads(lines["data"])


def test_a_browser_hears_first_what_it_missed():
    changes: list[int] = []
    live = Live(None, Rates(), lambda: changes.append(1))  # type: ignore[arg-type]
    mark = live.mark
    live._tell("j1", "progress")
    assert changes == []  # answers may be a moment old while rollouts come in
    live._tell("j1", "status")
    live._tell("j2", "iteration")
    assert len(changes) == 2
    assert first_told(live, "j1", mark) == ("jobs", {"j1": ["progress", "status"]})
    assert first_told(live, None, mark) == ("jobs", {"j1": ["progress", "status"], "j2": ["iteration"]})
    assert first_told(live, "j1", "of another run") == ("all", {})


def test_answers_remembered_for_a_moment_are_forgotten_when_something_changes():
    answers = iter(range(10))

    async def ask_around_a_change() -> list[int]:
        link = Link(None)  # type: ignore[arg-type]
        try:
            found = []
            for _ in range(2):
                found.append(await link.ask("passing", lambda _: next(answers)))
                found.append(await link.ask("for good", lambda _: next(answers), 60.0))
            link.forget_passing()
            found.append(await link.ask("passing", lambda _: next(answers)))
            found.append(await link.ask("for good", lambda _: next(answers), 60.0))
            return found
        finally:
            link.close()

    assert asyncio.run(ask_around_a_change()) == [0, 1, 0, 1, 2, 1]
