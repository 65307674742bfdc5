"""The page on peers."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from service.studies.reproduce.page import Page, made_by, made_with
from service.studies.reproduce.peers.timed import SCENARIO, SECONDS, timed
from service.studies.reproduce.tables import Table, number

# rounds, our rollouts in each
ROUNDS = {
    "smoke": (1, 10),
    "small": (3, 50),
    "medium": (5, 100),
    "large": (7, 150),
    "paper": (9, 200),
}


def peers_page(scale: str, out: Path, command: str, tell: Callable[[str], None]) -> Page:
    """Install, time and tell."""
    rounds, rollouts = ROUNDS[scale]
    found = timed(rounds, rollouts, out / "peers", tell)
    rows = []
    for one in found:
        rows.append((one.name, _speed_text(one.speed), one.failed or one.what))
    return Page(
        f"peers-{scale}",
        f"Beside other simulators ({scale})",
        [
            made_by(command, goes_on=False),
            f"Six vehicles, ten steps a second, {SECONDS} s a run, one core; simulated seconds for each second of "
            f"processor time, median and range of {rounds} rounds in turns. Each simulator is installed from the "
            "package index into an environment of its own. They do different things: what, the last column says. Ours "
            f"runs `{SCENARIO}`.",
            made_with(),
        ],
        [
            Table(
                "Simulated seconds a core-second",
                ("simulator", "× real time", "what it does"),
                tuple(rows),
                "",
            )
        ],
        [],
        found,
    )


def _speed_text(speed: tuple[float, ...]) -> str:
    """Median and range."""
    if not speed:
        return "–"
    return f"{number(float(np.median(speed)), 3)} ({number(min(speed), 3)} to {number(max(speed), 3)})"
