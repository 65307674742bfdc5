"""The plots of a run's jobs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import ce
from service.analysis.report import ink
from service.analysis.report.ink import Picture
from service.analysis.report.words import METHOD_NAMES
from service.analysis.wording import count, percent, quantity, significant, told
from service.evaluation.record import JobRecord
from service.world.scenario.measures import measure_kind

Facts = dict[str, Any]
DECADES = 8  # a logarithmic axis of probabilities is not longer, whatever a stray estimate says
LOG_BELOW = 0.05  # estimates below this are shown on a logarithmic axis


def _name(method: str) -> str:
    return METHOD_NAMES.get(method, method)


def measure_words(measure: str) -> str:
    """A safety measure as an axis names it, with its unit."""
    kind = measure_kind(measure)
    return f"{kind.words.rstrip(',')}{', ' if kind.unit else ''}{kind.unit}"


def _array(values: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if v is None else v for v in values], dtype=np.float64)


def run_pictures(facts: Facts, records: Sequence[JobRecord]) -> list[Picture]:
    """What compares the jobs of the run."""
    known = [job for job in facts["jobs"] if job["rollouts"]["estimation"]]
    pictures = []
    if known:
        pictures += [estimate_against_rollouts(known), p_against_gamma(facts, known)]
        answered = [r for r in records if np.isfinite(r.estimate.f).any()]
        if answered:
            pictures.append(values_of_f(answered))
    if any(job["outcomes"] for job in facts["jobs"]):
        pictures.append(outcomes(facts["jobs"]))
    return pictures


def search_pictures(job: Facts) -> list[Picture]:
    """How a job's search went."""
    return [thresholds(job), weights(job)] if job["training"] else []


def estimate_against_rollouts(jobs: Sequence[Facts]) -> Picture:
    sentences = []
    shown = [v for job in jobs for v in (job["p"], *job["ci"]) if v]
    logarithmic = 0 < min((job["p"] for job in jobs if job["p"]), default=1.0) < LOG_BELOW
    with ink.figure(3.3) as drawn:
        axes = drawn.add_subplot()
        bottom, top = (min(shown) / 4.0, min(max(shown) * 4.0, 1.0)) if shown else (0.0, 1.0)
        bottom = max(bottom, top * 10.0**-DECADES)
        if not logarithmic:
            spread = max(max(shown, default=1.0) - min(shown, default=0.0), 0.01)
            bottom, top = max(min(shown) - spread, 0.0), min(max(shown) + spread, 1.0)
        for job in jobs:
            method, trace = job["method"], job["trace"]
            n, p = _array(trace["rollouts"]), _array(trace["p"])
            low, high = _array(trace["low"]), _array(trace["high"])
            style = ink.line(method)
            training = job["rollouts"]["training"]
            if training:
                axes.axvspan(0, training, color=style["color"], alpha=0.08, linewidth=0)
                axes.text(
                    training / 2,
                    0.02,
                    f"search of {method}",
                    color=style["color"],
                    fontsize=8,
                    ha="center",
                    va="bottom",
                    transform=axes.get_xaxis_transform(),
                )
            floor = bottom if logarithmic else 0.0
            axes.fill_between(
                n, np.maximum(low, floor), high, color=style["color"], alpha=ink.BAND, linewidth=0
            )
            axes.plot(n, np.where(p > 0, p, np.nan) if logarithmic else p, label=_name(method), **style)
            if n.size == 1:  # of replications, which have no running estimate
                axes.vlines(n, np.maximum(low, floor), high, color=style["color"], linewidth=2.0)
            axes.plot(n[-1:], p[-1:], ink.MARKERS.get(method, "D"), color=style["color"], markersize=5)
            sentences.append(
                f"{_name(method)} ends at {told(job['p'], job['ci']).value} "
                f"({told(job['p'], job['ci']).span}) "
                f"after {count(job['rollouts']['total'])} rollouts"
            )
        axes.set_xlim(left=0)
        axes.set_ylim(bottom, top)
        if logarithmic:
            ink.log_axis(axes, "y")
        ink.thousands(axes)
        axes.set_xlabel("rollouts, training included")
        axes.set_ylabel("estimate of p")
        axes.legend(loc="best")
        return ink.picture(
            drawn,
            "The estimate as rollouts come in",
            "Estimate of p against the number of rollouts: " + "; ".join(sentences) + ".",
            "Line: the estimate; band: its interval at that moment. Where a method searches first, its line starts "
            "after the shaded rollouts that the search took. Values below the axis are not shown.",
        )


def p_against_gamma(facts: Facts, jobs: Sequence[Facts]) -> Picture:
    gamma, unit = facts["scenario"]["gamma"], facts["scenario"]["unit"]
    with ink.figure(3.3) as drawn:
        axes = drawn.add_subplot()
        positive = [v for job in jobs for v in job["curve"]["p"] if v]
        bottom = max(min(positive, default=1e-6) / 5.0, max(positive, default=0.0) * 10.0**-DECADES)
        for job in jobs:
            curve, style = job["curve"], ink.line(job["method"])
            x, p = _array(curve["gamma"]), _array(curve["p"])
            low, high = _array(curve["low"]), _array(curve["high"])
            axes.fill_between(
                x,
                np.maximum(low, bottom),
                np.maximum(high, bottom),
                color=style["color"],
                alpha=ink.BAND,
                lw=0,
            )
            axes.plot(x, np.where(p > 0, p, np.nan), label=_name(job["method"]), **style)
        _mark_threshold(axes, gamma, unit)
        axes.set_xlim(*jobs[0]["curve"]["gamma"][:: len(jobs[0]["curve"]["gamma"]) - 1])
        axes.set_ylim(bottom, 1.2)
        ink.log_axis(axes, "y")
        if x[0] > 0:
            ink.log_axis(axes, "x", lambda v: f"{v:g}")
        words = measure_words(facts["scenario"]["measure"])
        _label(axes, f"threshold γ on f: {words}", "probability of f ≤ γ")
        return ink.picture(
            drawn,
            "The same question for other thresholds",
            f"Probability that f is at most gamma, for gamma from {x[0]:.3g} to {x[-1]:.3g}, with intervals, for "
            + " and ".join(_name(job["method"]) for job in jobs)
            + ".",
            "Each curve is from the same rollouts as the estimate; bands are intervals at each threshold by itself. A "
            f"search aims at γ = {quantity(gamma, unit)}, so its curve is widest, and least to be relied on, far from "
            "there. Values below the axis are not shown.",
        )


def _label(axes: Any, x: str, y: str) -> None:
    """Axes of what rises with f, so that the legend has room in the corner below."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.legend(loc="lower right")


def _mark_threshold(axes: Any, gamma: float, unit: str) -> None:
    axes.axvline(gamma, color=ink.BASE, linewidth=1.0)
    axes.text(
        gamma,
        1.0,
        f" γ = {quantity(gamma, unit)}",
        color=ink.BASE,
        va="bottom",
        transform=axes.get_xaxis_transform(),
    )


def values_of_f(records: Sequence[JobRecord]) -> Picture:
    measure = measure_words(records[0].job.scenario.safety.measure)
    gamma = records[0].job.gamma
    unit = measure_kind(records[0].job.scenario.safety.measure).unit
    sentences = []
    with ink.figure(3.3) as drawn:
        axes = drawn.add_subplot()
        lowest, highest, fewest = np.inf, gamma, 1.0
        for record in records:
            f = np.sort(record.estimate.f[np.isfinite(record.estimate.f)])
            n = record.estimate.f.size
            at = np.unique(np.geomspace(1, f.size, 400).round().astype(int))
            method = record.job.method
            source = "proposal" if record.estimate.log_weights is not None else "P0"
            if isinstance(record.estimate, ce.ReplicatedEstimate):
                source = "chains"
            axes.step(
                f[at - 1], at / n, where="post", label=f"{_name(method)} ({source})", **ink.line(method)
            )
            lowest, highest = min(lowest, f[0]), max(highest, f[int(0.98 * (f.size - 1))])
            fewest = min(fewest, 1.0 / n)
            events = np.count_nonzero(record.estimate.f <= gamma) / n
            sentences.append(f"{_name(method)} met the event in {percent(events)} of its rollouts")
        _mark_threshold(axes, gamma, unit)
        axes.set_xlim(lowest if lowest > 0 else None, max(highest, lowest * 1.5))
        axes.set_ylim(fewest, 1.2)
        if lowest > 0:
            ink.log_axis(axes, "x", lambda v: f"{v:g}")
        ink.log_axis(axes, "y", lambda v: percent(v, 1))
        _label(axes, f"f of a rollout: {measure}", "rollouts with f at most this")
        return ink.picture(
            drawn,
            "What the simulated rollouts were like",
            "Share of each method's estimation rollouts with f at most a value: "
            + "; ".join(sentences)
            + ".",
            "Rollouts as they were drawn, without weights: a proposal draws dangerous ones on purpose. Rollouts in "
            "which the ego never closed in on anything have no finite f and are the part missing at the top.",
        )


def outcomes(jobs: Sequence[Facts]) -> Picture:
    rows = sorted({name for job in jobs for ended in job["outcomes"].values() for name in ended})
    bars = [(job["method"], phase, ended) for job in jobs for phase, ended in job["outcomes"].items()]
    sentences = []
    with ink.figure(0.9 + 0.17 * len(rows) * (len(bars) + 0.8)) as drawn:
        axes = drawn.add_subplot()
        height = 0.8 / len(bars)
        smallest = 1.0
        for k, (method, phase, ended) in enumerate(bars):
            total = sum(ended.values())
            shares = np.array([ended.get(name, 0) / total for name in rows])
            smallest = min(smallest, *(s for s in shares if s > 0))
            at = np.arange(len(rows)) + (k - (len(bars) - 1) / 2) * height
            axes.barh(
                at,
                shares,
                height=0.9 * height,
                color=ink.colour(method),
                alpha=0.4 if phase == "train" else 1.0,
                label=f"{method}, {'search' if phase == 'train' else 'estimation'} ({count(total)})",
            )
            for y, share, name in zip(at, shares, rows, strict=True):
                axes.text(share, y, f" {count(ended.get(name, 0))}", va="center", fontsize=7)
            sentences.append(
                f"{_name(method)} {phase}: " + ", ".join(f"{n} {count(ended.get(n, 0))}" for n in rows)
            )
        axes.set_yticks(np.arange(len(rows)), rows)
        axes.invert_yaxis()
        axes.set_xlim(smallest / 3.0, 6.0)
        ink.log_axis(axes, "x", lambda v: percent(v, 1) if v <= 1.0 else "")
        axes.grid(False, axis="y")
        axes.set_xlabel("share of rollouts (number beside the bar)")
        drawn.legend(loc="outside upper left", ncols=2)
        return ink.picture(
            drawn,
            "How the rollouts ended",
            "Outcomes of rollouts. " + ". ".join(sentences) + ".",
            "As drawn, without weights. horizon: the time was up; finished: the ego reached the end of the road; "
            "collision, off-road, reversing: of the ego.",
        )


def thresholds(job: Facts) -> Picture:
    training, gamma = job["training"], job["gamma"]
    k = np.array([r["iteration"] for r in training])
    quantile = np.array([np.inf if r["quantile"] is None else r["quantile"] for r in training], dtype=float)
    gamma_k = np.array([np.nan if r["gamma_k"] is None else r["gamma_k"] for r in training], dtype=float)
    colour = ink.colour(job["method"])
    with ink.figure(3.0) as drawn:
        axes = drawn.add_subplot()
        axes.plot(k, gamma_k, "-", color=colour, marker="s", markersize=4, label="γₖ, the step's threshold")
        axes.plot(
            k, quantile, ":", color=colour, marker="v", markersize=4, label="ρ-quantile of f", linewidth=1.2
        )
        axes.axhline(
            gamma, color=ink.BASE, linewidth=1.0, label=f"γ = {quantity(gamma, job['unit'])}, the event"
        )
        axes.margins(y=0.1)
        axes.set_ylim(bottom=0.0 if min(gamma, np.min(quantile)) >= 0 else None)
        _iterations(axes, k)
        axes.set_ylabel(measure_words(job["measure"]))
        axes.legend(loc="best")
        last = significant(float(quantile[-1]))
        return ink.picture(
            drawn,
            "The search's threshold by iteration",
            f"gamma_k and the quantile of f by iteration: the quantile goes from {significant(float(quantile[0]))} "
            f"to {last}; gamma is {gamma:g}.",
            "The search has reached the event where the quantile is at or below γ.",
        )


def weights(job: Facts) -> Picture:
    training = job["training"]
    k = np.array([r["iteration"] for r in training])
    ess, share = _array([r["ess"] for r in training]), _array([r["max_weight_share"] for r in training])
    colour = ink.colour(job["method"])
    with ink.figure(3.0) as drawn:
        above, below = drawn.subplots(2, 1, sharex=True)
        above.plot(k, ess, "-s", color=colour, markersize=4)
        above.set_ylim(bottom=0)
        above.set_ylabel("effective\nsample size")
        below.plot(k, 100 * share, "-s", color=colour, markersize=4)
        below.set_ylim(0, 100 if np.nanmax(share) > 0.3 else None)
        below.set_ylabel("largest weight,\n% of all")
        _iterations(below, k)
        return ink.picture(
            drawn,
            "What each iteration's step rests on",
            f"Effective sample size of the elite weights by iteration, from {significant(ess[0])} to "
            f"{significant(ess[-1])}, and the largest weight's share, "
            f"from {percent(share[0])} to {percent(share[-1])}.",
            "Of the rollouts with f ≤ γₖ. A step that rests on a handful of effective rollouts moves at random.",
        )


def _iterations(axes: Any, k: np.ndarray) -> None:
    axes.set_xticks(k[:: max(1, len(k) // 10)])
    axes.set_xlabel("iteration of the search")
