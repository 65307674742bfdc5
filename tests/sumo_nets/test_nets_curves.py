"""Smoothing and resampling of polylines."""

from __future__ import annotations

import numpy as np
import pytest

from sumo_nets.curves import even_curve, smooth_curve, whittaker
from sumo_nets.errors import NetworkError


def circle(radius_m: float, length_m: float, step_m: float) -> np.ndarray:
    angle = np.arange(0.0, length_m + step_m / 2, step_m) / radius_m
    return np.column_stack([radius_m * np.sin(angle), radius_m * (1 - np.cos(angle))])


def test_polynomials_below_the_penalised_order_pass_unchanged():
    t = np.linspace(-1.0, 1.0, 200)
    assert whittaker(1 + t - 3 * t**2, 60.0, order=3) == pytest.approx(1 + t - 3 * t**2, abs=1e-8)


def test_an_undulation_at_the_cutoff_is_halved():
    t = np.arange(4000.0)
    wave = np.sin(2 * np.pi * t / 50.0)
    assert np.abs(whittaker(wave, 50.0, order=3)[1000:3000]).max() == pytest.approx(0.5, abs=0.01)
    assert np.abs(whittaker(wave, 200.0, order=3)[1000:3000]).max() < 0.001
    assert np.abs(whittaker(wave, 10.0, order=3)[1000:3000]).max() > 0.99


def test_a_circle_keeps_its_radius_and_length():
    curve = even_curve(circle(200.0, 500.0, 1.0), 1.0)
    assert curve.length_m == 500.0
    assert curve.curvature[5:-5] == pytest.approx(1 / 200.0, rel=1e-4)
    assert np.hypot(curve.x, curve.y - 200.0) == pytest.approx(200.0, abs=1e-4)


def test_stations_are_evenly_spaced_after_smoothing_a_kink():
    kinked = np.array([[0.0, 0.0], [150.0, 0.0], [290.0, 40.0]])
    curve = smooth_curve(kinked, 40.0)
    chord = np.hypot(np.diff(curve.x), np.diff(curve.y))
    arc = np.cumsum(chord / np.sinc(np.diff(curve.heading) / (2 * np.pi)))
    assert arc == pytest.approx(np.arange(1.0, len(curve.x)), abs=1e-4)
    assert np.abs(np.diff(curve.curvature)).max() < 0.002


def test_headings_go_on_past_half_a_turn():
    curve = even_curve(circle(100.0, 600.0, 1.0), 1.0)
    assert curve.heading[-1] == pytest.approx(curve.length_m / 100.0, abs=1e-3)


def test_a_line_that_is_too_short_is_refused():
    with pytest.raises(NetworkError, match="at least 4 m"):
        smooth_curve(np.array([[0.0, 0.0], [2.0, 0.0]]), 40.0)
