"""The fit of the drivers' noise: its correlation time, and amplitudes that bring the movement asked for back."""

from __future__ import annotations

import math

import pytest

from service.studies.human import noise_fit as F
from service.world.scenario.load import load_scenario
from service.world.scenario.schema import NoiseProcess


@pytest.mark.parametrize("time", [0.3, 0.62, 1.5])
def test_a_correlation_time_is_found_again(time):
    t = F.LAG_S / time
    assert F.correlation_time((1.0 + t) * math.exp(-t)) == pytest.approx(time, rel=1e-6)


def test_amplitudes_bring_the_movement_back(monkeypatch):
    monkeypatch.setattr(F, "DRIVE_S", 8.0)
    scenario = load_scenario("i80-data")
    truth = NoiseProcess(
        acceleration_amplitude=0.6, acceleration_correlation_s=0.62, turn_rate_amplitude=0.2,
        turn_rate_correlation_s=0.7,
    )  # fmt: skip
    target = F.driven(F.with_noise(scenario, truth), 8)
    noise, found = F.fitted(scenario, target, 8)
    assert found.lateral_mps == pytest.approx(target.lateral_mps, rel=0.1)
    assert found.jerk_mps3 == pytest.approx(target.jerk_mps3, rel=0.1)
    assert 0.3 < noise.acceleration_amplitude < 1.0
