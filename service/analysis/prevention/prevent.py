"""From a job's record to what part of p a reference driver would have prevented."""

import inspect
import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from policies.references import REFERENCES, reference_driver
from service.analysis.failures.events import Events, Order, events_of
from service.analysis.failures.examine import (
    EXAMINED,
    Examined,
    Watch,
    look_away,
    mode_name,
    modes_by_position,
    sample_of,
)
from service.analysis.failures.find import notes_on
from service.analysis.failures.question import question_of
from service.analysis.failures.rerun import Rerun
from service.analysis.failures.tell import mode_p, mode_share, same_bits, share_within
from service.analysis.prevention.conflict import Conflict, Conflicts
from service.analysis.prevention.objects import ByReference, Driven, OfMode, Part, Prevented, Prevention
from service.analysis.prevention.onset import BRIDGED_S, TTC_S
from service.evaluation.record import JobRecord
from service.world.sim.rollout import Rollout

DEFAULT = ("r157-cc", "r157-5.2.5.2", "fsm")


def prevent(
    run: str,
    record: JobRecord,
    references: Sequence[str] = DEFAULT,
    order: Order = "likelihood",
    most: int = EXAMINED,
    onset_ttc_s: float = TTC_S,
    workers: int = 1,
    watch: Watch = look_away,
) -> Prevention:
    """Drive the dangerous rollouts of a job again, with the same x and noise, by each reference driver from the onset
    of the conflict on; one whose f is then above gamma is preventable.

    run: what the run is called
    references: names of reference drivers, or of egos
    order: of the ranks
    most: rollouts at most that are driven again, a sample of which the intervals know
    onset_ttc_s: see `service.analysis.prevention.onset`
    watch: told of (done, total)
    """
    events = events_of(record)
    sample = sample_of(events, most)
    with Conflicts(record.job, references, onset_ttc_s, workers) as conflicts:
        done = 0

        def on_done(count: int) -> None:
            nonlocal done
            done += count
            watch(done, sample.size)

        looked = dict(
            zip(sample.tolist(), conflicts.look(events.drawn(sample.tolist()), on_done), strict=True)
        )
    examined = Examined(events, sample, {i: _rerun(one) for i, one in looked.items()})
    (modes,) = modes_by_position([examined])
    rank = events.ranks(order)
    job, estimate = record.job, record.estimate
    return Prevention(
        **question_of(run, record),
        method=job.method,
        confidence=estimate.confidence,
        p=estimate.p if estimate.estimation_rollouts else None,
        ci=estimate.ci,
        order=order,
        onset_ttc_s=onset_ttc_s if math.isfinite(onset_ttc_s) else None,
        bridged_s=BRIDGED_S,
        events=len(events),
        examined=sample.size,
        references=tuple(_by_reference(name, examined, looked, modes) for name in references),
        rollouts=tuple(
            _told(events, i, looked[i], rank[i], modes[i]) for i in sorted(looked, key=rank.__getitem__)
        ),
        notes=(*notes_on(examined), *_notes(looked, references, estimate.gamma)),
    )


def prevented(driven: Rollout | None, gamma: float) -> bool:
    """Whether the event f <= gamma did not come about; a rollout that failed says nothing, and does not count."""
    return driven is not None and driven.error is None and driven.f > gamma


def _rerun(one: Conflict) -> Rerun:
    return Rerun(one.f, one.outcome, one.error, motion=one.motion)


def _by_reference(
    name: str, examined: Examined, looked: dict[int, Conflict], modes: dict[int, str]
) -> ByReference:
    events, sample = examined.events, examined.sample.tolist()
    gamma = events.record.estimate.gamma
    driven = [(looked[i].driven or {}).get(name) for i in sample]
    saved = np.array([prevented(one, gamma) for one in driven], dtype=bool)
    of = np.array([modes[i] for i in sample])
    told = []
    for mode in sorted(set(of.tolist()), key=lambda m: (-float(events.share[sample][of == m].sum()), m)):
        member = of == mode
        share, low, high = share_within(examined, member & saved, member)
        told.append(
            OfMode(
                mode=mode,
                name=mode_name(mode),
                events=int(member.sum()),
                prevented=int((member & saved).sum()),
                share=share,
                share_ci=(low, high),
                preventable=_part(examined, member & saved),
                unpreventable=_part(examined, member & ~saved),
            )
        )
    return ByReference(
        reference=name,
        says=says(name),
        preventable=_part(examined, saved),
        unpreventable=_part(examined, ~saved),
        modes=tuple(told),
        outcomes=dict(Counter(one.outcome for one in driven if one is not None)),
        failed=sum(one is None or one.error is not None for one in driven),
    )


def says(name: str) -> str:
    """What a reference driver is, with its source and constants; "" for an ego."""
    return inspect.getdoc(reference_driver(name)) or "" if name in REFERENCES else ""


def _part(examined: Examined, member: np.ndarray) -> Part:
    share, low, high = mode_share(examined, member)
    p, ci = mode_p(examined, member, (share, low, high))
    return Part(events=int(member.sum()), share=share, share_ci=(low, high), p=p, ci=ci)


def _told(events: Events, i: int, one: Conflict, rank: int, mode: str) -> Prevented:
    record = events.record
    other = None if one.onset is None else one.onset.other
    return Prevented(
        rank=rank,
        **events.located(i),
        same_to_the_bit=same_bits(one.f, float(events.f[i])),
        outcome=one.outcome,
        mode=mode,
        other=None if other is None else record.job.scenario.vehicles[other].name,
        onset=one.onset,
        driven={
            name: Driven(
                f=driven.f if math.isfinite(driven.f) else None,
                outcome=driven.outcome,
                prevented=prevented(driven, record.estimate.gamma),
                error=driven.error,
            )
            for name, driven in (one.driven or {}).items()
        },
    )


def _notes(looked: dict[int, Conflict], references: Sequence[str], gamma: float) -> list[str]:
    found = []
    for name in references:
        driven = [(one.driven or {}).get(name) for one in looked.values()]
        failed = sum(one is None or one.error is not None for one in driven)
        left = sum(prevented(one, gamma) and one is not None and one.outcome == "off-road" for one in driven)
        if failed:
            found.append(
                f"{failed} rollouts could not be driven by {name}; they count as unpreventable, so the true share may "
                "be higher."
            )
        if left:
            found.append(
                f"{left} rollouts counted as prevented by {name} left the road: the measure knows nothing of that."
            )
    return found
