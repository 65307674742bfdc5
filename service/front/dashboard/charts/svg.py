"""A chart as a figure of a page: SVG, a legend, and all its values for the reader who points at it, tabs to it, or does
not see it."""

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from urllib.parse import quote

from markupsafe import Markup, escape

from service.analysis.wording import significant
from service.front.dashboard.charts.chart import Chart, Series
from service.front.dashboard.charts.scale import Scale, fitting

WIDTH, HEIGHT = 480, 280
LEFT, RIGHT, TOP, BOTTOM = 70, 12, 12, 44
X_TICKS, Y_TICKS = 5, 6
MOST_POINTS = 400  # of a series that are drawn; more are thinned evenly
FAR_BELOW = 30.0
DEEPEST = 1e-15  # of the highest: what lies below it is drawn at the foot of the axis
LETTER = 7.0  # width, about


def figure(chart: Chart) -> Markup:
    """The figure element."""
    if chart.empty:
        return Markup(
            '<figure class="chart" id="{}"><h3>{}</h3><p class="quiet">Nothing to draw yet.</p></figure>'
        ).format(chart.id, chart.title)
    series = [_thinned(one) for one in chart.series]
    xs = [x for one in series for x in _known(one.x)]
    ys = _heights(chart, series)
    marked = {axis: [m.value for m in chart.marks if m.axis == axis] for axis in "xy"}
    x = fitting(xs, LEFT, WIDTH - RIGHT, chart.x_log, (*marked["x"], *chart.x_include), chart.x_whole)
    y = fitting(ys, HEIGHT - BOTTOM, TOP, chart.y_log, (*marked["y"], *chart.y_include))
    drawn = "".join([*_axes(chart, x, y), *_marks(chart, x, y), *(_series(one, x, y) for one in series)])
    return Markup(
        '<figure class="chart" id="{id}"><h3 id="{id}-title">{title}</h3>{legend}'
        '<svg viewBox="0 0 {width} {height}" id="{id}-picture" role="img" tabindex="0" aria-labelledby="{id}-title" '
        'aria-describedby="{id}-shows" data-chart="{data}">{drawn}<g class="cross" hidden></g></svg>'
        '<p class="readout small" role="status" id="{id}-readout"></p>'
        '<figcaption><span id="{id}-shows"{unseen}>{shows}</span>{note} '
        '<a class="small" href="{csv}" download="{id}.csv">Data (CSV)</a></figcaption></figure>'
    ).format(
        id=chart.id,
        title=chart.title,
        legend=_legend(series),
        width=WIDTH,
        height=HEIGHT,
        data=json.dumps(_readable(chart, series, x)),
        drawn=Markup(drawn),
        unseen=Markup(' class="unseen"'),
        shows=chart.shows,
        csv="data:text/csv;charset=utf-8," + quote(csv_of(chart)),
        note=Markup('<span class="quiet small">{}</span>').format(chart.note) if chart.note else "",
    )


def csv_of(chart: Chart) -> str:
    """The chart's values, all of them: a line a point, columns for x, each series and its interval's ends."""
    columns: dict[str, dict[float, float | None]] = {}
    for one in chart.series:
        name = one.name if len(chart.series) > 1 else chart.y_label
        for title, values in ((name, one.y), (f"{name} low", one.low), (f"{name} high", one.high)):
            if values:
                columns[title] = {x: v for x, v in zip(one.x, values, strict=True) if x is not None}
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow([chart.x_label, *columns])
    for x in sorted({x for values in columns.values() for x in values}):
        writer.writerow([repr(x), *("" if (v := c.get(x)) is None else repr(v) for c in columns.values())])
    return text.getvalue()


def _heights(chart: Chart, series: Sequence[Series]) -> list[float]:
    """What the y axis must show; on a logarithmic one no interval's end far below all values."""
    values = [y for one in series for y in _known(one.y)]
    ends = [y for one in series for y in (*_known(one.low), *_known(one.high))]
    if chart.y_log:
        least = min((y for y in values if y > 0.0), default=0.0) / FAR_BELOW
        least = max(least, DEEPEST * max((y for y in (*values, *ends) if y > 0.0), default=0.0))
        return [max(y, least) for y in values if y > 0.0] + [y for y in ends if y > least]
    return values + ends


def _axes(chart: Chart, x: Scale, y: Scale) -> Iterator[str]:
    for value, text in y.ticks(Y_TICKS):
        at = y(value)
        yield f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
        yield f'<text class="tick" x="{LEFT - 6}" y="{at + 4:.1f}" text-anchor="end">{escape(text)}</text>'
    floor = HEIGHT - BOTTOM
    yield f'<line class="axis" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{floor}" y2="{floor}"/>'
    for value, text in x.ticks(X_TICKS):
        at = x(value)
        half = LETTER * len(text) / 2
        place = min(max(at, half), WIDTH - half)
        yield f'<line class="axis" x1="{at:.1f}" x2="{at:.1f}" y1="{floor}" y2="{floor + 4}"/>'
        yield f'<text class="tick" x="{place:.1f}" y="{floor + 17}" text-anchor="middle">{escape(text)}</text>'
    yield (
        f'<text class="label" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 6}" text-anchor="middle">'
        f"{escape(chart.x_label)}</text>"
    )
    middle = (TOP + floor) / 2
    yield (
        f'<text class="label" x="13" y="{middle}" text-anchor="middle" transform="rotate(-90 13 {middle})">'
        f"{escape(chart.y_label)}</text>"
    )


def _marks(chart: Chart, x: Scale, y: Scale) -> Iterator[str]:
    for mark in chart.marks:
        if mark.axis == "x":
            at = x(mark.value)
            right = at > (LEFT + WIDTH) / 2
            yield f'<line class="mark" x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
            place, anchor = (at - 5, "end") if right else (at + 5, "start")
            yield f'<text class="tick" x="{place:.1f}" y="{TOP + 10}" text-anchor="{anchor}">{escape(mark.text)}</text>'
        else:
            at = y(mark.value)
            above = at > TOP + 20
            yield f'<line class="mark" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{at:.1f}" y2="{at:.1f}"/>'
            yield (
                f'<text class="tick" x="{WIDTH - RIGHT - 2}" y="{at - 4 if above else at + 13:.1f}" text-anchor="end">'
                f"{escape(mark.text)}</text>"
            )


def _series(series: Series, x: Scale, y: Scale) -> str:
    parts = []
    for run in _runs(series.x, series.low, series.high):
        there = [f"{x(a):.1f},{y(low):.1f}" for a, low, _ in run]
        back = [f"{x(a):.1f},{y(high):.1f}" for a, _, high in reversed(run)]
        if len(run) == 1:
            a, low, high = run[0]
            parts.append(
                f'<line class="whisker" x1="{x(a):.1f}" x2="{x(a):.1f}" y1="{y(low):.1f}" y2="{y(high):.1f}"/>'
            )
        else:
            parts.append(f'<polygon class="band" points="{" ".join(there + back)}"/>')
    for run in _runs(series.x, series.y):
        places = [(x(a), y(b)) for a, b in run if b > 0.0 or not y.log]
        if series.kind == "points" or len(places) == 1:
            parts += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3.2"/>' for a, b in places]
        elif places:
            if series.kind == "steps":
                places = _stepped(places)
            parts.append(f'<polyline points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in places)}"/>')
    dashed = " dashed" if series.dashed else ""
    return f'<g class="series tone-{series.tone}{dashed}">{"".join(parts)}</g>'


def _stepped(places: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    found = [places[0]]
    for a, b in places[1:]:
        found += [(a, found[-1][1]), (a, b)]
    return found


def _runs(*columns: Sequence[float | None]) -> Iterator[list[tuple[float, ...]]]:
    """Rows without gaps, all of whose values are known."""
    run: list[tuple[float, ...]] = []
    for row in zip(*columns, strict=False):
        if all(value is not None and math.isfinite(value) for value in row):
            run.append(row)
        elif run:
            yield run
            run = []
    if run:
        yield run


def _known(values: Iterable[float | None]) -> list[float]:
    return [v for v in values if v is not None and math.isfinite(v)]


def _thinned(series: Series) -> Series:
    n = len(series.x)
    if n <= MOST_POINTS:
        return series
    keep = sorted({round(i * (n - 1) / (MOST_POINTS - 1)) for i in range(MOST_POINTS)})

    def thin(values: Sequence[float | None]) -> list[float | None]:
        return [values[i] for i in keep] if values else []

    return Series(series.name, thin(series.x), thin(series.y), thin(series.low), thin(series.high), series.tone,
                  series.kind, series.dashed)  # fmt: skip


def _legend(series: Sequence[Series]) -> Markup:
    if len(series) < 2:
        return Markup()
    entries = [
        Markup('<li class="tone-{}{}">{}</li>').format(one.tone, " dashed" if one.dashed else "", one.name)
        for one in series
    ]
    return Markup('<ul class="legend">{}</ul>').format(Markup().join(entries))


def _readable(chart: Chart, series: Sequence[Series], x: Scale) -> dict:
    """What the page's script needs to read values out: for each x the place and a sentence."""
    labels: dict[float, list[str]] = {}
    for one in series:
        for i, (a, b) in enumerate(zip(one.x, one.y, strict=True)):
            if a is None or b is None:
                continue
            text = f"{one.name}: " if len(series) > 1 else ""
            text += significant(b)
            if one.low and one.low[i] is not None and one.high[i] is not None:
                text += f" ({significant(one.low[i], 2)} to {significant(one.high[i], 2)})"
            labels.setdefault(a, []).append(text)
    return {
        "top": TOP,
        "bottom": HEIGHT - BOTTOM,
        "left": x.start,
        "right": x.end,
        "low": x.low,
        "high": x.high,
        "points": [
            [round(x(a), 1), f"{chart.x_label} {significant(a, 4)} – {'; '.join(labels[a])}"]
            for a in sorted(labels)
        ],
    }
