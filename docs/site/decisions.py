"""The index of the decision records, and the form that each of them has."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from docs.site.gather import ROOT

FOLDER = ROOT / "deploy" / "decisions"
_TITLE = re.compile(r"^# (\d+)\. (\S.*)$")
_STATUS = re.compile(r"^Status: (accepted|superseded by (?:\[)?(\d+))\b")


class FormError(Exception):
    """A decision record does not begin as all of them do."""


@dataclass(frozen=True)
class Decision:
    """What the index tells of a decision record.

    number:        as in its file's name and title
    superseded_by: the number of the decision that replaced it; None where it stands
    """

    file: str
    number: int
    title: str
    superseded_by: int | None

    @property
    def status(self) -> str:
        return f"superseded by {self.superseded_by}" if self.superseded_by else "accepted"


def read(path: Path) -> Decision:
    """One record: "# 7. TITLE", a blank line, "Status: accepted" or "Status: superseded by 8"; else FormError."""
    lines = [*path.read_text(encoding="utf-8").split("\n"), "", "", ""]
    title, status = _TITLE.match(lines[0]), _STATUS.match(lines[2])
    number = int(path.name.split("-")[0])
    if title is None or int(title.group(1)) != number:
        raise FormError(f'{path.name}: the first line is {lines[0]!r}, expected "# {number}. TITLE"')
    if lines[1] or status is None:
        raise FormError(
            f'{path.name}: the third line is {lines[2]!r}, expected "Status: accepted" or "Status: superseded by N"'
        )
    return Decision(path.name, number, title.group(2), int(status.group(2)) if status.group(2) else None)


def records() -> list[Decision]:
    """All of them, by number."""
    return [read(p) for p in sorted(FOLDER.glob("[0-9]*.md"))]


def index() -> str:
    """The page that lists them."""
    rows = "\n".join(f"| {d.number} | [{d.title}]({d.file}) | {d.status} |" for d in records())
    return f"""# Decisions

A page for each choice that would be hard to reverse: the situation, what was decided, why, and what was rejected. A
record is not rewritten when things change: a later one supersedes it.

| | decision | status |
| --- | --- | --- |
{rows}
"""
