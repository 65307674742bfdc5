"""Parameters against f: where in the coordinates of X, and in what the drivers did, the small values of f lie.

What many rollouts say is counted in cells, so that a picture of a million of them is as small as one of a thousand; the
dangerous ones are told one by one.
"""

import math
from collections.abc import Sequence

import numpy as np

from service.analysis.failures.driving import Driving
from service.analysis.failures.events import CHAINS, Events, events_of
from service.analysis.failures.rerun import Rerunner
from service.analysis.learned.parameters import kind_of, names_of
from service.analysis.learned.scatter_objects import Axis, Dangerous, Scatter
from service.evaluation.record import JobRecord
from service.world.scenario.measures import measure_kind, span

F_CELLS, X_CELLS = 24, 32
MOST_DANGEROUS = 500
RUN_AGAIN = 100  # rollouts, for what the drivers did in them
ROOM = 0.05  # of the axis of f, below the lowest
SIGNIFICANT = 6  # digits of a value
# name, what it is, unit
BEHAVIOURS = (
    ("speed", "mean speed of the drivers", "m/s"),
    ("headway", "mean time headway of the drivers who follow", "s"),
    ("lane_changes", "lane changes of the drivers", "per km"),
    ("hard_brakes", "hard brakings of the drivers", "per km"),
)


def scatter_of(run: str, record: JobRecord, rerunner: Rerunner, rollouts: int = RUN_AGAIN) -> Scatter:
    """The parameters of a job's rollouts against f.

    run: what it is called
    rollouts: dangerous ones at most to run again, for what the drivers did (0: none)
    """
    events = events_of(record)
    shown = _evenly(events, MOST_DANGEROUS)
    drawn = events.drawn(shown)
    names = names_of(record.job.scenario)
    sample = record.starts if len(record.starts) else np.zeros((0, len(names)))
    x = np.array([draw for draw, _ in drawn]).reshape(len(drawn), record.problem.base.dim)[:, : len(names)]
    unit = measure_kind(record.job.scenario.safety.measure).unit
    edges = f_edges(unit, record.estimate.gamma, np.concatenate([record.starts_f, events.f[shown]]))
    axes = [
        axis_of(f"{vehicle or 'weather'}.{key}", *kind_of(vehicle, key), sample[:, k], record.starts_f, x[:, k],
                events.share[shown], edges)
        for k, (vehicle, key) in enumerate(names)
    ]  # fmt: skip
    again = min(rollouts, len(drawn))
    driven = [one.driving for one in rerunner.run(drawn[:again])] if again else []
    rows = np.array([_behaviour(one) for one in driven]).reshape(again, len(BEHAVIOURS))
    behaviours = [
        axis_of(
            name, "behaviour", unit_, np.zeros(0), np.zeros(0), rows[:, k], events.share[shown[:again]], edges
        )
        for k, (name, _, unit_) in enumerate(BEHAVIOURS)
        if np.isfinite(rows[:, k]).any()
    ]
    told = {name: k for k, (name, _, _) in enumerate(BEHAVIOURS)}
    kept = [told[axis.name] for axis in behaviours]
    return Scatter(
        job=run,
        gamma=record.estimate.gamma,
        unit=unit,
        recorded=record.recorded,
        sampled=len(record.starts),
        events=len(events),
        f_edges=tuple(edges.tolist()),
        axes=(*axes, *behaviours),
        dangerous=tuple(
            _told(events, i, [*x[n], *(rows[n, kept] if n < again else [math.nan] * len(kept))])
            for n, i in enumerate(shown)
        ),
        run_again=again,
    )  # fmt: skip


def f_edges(unit: str, gamma: float, f: np.ndarray) -> np.ndarray:
    """Edges (F_CELLS + 1,) of the cells of f; the last cell takes all above it, too. f: the values that there are."""
    low, high = span(unit, gamma)
    least = min(gamma, float(np.min(f, where=np.isfinite(f), initial=high)))
    return np.linspace(max(low, least - ROOM * (high - least)), high, F_CELLS + 1)


def axis_of(
    name: str,
    kind: str,
    unit: str,
    values: np.ndarray,
    f: np.ndarray,
    dangerous: np.ndarray,
    weight: np.ndarray,
    edges: np.ndarray,
) -> Axis:
    """One parameter, of all rollouts of the sample and of the dangerous ones.

    values, f: (n,)
    dangerous, weight: (m,), weight not of sum one; NaN where the value is not known
    """
    both = np.concatenate([values, dangerous[np.isfinite(dangerous)]])
    low, high = (float(both.min()), float(both.max())) if both.size else (0.0, 1.0)
    high = high if high > low else low + 1.0
    good = np.isfinite(values) & ~np.isnan(f)
    x, y = values[good], np.clip(f[good], edges[0], edges[-1])
    counts, _, _ = np.histogram2d(y, x, bins=(edges, np.linspace(low, high, X_CELLS + 1)))
    return Axis(
        name=name,
        kind=kind,
        unit=unit,
        low=_short(low),
        high=_short(high),
        counts=tuple(tuple(map(int, row)) for row in counts.tolist()) if x.size else (),
        shift_sd=_shift(x, dangerous, weight),
    )


def _shift(x: np.ndarray, dangerous: np.ndarray, weight: np.ndarray) -> float | None:
    known = np.isfinite(dangerous)
    if x.size < 2 or not known.any() or not (sd := float(x.std())):
        return None
    weight = weight[known] if weight[known].sum() > 0.0 else np.ones(int(known.sum()))
    return _short((float(np.average(dangerous[known], weights=weight)) - float(x.mean())) / sd)


def _evenly(events: Events, most: int) -> list[int]:
    """Positions of at most so many of them: the lowest f of fresh draws, evenly spread ones of chains, which remember;
    the lowest f first."""
    order = np.argsort(events.f, kind="stable")
    if events.phase == CHAINS and len(events) > most:
        order = order[np.unique(np.linspace(0, len(events) - 1, most).round().astype(np.int64))]
    return order[:most].tolist()


def _behaviour(driving: Driving | None) -> tuple[float, ...]:
    """A value for each of BEHAVIOURS, NaN where the rollout says nothing."""
    if driving is None or not driving.states:
        return (math.nan,) * len(BEHAVIOURS)
    km = driving.km or math.nan
    return (
        driving.speed_mps / driving.states,
        driving.headway_s / driving.following if driving.following else math.nan,
        driving.lane_changes / km,
        driving.hard_brakes / km,
    )


def _told(events: Events, i: int, values: Sequence[float]) -> Dangerous:
    return Dangerous(
        phase=events.phase,
        iteration=int(events.iterations[i]),
        row=int(events.rows[i]),
        f=float(events.f[i]) if math.isfinite(events.f[i]) else None,
        share=_short(float(events.share[i])),
        values=tuple(_short(float(v)) if math.isfinite(v) else None for v in values),
    )


def _short(value: float) -> float:
    return float(f"{value:.{SIGNIFICANT}g}")
