"""What becomes of a service's database on disks that lie, as a page: `python -m tests.bench.store_faults --page FILE`.

Each play harms a copy of the database of a job that is done (`tests/service/remote/fleet/test_corrupted_stores.py`) and
asks what the job has come to.
"""

import logging
import platform
import sqlite3
import tempfile
import time
from collections import Counter
from pathlib import Path

import click
from scipy.stats import beta

from service.errors import TailroadError
from service.world.scenario import load_scenario
from tests.service.remote.fleet.test_corrupted_stores import KINDS, Disk, disk_of, harmed, told

WORDS = {
    "bits": "1 to 8 bits flipped anywhere in the file",
    "sector": "512 bytes zeroed",
    "page of before": "a page as it was before the job ran",
    "torn page": "half a page is another's",
    "cut": "the file ends early",
}


def outcome(disk: Disk, folder: Path, play: int) -> tuple[str, str]:
    """The kind of harm, and whether the store told the same, refused, told something else, or broke down."""
    kind, data = harmed(disk, play)
    for end in ("", "-wal", "-shm"):
        (folder / f"fleet.sqlite{end}").unlink(missing_ok=True)
    (folder / "fleet.sqlite").write_bytes(data)
    try:
        *answer, batches = told(folder, disk.job)
    except TailroadError:
        return kind, "refused"
    except Exception:
        return kind, "broke down"
    *right, all_batches = disk.told
    same = answer == right and batches == all_batches[: len(batches)]
    return kind, "the same" if same else "something else"


@click.command()
@click.option("--plays", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--page", type=click.Path(dir_okay=False, path_type=Path), required=True)
def main(plays: int, page: Path) -> None:
    logging.disable(logging.WARNING)
    seen: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory() as home, tempfile.TemporaryDirectory() as work:
        disk = disk_of(Path(home), load_scenario("i80-paper-10s"))
        began = time.process_time()
        for play in range(plays):
            seen[outcome(disk, Path(work), play)] += 1
        cpu_s = time.process_time() - began
    ends = ("the same", "refused", "something else", "broke down")
    totals = {end: sum(seen[kind, end] for kind in KINDS) for end in ends}
    wrong = totals["something else"] + totals["broke down"]
    most = float(beta.ppf(0.975, wrong + 1, plays - wrong)) if wrong < plays else 1.0
    rows = [f"| {WORDS[kind]} | {' | '.join(f'{seen[kind, end]:,}' for end in ends)} |" for kind in KINDS]
    rows.append(f"| **all {plays:,}** | {' | '.join(f'{totals[end]:,}' for end in ends)} |")
    page.write_text(
        f"""# Databases on disks that lie

The database of a service with a job that is done ({len(disk.whole):,} bytes of SQLite: 400 rollouts by a formula, the
question, what its batches came to, its kept state) is harmed, and then asked for the question, p, its interval, every
f, and what its batches came to. *The same*: to the bit (what the last batches came to on the way may be missing).
*Refused*: an error that names what is damaged, or says that the job is not over.

| harm | the same | refused | something else | broke down |
| --- | --- | --- | --- | --- |
{chr(10).join(rows)}

Wrong answers and breakdowns together: {wrong} of {plays:,}; 95% interval of their share: up to {most:.2g}
(Clopper-Pearson). Harm that hits nothing that is in use changes nothing, so that *the same* is no proof that harm is
found; *something else* would be the fault.

Command: `python -m tests.bench.store_faults --plays {plays} --page {page}`, {cpu_s:.0f} s of one core (Python
{platform.python_version()}, SQLite {sqlite3.sqlite_version}). A play is its number: the same number is the same harm at
the same place.
""",
        encoding="utf-8",
    )
    click.echo(f"{page}: {totals}")
    if wrong:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
