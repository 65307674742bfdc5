"""Pictures as SVG that takes its colours from the page: light, dark and printed alike."""

from service.dashboard.charts.chart import Chart, Mark, Series
from service.dashboard.charts.svg import figure

__all__ = ["Chart", "Mark", "Series", "figure"]
