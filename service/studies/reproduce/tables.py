"""The tables of a page: rows of text, made from results alone."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from service.analysis.wording import count, significant
from service.studies.reproduce.local import Outcome
from service.studies.reproduce.plans import fine_gammas
from service.studies.reproduce.ratios import (
    UNKNOWN,
    Ratio,
    efficiency_of_repeats,
    efficiency_of_spread,
    ratio_of_rare_events,
    ratio_of_variances,
)
from service.studies.reproduce.results import Reading, Result

FAR = 2.0  # standard errors
# events of equal weight that an estimate must be worth for its own variance to be compared
LEAST_EFFECTIVE = 10.0

LEAST_KNOWN = 10  # events of the ground truth, below which runs are held against their own mean
UNBIASED = ("splitting", "naive")


class Table(NamedTuple):
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str


def number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None or math.isnan(value) else significant(value, digits)


def ratio_text(ratio: Ratio) -> str:
    """A ratio with its interval."""
    if math.isnan(ratio.low) or math.isnan(ratio.high):
        return "–"
    return f"{number(ratio.value)} ({number(ratio.low)} to {number(ratio.high)})"


def series_of(outcome: Outcome) -> dict[str, list[Result]]:
    """Results by series, in the plan's order."""
    found: dict[str, list[Result]] = {}
    for result in outcome.results:
        found.setdefault(result.run.series, []).append(result)
    return found


def pooled(outcome: Outcome, results: Sequence[Result], which: int) -> dict[str, Ratio]:
    """The ratios of a series at threshold number `which`: geometric means over repeats of what each run says of itself,
    and the efficiency from their spread about the ground truth. Where an estimate is worth fewer than LEAST_EFFECTIVE
    events its own variance says nothing, and what is made of it is not known."""
    gamma = outcome.plan.gammas[which]
    truth = outcome.truth.at([gamma])
    p, k = float(truth["p"][0]), int(truth["events"][0])
    p_error = 1.0 / math.sqrt(k) if k else math.nan
    readings = [r.readings[which] for r in results]
    events = ratio_of_rare_events(
        sum(r.events for r in readings), sum(r.estimation for r in results), k, outcome.truth.rollouts
    )
    apart = [
        ratio_of_variances(p, p_error, x.std_error, x.variance_error, r.estimation)
        for r, x in zip(results, readings, strict=True)
    ]
    counted = [
        ratio_of_variances(p, p_error, x.std_error, x.variance_error, r.rollouts)
        for r, x in zip(results, readings, strict=True)
    ]
    known = all(x.ess is not None and x.ess >= LEAST_EFFECTIVE for x in readings)
    estimates = np.array([np.nan if x.p is None else x.p for x in readings])
    spread = UNKNOWN
    rollouts = float(np.mean([r.rollouts for r in results]))
    if np.isfinite(estimates).all() and k >= LEAST_KNOWN:
        spread = efficiency_of_repeats(p, p_error, estimates, rollouts)
    elif np.isfinite(estimates).all() and all(r.method in UNBIASED for r in results):
        spread = efficiency_of_spread(estimates, rollouts)
    return {
        "events": events,
        "variances": _mean(apart) if known else UNKNOWN,
        "efficiency": _mean(counted) if known else UNKNOWN,
        "repeats": spread,
    }


def _mean(ratios: Sequence[Ratio]) -> Ratio:
    """Geometric mean; the interval is that of the mean of independent logarithms."""
    if not ratios or any(math.isnan(r.value) or not r.low > 0 for r in ratios):
        return UNKNOWN
    logs = np.log([r.value for r in ratios])
    half = math.sqrt(sum(math.log(r.high / r.value) ** 2 for r in ratios)) / len(ratios)
    value = float(np.exp(logs.mean()))
    return Ratio(value, value * math.exp(-half), value * math.exp(half))


def estimates_table(outcome: Outcome) -> Table:
    """Table 1 and Table 2: p with standard errors, a row a run, naive Monte Carlo last."""
    gammas = outcome.plan.gammas
    rows = []
    for result in outcome.results:
        mark = "" if result.reliable else " (see its warnings)"
        name = f"{result.run.series}, seed {result.run.seed}{mark}"
        rows.append((name, f"{count(result.training)} + {count(result.estimation)}",
                     *(_with_error(r.p, r.std_error) for r in result.readings)))  # fmt: skip
    rows.append(_truth_row(outcome, f"0 + {count(outcome.truth.rollouts)}"))
    truth = outcome.truth.at(gammas)
    ends = zip(truth["low"], truth["high"], strict=True)
    rows.append(("its 95% interval", "", *(f"{number(a)} to {number(b)}" for a, b in ends)))
    return Table(
        "Estimates of p, ± standard error",
        ("", "rollouts, search + estimate", *(f"γ = {g:g} s" for g in gammas)),
        tuple(rows),
        "An estimate whose warnings say so has a standard error that cannot be relied on: its interval is wider.",
    )


def thresholds_table(outcome: Outcome) -> Table:
    """Where the rare events are: the threshold at which p is each power of ten, to FINE_S, with an interval by the
    binomial count of values below a quantile."""
    from scipy.stats import binom  # slow to import, and for this page alone

    gammas = fine_gammas()
    n, events = outcome.truth.rollouts, outcome.truth.at(gammas)["events"]
    rows = []
    for p in POWERS:
        ranks = (round(p * n), int(binom.ppf(0.025, n, p)), int(binom.ppf(0.975, n, p)) + 1)
        if ranks[0] >= 1 and events[-1] >= ranks[2]:
            gamma, low, high = (f"{gammas[np.searchsorted(events, rank)]:.3f} s" for rank in ranks)
            rows.append((number(p), gamma, f"{low if ranks[1] else 'not known'} to {high}", count(ranks[0])))
    return Table(
        "Thresholds",
        ("p", "γ", "95% interval", "events"),
        tuple(rows),
        "Order statistics of the ground truth.",
    )


def _truth_row(outcome: Outcome, rollouts: str) -> tuple[str, ...]:
    truth = outcome.truth.at(outcome.plan.gammas)
    cells = (_with_error(p, s) for p, s in zip(truth["p"], truth["std_error"], strict=True))
    return ("naive Monte Carlo (ground truth)", rollouts, *cells)


def _with_error(p: float | None, std_error: float | None) -> str:
    return f"{number(p)} ± {number(std_error)}"


def far_from_truth(outcome: Outcome, reading: Reading) -> bool | None:
    """Whether an estimate lies more than FAR joint standard errors from the truth; None where that is not known."""
    truth = outcome.truth.at([reading.gamma])
    if not truth["events"][0] or not reading.std_error or reading.p is None:
        return None
    joint = math.hypot(float(truth["std_error"][0]), reading.std_error)
    return abs(reading.p - float(truth["p"][0])) > FAR * joint


def together_table(outcome: Outcome) -> Table:
    """The repeats of each series as one estimate; a series of a single run has none."""
    gammas = outcome.plan.gammas
    rows = []
    for name, results in series_of(outcome).items():
        if len(results) < 2:
            continue
        cells = []
        for i in range(len(gammas)):
            p = np.array([np.nan if r.readings[i].p is None else r.readings[i].p for r in results])
            cells.append(_with_error(float(p.mean()), float(p.std(ddof=1)) / math.sqrt(p.size)))
        rows.append((name, count(sum(r.rollouts for r in results)), *cells))
    rows.append(_truth_row(outcome, count(outcome.truth.rollouts)))
    head = ("", "rollouts", *(f"γ = {g:g} s" for g in gammas))
    return Table(
        "Repeats together, ± standard error from their spread", head, tuple(rows), "Mean of the runs."
    )


def ratios_table(outcome: Outcome, key: str, title: str, note: str) -> Table:
    """One of the ratios, a row a series, a column a threshold."""
    gammas = outcome.plan.gammas
    rows = []
    for name, results in series_of(outcome).items():
        shaky = "" if all(r.reliable for r in results) else " *"
        found = [pooled(outcome, results, i)[key] for i in range(len(gammas))]
        rows.append((name + (shaky if key != "events" else ""), *(ratio_text(r) for r in found)))
    return Table(title, ("", *(f"γ = {g:g} s" for g in gammas)), tuple(rows), note)


def holds_truth(outcome: Outcome, reading: Reading) -> bool | None:
    """Whether an estimate's interval holds the ground truth; None where that has too few events to say."""
    truth = outcome.truth.at([reading.gamma])
    if truth["events"][0] < LEAST_KNOWN or reading.low is None or reading.high is None:
        return None
    return reading.low <= float(truth["p"][0]) <= reading.high


def warnings_table(outcome: Outcome) -> Table:
    """What the runs say of themselves."""
    rows = []
    for name, results in series_of(outcome).items():
        far = [far_from_truth(outcome, reading) for r in results for reading in r.readings]
        known = [v for v in far if v is not None]
        held = [holds_truth(outcome, reading) for r in results for reading in r.readings]
        decided = [v for v in held if v is not None]
        names = sorted({w for r in results for w in r.warnings})
        rows.append((name, str(len(results)), f"{sum(known)} of {len(known)}", f"{sum(decided)} of {len(decided)}",
                     number(max(r.max_weight_share for r in results)), ", ".join(names) or "none"))  # fmt: skip
    return Table(
        "What the runs say of themselves",
        ("", "runs", f"estimates more than {FAR:g} joint standard errors from the ground truth",
         "95% intervals that hold it", "largest weight's share", "warnings"),
        tuple(rows),
        "Estimates at all thresholds are counted, where the ground truth has events; intervals where it has "
        f"{LEAST_KNOWN} of them. Joint: of the estimate and of the ground truth.",
    )  # fmt: skip


POWERS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
STARRED = (
    "* a run's own warnings say that its variance cannot be relied on. –: not known; an estimate is worth fewer than "
    f"{LEAST_EFFECTIVE:g} events of equal weight there, or there are none. "
)
VARIANCES_NOTE = (
    STARRED
    + "Variance of naive Monte Carlo with as many rollouts as the estimate has, over the estimate's own: the "
    "training is left out, as in the paper."
)
EFFICIENCY_NOTE = (
    STARRED + "The same against naive Monte Carlo with as many rollouts in all, training counted."
)
REPEATS_NOTE = (
    "Variance of naive Monte Carlo with as many rollouts in all over the mean squared error of repeated runs about the "
    "ground truth: what a run of this method is worth, whatever it says of itself. Where the ground truth has fewer "
    f"than {LEAST_KNOWN} events, for unbiased methods: about the mean of the runs, which then counts as one estimate."
)
EVENTS_NOTE = "Events a rollout under the proposal over events a rollout under P0."


def tables_of(outcome: Outcome) -> list[Table]:
    """Every table of the page; that of a ground truth alone has two."""
    if not outcome.results:
        return [thresholds_table(outcome), estimates_table(outcome)]
    found = [
        estimates_table(outcome),
        ratios_table(outcome, "events", "Ratio of rare events to naive Monte Carlo", EVENTS_NOTE),
        ratios_table(outcome, "variances", "Ratio of variances, training left out", VARIANCES_NOTE),
        ratios_table(outcome, "efficiency", "Efficiency, training counted", EFFICIENCY_NOTE),
    ]
    if any(len(results) > 1 for results in series_of(outcome).values()):
        found.append(together_table(outcome))
        found.append(
            ratios_table(outcome, "repeats", "Efficiency by repeated runs, training counted", REPEATS_NOTE)
        )
    return [*found, warnings_table(outcome)]
