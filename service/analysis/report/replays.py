"""Replays inside the page: what the player needs of each rollout as JSON, and the player itself.

The page takes no script but this one: its Content-Security-Policy names the player's own hash.
"""

import base64
import hashlib
from pathlib import Path

import msgspec
import numpy as np
from markupsafe import Markup

from service.analysis.failures.play import playback_of
from service.analysis.report.dangerous import ShownRollout
from service.analysis.trace import Trace
from sumo_nets.corridor import Corridor

PLAYER = (Path(__file__).parent / "player.js").read_text(encoding="utf-8")
BEFORE_S, AFTER_S = 12.0, 4.0  # of the worst moment, that are kept of a long rollout
WHOLE_S = 20.0
MOST_STATES = 250  # further apart in time where there are more


def player() -> Markup:
    """The player's script."""
    return Markup(PLAYER)


def player_hash() -> str:
    """What a Content-Security-Policy calls the player."""
    digest = base64.b64encode(hashlib.sha256(PLAYER.encode()).digest()).decode("ascii")
    return f"'sha256-{digest}'"


def replay_json(rollout: ShownRollout, corridor: Corridor) -> Markup | None:
    """The rollout as JSON that may stand between script tags; None where it could not be run again."""
    trace = rollout.trace
    if trace is None or not trace.measured.size:
        return None
    played = playback_of(
        trace, corridor, rollout.record.estimate.gamma, rollout.threat, 0, states_shown(trace)
    )
    text = msgspec.json.encode(played).decode()
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))


def states_shown(trace: Trace) -> np.ndarray:
    """All states of a short rollout, those around the worst moment of a long one."""
    time_s = trace.time_s
    worst = int(np.argmin(np.where(np.isnan(trace.measured), np.inf, trace.measured)))
    if time_s[-1] <= WHOLE_S:
        shown = np.arange(time_s.size)
    else:
        shown = np.flatnonzero((time_s >= time_s[worst] - BEFORE_S) & (time_s <= time_s[worst] + AFTER_S))
    every = -(-shown.size // MOST_STATES)
    return shown[(shown - worst) % every == 0]  # the worst moment is always among them
