"""Speeds across the lane: what a fit finds in data made by its own law."""

from __future__ import annotations

import numpy as np
import pytest

from policies.data import lateral_fit as L


def made(n: int, seed: int = 1) -> L.LateralSample:
    """Rows by the law: share 0.15, narrow 0.07, wide 0.3, gain 1.5, power 0.6."""
    rng = np.random.default_rng(seed)
    speed, offset = rng.uniform(1.0, 15.0, n), rng.normal(0.0, 0.4, n)
    y = rng.standard_normal(n) * np.where(rng.random(n) < 0.15, 0.3, 0.07)
    rows = L.LateralSample(np.zeros(n), speed, offset, rng.integers(200, size=n))
    across = y * L.scale(np.array([0.0, 0.0, 0.0, 1.5, 0.6]), rows)
    return L.LateralSample(across, speed, offset, rows.vehicle)


def test_a_fit_finds_the_law_again():
    found = L.fit(made(8000), resamples=20)
    wanted = {"share": 0.15, "narrow": 0.07, "wide": 0.3, "offset_gain": 1.5, "speed_power": 0.6}
    for key, value in wanted.items():
        assert found.values[key] == pytest.approx(value, rel=0.15)
        low, high = found.intervals[key]
        assert low < found.values[key] < high
    assert found.ks < 0.015
    for _, _, _, rows, recorded, fitted in found.bands:
        if rows > 500:
            assert fitted == pytest.approx(recorded, rel=0.12)


def test_the_lines_are_a_scenario_s():
    text = L.lateral_toml(L.fit(made(2000), resamples=2))
    assert 'distribution = "normal-mixture"' in text
    assert "lateral_offset_gain = " in text
