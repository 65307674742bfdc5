"""The pictures of a job's page."""

from collections.abc import Sequence
from functools import partial
from math import sqrt
from statistics import NormalDist

from service.analysis.wording import count, level, quantity, significant
from service.front.dashboard.charts import Chart, Mark, Series
from service.remote.api.objects import Curve, Estimate, EstimateStep, Job, SearchStep

FEW = 20.0  # times between smallest and largest p, above which the axis is logarithmic


def estimate_against_rollouts(job: Job, steps: Sequence[EstimateStep], training: int) -> Chart:
    """p and its interval after each batch. training: rollouts spent before."""
    known = [step for step in steps if step.p is not None]
    p = [step.p or 0.0 for step in known]
    ends = [e for step in known for e in (step.low, step.high) if e]
    confidence = level(float(job.options.get("confidence", 0.95)))
    after = f" after {count(training)} rollouts of training" if training else ""
    shows = (
        f"The estimate of p{after}, from {significant(p[0], 2)} at first to {significant(p[-1], 2)} now, "
        f"with its {confidence} interval."
        if known
        else ""
    )
    marks = (Mark("x", float(training), "training ends"),) if training else ()
    return Chart(
        id="chart-estimate",
        title="Estimate against rollouts",
        shows=shows,
        x_label="rollouts" + (", training counted" if training else ""),
        y_label="p",
        series=(
            Series(
                "p",
                [training + step.rollouts for step in known],
                p,
                [s.low for s in known],
                [s.high for s in known],
            ),
        ),
        marks=marks,
        y_log=_is_wide([*p, *ends]),
        note=f"Band: {confidence} interval.",
    )


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
        by_batch = partial(Chart, x_label="batch", marks=marks)
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
