"""From a run directory to its report files."""

import json
from datetime import UTC, datetime
from pathlib import Path

from service.errors import StoreError
from service.record import replay
from service.report.dangerous import LookBack, look_back, telling
from service.report.facts import facts_of
from service.report.page import page_of
from service.risk import POLICE_REPORTED, Baseline
from service.store import RunDirectory

DRAWN = 6  # dangerous rollouts in a report


def write_report(
    store: RunDirectory,
    out: Path | None = None,
    drawn: int = DRAWN,
    now: datetime | None = None,
    baseline: Baseline = POLICE_REPORTED,
    workers: int = 1,
) -> Path:
    """Write report.html and report.json into `out` (default: the run directory); the HTML file's path.

    Everything is taken from the record, so it works on a finished run, an interrupted one and one that still goes on.
    Dangerous rollouts are run again in `workers` processes, and `drawn` of them drawn (0: no SUMO, no failure modes, no
    risk). baseline: what the risk is held against. Raises StoreError where the record cannot be read, belongs to other
    weights, or the files cannot be written.
    """
    folder = store.path if out is None else out
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(folder, error) from error
    records = [replay(store, job) for job in store.jobs]
    seen = LookBack()
    if drawn:
        seen = look_back(store.path.name, telling(records), drawn, workers, store.path)
    facts = facts_of(store.path, records, seen, now or datetime.now(UTC), baseline)
    html = page_of(facts, records, seen)
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
