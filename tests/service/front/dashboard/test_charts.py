"""Charts: ticks that people can read, values where they belong, nothing that breaks the page."""

from __future__ import annotations

import csv
import json
import math
import re
from html import unescape

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.front.dashboard.charts import Chart, Mark, Series, figure
from service.front.dashboard.charts.scale import Scale, fitting
from service.front.dashboard.charts.svg import csv_of
from service.front.dashboard.pages.job_charts import wilson_interval

spans = st.floats(1e-9, 1e9).flatmap(lambda size: st.tuples(st.floats(-1e9, 1e9), st.just(size)))


def chart(*series: Series, **more) -> Chart:
    return Chart("c", "Title", "what it shows", "x", "y", series, **more)


@settings(deadline=None, max_examples=50)
@given(spans)
def test_even_ticks_lie_inside_and_are_not_many(span):
    low, size = span
    scale = Scale(low, low + size, 0.0, 100.0)
    if scale.high - scale.low < 1e-9 * max(abs(low), 1e-9):
        return
    ticks = scale.ticks(5)
    assert len(ticks) <= 6
    assert all(low - 1e-6 * size <= value <= low + size * (1 + 1e-6) for value, _ in ticks)


@settings(deadline=None, max_examples=50)
@given(st.floats(1e-12, 1e3), st.floats(1.5, 1e12))
def test_logarithmic_ticks_lie_inside_and_are_not_many(low, ratio):
    ticks = Scale(low, low * ratio, 0.0, 100.0, log=True).ticks(6)
    assert 1 <= len(ticks) <= 8
    assert all(low <= value <= low * ratio for value, _ in ticks)


def test_places_are_even_on_either_scale():
    assert [Scale(0, 10, 0, 100)(v) for v in (0, 2.5, 10, 12)] == [0, 25, 100, 100]
    log = Scale(1e-4, 1.0, 0, 100, log=True)
    assert [round(log(v)) for v in (1e-4, 1e-2, 1.0, 0.0)] == [0, 50, 100, 0]


def test_a_scale_without_values_is_one_all_the_same():
    for log in (False, True):
        assert fitting([math.nan], 0, 1, log).low < fitting([math.nan], 0, 1, log).high


def test_a_chart_has_its_values_for_those_who_point_at_it():
    drawn = str(figure(chart(Series("p", [1, 2, 3], [0.1, None, 0.3], [0.05, None, 0.2], [0.2, None, 0.4]))))
    told = json.loads(unescape(re.search(r'data-chart="([^"]*)"', drawn)[1]))
    assert [text for _, text in told["points"]] == [
        "x 1.000 – 0.100 (0.050 to 0.20)",
        "x 3.000 – 0.300 (0.20 to 0.40)",
    ]
    assert drawn.count("<circle") == 2  # the gap leaves two single points


def test_names_cannot_leave_their_place():
    evil = '"><script>alert(1)</script>'
    drawn = str(
        figure(
            chart(
                Series(evil, [1, 2], [1, 2]), Series("b", [1], [1]), marks=(Mark("x", 1.5, evil),), note=evil
            )
        )
    )
    assert "<script>" not in drawn


def test_many_points_are_thinned_with_both_ends_kept():
    n = 100_000
    drawn = str(figure(chart(Series("p", list(range(n)), list(range(n))))))
    told = json.loads(unescape(re.search(r'data-chart="([^"]*)"', drawn)[1]))["points"]
    assert len(told) == 400
    assert told[0][1].startswith("x 0 ")
    assert told[-1][1].startswith("x 99,999") or "100,000" in told[-1][1]


def test_a_low_end_of_nothing_does_not_flatten_a_logarithmic_chart():
    series = Series("p", [1, 2], [1e-3, 2e-3], [1e-300, 0.0], [1e-2, 1e-2])
    texts = re.findall(r'class="tick"[^>]*>([^<]*)<', str(figure(chart(series, y_log=True))))
    assert not any("⁻³⁰⁰" in text for text in texts)


def test_nothing_to_draw_is_said():
    assert "Nothing to draw yet" in str(figure(chart(Series("p", [1], [None]))))


@pytest.mark.parametrize(
    ("p", "n", "low", "high"),
    [(0.5, 100, 0.4038, 0.5962), (0.0, 100, 0.0, 0.0370), (1e-3, 10_000, 5.434e-4, 1.8396e-3)],
)
def test_the_naive_interval_is_wilsons(p, n, low, high):
    """Known values: 50 and 0 of 100; 10 of 10,000 (statsmodels' proportion_confint, method wilson)."""
    assert wilson_interval(p, n, 0.95) == pytest.approx((low, high), rel=2e-3, abs=1e-12)


def test_all_values_of_a_chart_come_as_csv_even_where_they_are_thinned():
    n = 1000
    chart = Chart(
        "c", "t", "s", "x, m", "p", (Series("p", list(range(n)), [0.5] * n, [0.1] * n, [None] * n),)
    )
    rows = list(csv.reader(csv_of(chart).splitlines()))
    assert rows[0] == ["x, m", "p", "p low", "p high"]
    assert rows[-1] == ["999", "0.5", "0.1", ""]
    assert len(rows) == n + 1
    assert "download" in figure(chart)
