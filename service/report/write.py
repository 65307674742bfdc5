"""From a run directory to its report files."""

import json
from datetime import UTC, datetime
from pathlib import Path

from service.errors import StoreError
from service.record import replay
from service.report.dangerous import pick, rerun
from service.report.facts import facts_of
from service.report.page import page_of
from service.store import RunDirectory

DRAWN = 6  # dangerous rollouts in a report


def write_report(
    store: RunDirectory, out: Path | None = None, drawn: int = DRAWN, now: datetime | None = None
) -> Path:
    """Write report.html and report.json into `out` (default: the run directory); the HTML file's path.

    Everything is taken from the record, so it works on a finished run, an interrupted one and one that still goes on.
    `drawn` dangerous rollouts are run again in a process of their own (0: none, and no SUMO). Raises StoreError where
    the record cannot be read, belongs to other weights, or the files cannot be written.
    """
    folder = store.path if out is None else out
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(folder, error) from error
    records = [replay(store, job) for job in store.jobs]
    told = rerun(pick(records, drawn))
    facts = facts_of(store.path, records, told, now or datetime.now(UTC))
    html = page_of(facts, records, told)
    page = folder / "report.html"
    try:
        text = json.dumps(facts, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / "report.json").write_text(text + "\n", encoding="utf-8")
        page.write_text(html, encoding="utf-8")
    except OSError as error:
        raise _cannot_write(folder, error) from error
    return page


def _cannot_write(folder: Path, error: OSError) -> StoreError:
    return StoreError(
        f"cannot write the report to {folder}: {error.strerror or error}; give another folder with --out"
    )
