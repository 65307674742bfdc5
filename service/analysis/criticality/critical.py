"""From a job's record to the criticality of its dangerous rollouts."""

import math

import numpy as np

from service.analysis.criticality import pair
from service.analysis.criticality.objects import Critical, Criticality
from service.analysis.criticality.over_time import TAU_S, over_time
from service.analysis.failures.events import Events, Order, events_of
from service.analysis.failures.question import question_of
from service.analysis.failures.rerun import Rerun, Rerunner
from service.evaluation.record import JobRecord

SHOWN = 20


def criticality_of(
    run: str, record: JobRecord, rerunner: Rerunner, order: Order = "likelihood", limit: int = SHOWN
) -> Criticality:
    """TTC, WTTC, TTB, TTR, BTN, TET and TIT of the first `limit` dangerous rollouts in the order asked for; each is run
    again.

    run: what the run is called
    """
    events = events_of(record)
    first = events.ranking(order)[:limit].tolist()
    again = rerunner.run(events.drawn(first), range(len(first)))
    return Criticality(
        **question_of(run, record),
        order=order,
        events=len(events),
        tau_s=TAU_S,
        assumptions=(
            f"Braking {pair.BRAKE_MPS2:g} m/s^2, full acceleration {pair.KICK_MPS2:g} m/s^2, evasion across "
            f"{pair.STEER_MPS2:g} m/s^2, each from one moment to the next; in the worst case both reach "
            f"{pair.WORST_MPS2:g} m/s^2 in any direction.",
            "The other keeps its velocity, headings stay, and nobody else and no edge of the road is in the way.",
        ),
        rollouts=tuple(
            _told(events, i, one, rank) for rank, (i, one) in enumerate(zip(first, again, strict=True), 1)
        ),
    )


def _told(events: Events, i: int, again: Rerun, rank: int) -> Critical:
    f, share = float(events.f[i]), float(events.share[i])
    if again.error is not None or again.trace is None:
        return Critical(rank=rank, share=share, f=f, other=None, error=again.error)
    vehicles = events.record.job.scenario.vehicles
    other = None if again.motion is None else again.motion.other
    if again.contact is not None:
        other = again.contact.other if again.contact.other < len(vehicles) else None
    if other is None:
        return Critical(rank=rank, share=share, f=f, other=None)
    found = over_time(again.trace, other)
    return Critical(
        rank=rank,
        share=share,
        f=f,
        other=vehicles[other].name,
        ttc_s=_finite(found.ttc_s),
        wttc_s=_finite(found.wttc_s),
        ttb_s=_finite(found.ttb_s),
        ttr_s=_finite(found.ttr_s),
        too_late_to_brake_s=_finite(found.brake_late_s),
        too_late_to_react_s=_finite(found.react_late_s),
        btn=_finite(found.btn),
        tet_s=found.tet_s,
        tit_s2=found.tit_s2,
    )


def _finite(value: float) -> float | None:
    return float(np.round(value, 6)) if math.isfinite(value) else None
