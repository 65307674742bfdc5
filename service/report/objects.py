"""The report's facts as one JSON object: report.json; `tailroad schema report` prints its JSON Schema.

Numbers that are not finite are null.
"""

from typing import Any

import msgspec

from service.failures.objects import Mode
from service.learned.objects import Learned
from service.risk import Risk

FORMAT = 2


class Headline(msgspec.Struct, frozen=True, kw_only=True):
    """The estimate that heads the report. settled: without warnings about itself."""

    job: str
    by_method: str
    answer: str
    answer_interval: str
    settled: bool
    p: float | None
    ci: tuple[float, float]
    confidence: float
    rollouts: int


class Modes(msgspec.Struct, frozen=True, kw_only=True):
    """The failure modes of one job of the run, as `tailroad failures --json` prints them, without the list."""

    format: int
    run: str
    job: str
    scenario: str
    ego: str
    method: str
    gamma: float
    confidence: float
    p: float | None
    ci: tuple[float, float]
    order: str
    events: int
    examined: int
    modes: tuple[Mode, ...]
    notes: tuple[str, ...]


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """What a run came to."""

    format: int = FORMAT
    made: str  # when, UTC
    run: str
    question: str
    headline: Headline
    disagreement: str | None  # what to say where two methods' intervals have nothing in common
    scenario: dict[str, Any]
    jobs: tuple[dict[str, Any], ...]
    risk: Risk | None
    learned: dict[str, Learned]  # by job
    failure_modes: Modes | None
    dangerous: tuple[dict[str, Any], ...]  # the rollouts that are drawn
    commands: tuple[str, ...]
    versions: dict[str, str]
