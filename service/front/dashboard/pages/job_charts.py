"""The pictures of a job's page."""

from collections.abc import Sequence
from functools import partial
from math import sqrt
from statistics import NormalDist

from service.analysis.wording import DIGITS, count, level, quantity, significant
from service.front.dashboard.charts import Chart, Mark, Series
from service.remote.api.objects import Course, Curve, Estimate, EstimateStep, Job, SearchStep

FIRST_SHOWN = 50.0  # the first fiftieth of the rollouts says little, and its wide band would flatten the rest
FEW = 20.0  # times between smallest and largest p, above which the axis is logarithmic


def estimate_against_rollouts(job: Job, course: Course, batches: Sequence[EstimateStep]) -> Chart:
    """p and its interval as rollouts came in, those of the search before them; of replications, which have one point,
    after each batch that has finished some."""
    points = list(zip(course.rollouts, course.p, course.low, course.high, strict=True))
    if len(points) < 2:
        points = [(b.rollouts, b.p, b.low, b.high) for b in _changed(batches)] or points
    points = [one for one in points if one[0] * FIRST_SHOWN >= points[-1][0]]
    known = [(course.training + n, p, low, high) for n, p, low, high in points if p is not None]
    p = [one[1] for one in known]
    ends = [e for one in known for e in one[2:] if e]
    sure, training = level(course.confidence), course.training
    after = f" after {count(training)} rollouts of training" if training else ""
    shows = (
        f"The estimate of p{after}, from {significant(p[0], DIGITS)} at first to {significant(p[-1], DIGITS)} now, "
        f"with its {sure} interval."
        if known
        else ""
    )
    return Chart(
        id="chart-estimate",
        title="Estimate against rollouts",
        shows=shows,
        x_label="rollouts" + (", training counted" if training else ""),
        y_label="p",
        series=(
            Series("p", [one[0] for one in known], p, [one[2] for one in known], [one[3] for one in known]),
        ),
        marks=(Mark("x", float(training), "training ends"),) if training else (),
        y_log=_is_wide([*p[len(p) // 4 :], *ends[len(ends) // 4 :]]),
        x_include=(0.0,),
        note=f"Band: {sure} interval.",
    )


def _changed(batches: Sequence[EstimateStep]) -> list[EstimateStep]:
    """Those at which the estimate was another than before."""
    found: list[EstimateStep] = []
    for one in batches:
        if one.p is not None and (not found or one.p != found[-1].p):
            found.append(one)
    return found


def probability_against_threshold(job: Job, curve: Curve, estimate: Estimate) -> Chart:
    """p of every threshold from the same rollouts, and what naive Monte Carlo would know at the same cost."""
    points = [point for point in curve.points if point.p is not None]
    n = estimate.rollouts.total
    gammas: list[float | None] = [point.gamma for point in points]
    series = [
        Series(
            job.method, gammas, [p.p for p in points], [p.ci[0] for p in points], [p.ci[1] for p in points]
        )
    ]
    shows = f"p against the threshold, with pointwise {level(curve.confidence)} intervals."
    note = f"Bands: {level(curve.confidence)} intervals, pointwise, from the same rollouts."
    if job.method != "naive" and n and points:
        wilson = [wilson_interval(point.p or 0.0, n, curve.confidence) for point in points]
        low, high = [a for a, _ in wilson], [b for _, b in wilson]
        name = f"naive Monte Carlo, {count(n)} rollouts (expected)"
        series.insert(0, Series(name, gammas, [p.p for p in points], low, high, tone=0, dashed=True))
        shows += (
            f" Beside it the interval that naive Monte Carlo would have after as many rollouts, {count(n)}."
        )
        note += " Grey: what naive Monte Carlo would come to at the same cost, training counted, if p is as estimated."
    values = [point.p for point in points if point.p]
    return Chart(
        id="chart-curve",
        title="Probability against threshold",
        shows=shows,
        x_label=axis("threshold γ", job.unit),
        y_label="p = P₀(f ≤ γ)",
        series=tuple(series),
        marks=(Mark("x", job.gamma, f"γ = {quantity(job.gamma, job.unit)}"),),
        y_log=_is_wide(values),
        note=note,
    )


def wilson_interval(p: float, n: int, confidence: float) -> tuple[float, float]:
    """Wilson's score interval of a share p of n rollouts."""
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return max(centre - half, 0.0), min(centre + half, 1.0)


def of_the_search(job: Job, search: Sequence[SearchStep], estimate: Sequence[EstimateStep]) -> list[Chart]:
    """gamma_k, ESS and the largest weight by iteration, of the search and then of the estimate's batches."""
    charts = []
    if search:
        x: list[float | None] = [step.iteration + 1 for step in search]
        charts.append(
            Chart(
                id="chart-gamma",
                title="Threshold of the search",
                shows=f"The threshold gamma k of each iteration; the search aims at {quantity(job.gamma, job.unit)}.",
                x_label="iteration",
                x_whole=True,
                y_label=axis("γ_k", job.unit),
                series=(Series("γ_k", x, [step.gamma_k for step in search]),),
                marks=(Mark("y", job.gamma, f"γ = {quantity(job.gamma, job.unit)}"),),
            )
        )
        if any(step.kl is not None for step in search):
            charts.append(
                Chart(
                    id="chart-kl",
                    title="How far the proposal moved",
                    shows="Kullback-Leibler divergence of the proposal from P0 at each iteration.",
                    x_label="iteration",
                    x_whole=True,
                    y_label="nats from P₀",
                    series=(Series("KL", x, [step.kl for step in search]),),
                    y_include=(0.0,),
                )
            )
    both: list[SearchStep | EstimateStep] = [*search, *estimate]
    if both and job.method != "naive":
        numbers: list[float | None] = [float(i) for i in range(1, len(both) + 1)]
        marks = (Mark("x", len(search) + 0.5, "estimate begins"),) if search and estimate else ()
        ess = [step.ess for step in both]
        by_batch = partial(Chart, x_label="batch", x_whole=True, marks=marks)
        charts += [
            by_batch(
                id="chart-ess",
                title="Effective sample size",
                shows="The effective sample size after each batch.",
                y_label="ESS",
                series=(Series("ESS", numbers, ess),),
                y_log=_is_wide([value for value in ess if value]),
            ),
            by_batch(
                id="chart-weight",
                title="Largest weight",
                shows="The share of the largest weight in all weights after each batch; a tenth and more is too much.",
                y_label="share of the largest weight",
                series=(Series("largest weight", numbers, [step.max_weight_share for step in both]),),
                y_include=(0.0,),
            ),
        ]
    return charts


def axis(name: str, unit: str) -> str:
    """What an axis is called."""
    return f"{name}, {unit}" if unit else name


def _is_wide(values: Sequence[float]) -> bool:
    above = [value for value in values if value > 0.0]
    return bool(above) and max(above) > FEW * min(above)
