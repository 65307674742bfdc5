"""What the other vehicle's driver did wrong before a dangerous moment: whether it looked away, and how slow it is.

Only drivers of a scenario's [human] table look away and take time to react. What is told of them are the coordinates of
X by name (`service.world.scenario.causes`), as they came true in the rollout.
"""

import math

import msgspec
import numpy as np

from service.analysis.failures.motion import Motion
from service.analysis.trace import Trace
from service.evaluation.endings import in_words
from service.world.safety.contact import Contact
from service.world.scenario.base import causes
from service.world.scenario.causes import GLANCE_ONSET_S, REACTION_S
from service.world.scenario.schema import Scenario
from service.world.sim import minds as M

RECENT_S = 1.5  # a glance that ended this short a time before the moment had to do with it
SLOW_S = 1.5  # a reaction time that people have to surprises (Green 2000); the median is 0.9 s
SHORTEST_S = 0.3  # a shorter glance is none that matters

NAMES = {  # in the order in which a rollout falls under them
    "looked-away-in-conflict": "the other driver looks away although a conflict is near",
    "looked-away": "the other driver looks away",
    "slow": "the other driver reacts slowly",
    "attentive": "the other driver sees and reacts",
}


class Lapse(msgspec.Struct, frozen=True, kw_only=True):
    """The other vehicle's driver before the moment of smallest f.

    away_s: how long its last glance off the road had lasted by then, 0 without one within RECENT_S
    ago_s: how long before the moment it had looked up again; 0: it had not
    in_conflict: whether the glance began although a conflict was near (it leaked)
    named: whether it is the glance that X names (glance_onset_s, glance_duration_s, glance_leak)
    reaction_s: its reaction time
    """

    away_s: float
    ago_s: float
    in_conflict: bool
    named: bool
    reaction_s: float

    @property
    def kind(self) -> str:
        """A key of NAMES."""
        if self.away_s >= SHORTEST_S:
            return "looked-away-in-conflict" if self.in_conflict else "looked-away"
        return "slow" if self.reaction_s >= SLOW_S else "attentive"


def lapse_of(trace: Trace, motion: Motion | None, scenario: Scenario, x: np.ndarray) -> Lapse | None:
    """The lapse of the vehicle that the smallest value is to; None where drivers have none.

    x: (d,) the draw of the rollout
    """
    if scenario.human is None or motion is None or not trace.minds.size:
        return None
    minds = trace.minds[:, motion.other]
    dt_s = scenario.time.step_s
    at = int(np.searchsorted(trace.time_s, motion.time_s - 1e-9))
    named = causes(scenario, x)[motion.other]
    away_s = ago_s = 0.0
    begun = None
    if minds[at, M.SINCE_AWAY_S] <= RECENT_S + 1e-9 and minds[at, M.LONGEST_AWAY_S] > 0.0:
        ago_s = float(minds[at, M.SINCE_AWAY_S]) if minds[at, M.AWAY_S] == 0.0 else 0.0
        last = at - round(ago_s / dt_s)  # the last state before which it was away
        begun = last
        while begun > 0 and minds[begun, M.SINCE_AWAY_S] == 0.0:
            begun -= 1
        away_s = (last - begun) * dt_s
    leaked = begun is not None and bool(minds[at, M.LEAKED] > minds[begun, M.LEAKED])
    onset = float(named[GLANCE_ONSET_S])
    return Lapse(
        away_s=away_s,
        ago_s=ago_s,
        in_conflict=leaked,
        named=begun is not None and math.isfinite(onset) and int(onset / dt_s) == begun,
        reaction_s=float(named[REACTION_S]),
    )


def sentence(motion: Motion, lapse: Lapse | None, other: str, contact: Contact | None = None) -> str:
    """What came together, as one would tell it: `env4 looks away 1.9 s while the ego slows, and closes at 4.0 m/s`, or,
    where they touched, `... and runs into the ego's rear at 4.0 m/s`."""
    end = _closing(motion) if contact is None else _touching(contact)
    return f"{other} {_did(motion, lapse)} while the ego {_ego(motion)}{end}"


def _did(motion: Motion, lapse: Lapse | None) -> str:
    towards = -math.copysign(1.0, motion.before_left_m) * motion.other_moved_left_m
    across = f"comes over by {towards:.1f} m" if towards > 0.3 else ""
    if lapse is not None and lapse.kind.startswith("looked-away"):
        away = f"looks away {lapse.away_s:.1f} s"
        return f"{away} and {across}" if across else away
    if lapse is not None and lapse.kind == "slow" and motion.ahead_m < 0.0:
        return f"takes {lapse.reaction_s:.1f} s to react"
    if across:
        return across
    if motion.other_braking_mps2 >= 1.0 and motion.ahead_m > 0.0:
        return f"brakes at {motion.other_braking_mps2:.1f} m/s²"
    return f"drives at {motion.other_speed_mps:.1f} m/s"


def _ego(motion: Motion) -> str:
    towards = math.copysign(1.0, motion.before_left_m) * motion.ego_moved_left_m
    if towards > 0.3:
        return f"comes over by {towards:.1f} m"
    if motion.ego_braking_mps2 >= 1.0:
        return "slows"
    return f"drives at {motion.ego_speed_mps:.1f} m/s"


def _touching(contact: Contact) -> str:
    """Who came into whose side, at what relative speed; a front runs, a side comes."""
    mine, theirs = in_words(contact.ego_side), in_words(contact.other_side)
    speed = f"at {contact.speed_mps:.1f} m/s"
    if contact.striking == "ego":
        return f", and the ego {'runs' if contact.ego_side == 'front' else 'comes'} into its {theirs} {speed}"
    return f", and {'runs' if contact.other_side == 'front' else 'comes'} into the ego's {mine} {speed}"


def _closing(motion: Motion) -> str:
    if motion.closing_along_mps >= 0.5:
        # who is behind closes
        return (
            f", and {'the ego ' if motion.ahead_m > 0.0 else ''}closes at {motion.closing_along_mps:.1f} m/s"
        )
    if motion.closing_across_mps >= 0.1:
        return f", and the sides close at {motion.closing_across_mps:.1f} m/s"
    return ""
