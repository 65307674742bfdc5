"""From records to a report, and from a run directory to its report files."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service.analysis.failures.rerun import Open, Rerunner
from service.analysis.report.dangerous import Findings, findings_of, most_informative
from service.analysis.report.facts import facts_of
from service.analysis.report.page import page_of
from service.analysis.risk import POLICE_REPORTED, Baseline
from service.errors import StoreError
from service.evaluation.record import JobRecord, replay
from service.evaluation.store import RunDirectory

DRAWN = 6  # dangerous rollouts in a report


@dataclass(frozen=True)
class Made:
    """A report: its facts and its page."""

    facts: dict[str, Any]
    html: str


def report_of(
    run: str,
    records: Sequence[JobRecord],
    drawn: int = DRAWN,
    workers: int = 1,
    folder: Path | None = None,
    now: datetime | None = None,
    baseline: Baseline = POLICE_REPORTED,
    opened: Open | None = None,
) -> Made:
    """The report of the jobs of a run, from their records alone: finished, interrupted, or still going on.

    run: what it is called
    drawn: dangerous rollouts to show, run again in `workers` processes (0: no SUMO, no failure modes, no risk)
    folder: the run directory, where what was run again is remembered, None for a job of a service
    baseline: what the risk is held against
    opened: rerunners of jobs, in place of `workers`
    """
    opened = opened or (lambda job: Rerunner(job, workers))
    seen = findings_of(run, most_informative(records), drawn, opened, folder) if drawn else Findings()
    facts = facts_of(run, records, seen, now or datetime.now(UTC), baseline, served=folder is None)
    return Made(facts, page_of(facts, records, seen))


def write_report(
    store: RunDirectory,
    out: Path | None = None,
    drawn: int = DRAWN,
    now: datetime | None = None,
    baseline: Baseline = POLICE_REPORTED,
    workers: int = 1,
    opened: Open | None = None,
) -> Path:
    """Write report.html and report.json into `out` (default: the run directory), or `out` itself where it is an .html
    file, and a .json file beside it; the HTML file's path.

    The rest as of `report_of`. Raises StoreError where the record cannot be read, belongs to other weights, or the
    files cannot be written.
    """
    folder = store.path if out is None else out
    page = folder / "report.html"
    if folder.suffix == ".html":
        page, folder = folder, folder.parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(folder, error) from error
    records = [replay(store, job) for job in store.jobs]
    made = report_of(store.path.name, records, drawn, workers, store.path, now, baseline, opened)
    try:
        text = json.dumps(made.facts, indent=1, allow_nan=False, ensure_ascii=False)
        page.with_suffix(".json").write_text(text + "\n", encoding="utf-8")
        page.write_text(made.html, encoding="utf-8")
    except OSError as error:
        raise _cannot_write(folder, error) from error
    return page


def _cannot_write(folder: Path, error: OSError) -> StoreError:
    return StoreError(
        f"cannot write the report to {folder}: {error.strerror or error}; give another folder with --out"
    )
