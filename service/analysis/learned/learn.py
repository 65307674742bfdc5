"""From a job's record to what its search learned."""

import math
from dataclasses import replace

import numpy as np

import ce
from service.analysis.exposure import STREAM
from service.analysis.failures.events import CHAINS, Events, events_of
from service.analysis.failures.rerun import Draw, Rerun, Rerunner
from service.analysis.learned.behaviours import Driven, behaviours_of
from service.analysis.learned.objects import Learned, Parameter
from service.analysis.learned.parameters import LEAST_EFFECTIVE, Draws, draws_of, parameters_of, search_ess
from service.evaluation.record import JobRecord

ROLLOUTS = 100  # run again under base and under proposal, for the behaviours


def learned_of(run: str, record: JobRecord, rerunner: Rerunner, rollouts: int = ROLLOUTS) -> Learned:
    """What the search of a job learned.

    run: what it is called
    rollouts: to run again for each side (0: none)
    """
    confidence = record.estimate.confidence
    events = events_of(record)
    parametric = record.job.method == "ce" and record.proposal is not None
    proposal = record.proposal if parametric else None
    iteration, ess = search_ess(record) if parametric else (_last(record), None)
    draws = None if parametric else draws_of(events)
    parameters = parameters_of(record, proposal, draws, ess, confidence)
    before = _driven(rerunner, _from_base(record, rollouts), np.ones(rollouts))
    after = _driven(rerunner, *_from_search(record, events, proposal, rollouts))
    if after is not None:
        # rollouts run again tell no more than what they were drawn from, or stand for, rests on
        most = ess if ess is not None else math.inf if draws is None else draws.ess
        after = replace(after, ess=min(after.ess, most))
    behaviours = () if before is None else tuple(behaviours_of(before, after, confidence))
    return Learned(
        job=run,
        iteration=iteration,
        source="proposal" if parametric else "none" if draws is None else "dangerous rollouts",
        confidence=confidence,
        effective=ess if parametric else None if draws is None else draws.ess,
        rollouts_run_again=(_count(before), _count(after)),
        parameters=tuple(parameters),
        behaviours=behaviours,
        summary=tuple(_summary(parameters) + [b.sentence for b in behaviours if b.sentence]),
        notes=tuple(_notes(record, proposal, draws, ess)),
    )


def _last(record: JobRecord) -> int | None:
    return record.training[-1].iteration if record.training else None


def _summary(parameters: list[Parameter]) -> list[str]:
    significant = [p for p in parameters if p.sentence]
    return [p.sentence for p in sorted(significant, key=lambda p: -abs(p.shift_sd or 0.0))]


def _from_base(record: JobRecord, count: int) -> list[Draw]:
    x, noise_seeds = ce.draw(record.problem.base, STREAM, "estimate", 0, 0, count)
    return list(zip(x, noise_seeds.tolist(), strict=True))


def _from_search(
    record: JobRecord, events: Events, proposal: ce.Product | None, count: int
) -> tuple[list[Draw], np.ndarray]:
    """Draws of the proposal, or the dangerous rollouts, with their weights."""
    if proposal is not None:
        x, noise_seeds = ce.draw(proposal, STREAM, "estimate", 1, 0, count)
        drawn: list[Draw] = list(zip(x, noise_seeds.tolist(), strict=True))
        return drawn, np.ones(count)
    n = min(len(events), count)
    if events.phase == CHAINS:
        at = np.unique(np.linspace(0, len(events) - 1, n).round().astype(np.int64)) if n else np.arange(0)
    else:
        at = np.arange(n)
    return events.drawn(at.tolist()), events.share[at]


def _driven(rerunner: Rerunner, drawn: list[Draw], weight: np.ndarray) -> Driven | None:
    if not drawn:
        return None
    again: list[Rerun] = rerunner.run(drawn)
    good = [i for i, one in enumerate(again) if one.driving is not None]
    if not good:
        return None
    mine = weight[good] / weight[good].sum()
    driving = [one.driving for one in again if one.driving is not None]
    return Driven(driving, mine, 1.0 / float(np.sum(mine**2)))


def _count(driven: Driven | None) -> int:
    return 0 if driven is None else len(driven.driving)


def _notes(
    record: JobRecord, proposal: ce.Product | None, draws: Draws | None, ess: float | None
) -> list[str]:
    notes = []
    if proposal is None and draws is None:
        return ["No search has ended and no rollout has been dangerous, so nothing is known beyond P0."]
    if proposal is not None:
        notes.append(
            "Proposal: the distribution that the estimate's rollouts are drawn from. How sure its shifts are is judged "
            f"by the {ess:.0f} rollouts of equal weight that its last step rests on."
        )
    else:
        notes.append(
            "Proposal: P0 given the event, from the dangerous rollouts with their weights; method "
            f"{record.job.method} has no proposal that single starts could be read from."
        )
    effective = ess if ess is not None else 0.0 if draws is None else draws.ess
    if effective < LEAST_EFFECTIVE:
        notes.append(
            f"It rests on {effective:.1f} rollouts of equal weight: too few to tell any shift from chance."
        )
    return notes
