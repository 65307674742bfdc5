"""Pictures as SVG that takes its colours from the page: light, dark and printed alike."""

from service.front.dashboard.charts.chart import Chart, Mark, Series
from service.front.dashboard.charts.svg import figure

__all__ = ["Chart", "Mark", "Series", "figure"]
