"""The compiled driver network against plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from policies import layout
from policies.network import forward, forward_all, sample_action
from policies.vectors import pieces

SHAPES = {
    "w1": (layout.OBSERVATION_SIZE, layout.HIDDEN_1),
    "b1": (layout.HIDDEN_1,),
    "w2": (layout.HIDDEN_1, layout.HIDDEN_2),
    "b2": (layout.HIDDEN_2,),
    "head": (layout.HEAD_SIZE,),
}


def random_network(seed: int) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    return {
        key: (generator.normal(size=shape) / math.sqrt(shape[0])).astype(np.float32)
        for key, shape in SHAPES.items()
    }


def random_observation(seed: int) -> np.ndarray:
    observation = np.random.default_rng(seed).normal(size=layout.OBSERVATION_SIZE) * 3.0
    observation[layout.LANE_TO_THE_LEFT : layout.RANGE_M] = 0.0
    return observation


def compiled(observation: np.ndarray, net: dict[str, np.ndarray]) -> np.ndarray:
    outputs = np.full(layout.OUTPUTS, np.nan, np.float32)
    forward(observation, net["w1"], net["b1"], net["w2"], net["b2"], net["head"], outputs)
    return outputs


def plain(observation: np.ndarray, net: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (4,) and second hidden layer (100,), in float64 with matrix products."""
    wide = {key: value.astype(np.float64) for key, value in net.items()}
    hidden_1 = np.maximum(observation @ wide["w1"] + wide["b1"], 0.0)
    hidden_2 = np.maximum(hidden_1 @ wide["w2"] + wide["b2"], 0.0)
    matrix = wide["head"][:400].reshape(100, 4)
    return hidden_2 @ matrix + wide["head"][400:], hidden_2


@pytest.mark.parametrize("seed", range(20))
def test_outputs_agree_with_a_float64_network(seed):
    net, observation = random_network(seed), random_observation(100 + seed)
    assert compiled(observation, net) == pytest.approx(plain(observation, net)[0], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_sums_run_in_the_order_of_the_inputs_to_the_bit(seed):
    net, observation = random_network(seed), random_observation(100 + seed)
    values = observation.astype(np.float32)
    for weights, bias in (("w1", "b1"), ("w2", "b2")):
        total = net[bias].copy()
        for value, row in zip(values, net[weights], strict=True):
            total = total + value * row
        values = np.maximum(total, np.float32(0.0))
    total = net["head"][400:].copy()
    for value, row in zip(values, net["head"][:400].reshape(100, 4), strict=True):
        total = total + value * row
    assert total.dtype == np.float32
    assert np.array_equal(compiled(observation, net), total)


def test_several_vehicles_at_once_have_the_bits_of_each_alone_and_the_others_are_left():
    net = random_network(7)
    observations = np.stack([random_observation(seed) for seed in range(8, 14)])
    outputs = np.full((6, layout.OUTPUTS), -1.0, np.float32)
    forward_all(observations, np.array([5, 1, 2]), 3, *(net[key] for key in SHAPES), outputs)
    for vehicle in (1, 2, 5):
        assert np.array_equal(outputs[vehicle], compiled(observations[vehicle], net))
    assert np.all(outputs[[0, 3, 4]] == -1.0)


def test_a_block_of_units_is_covered_by_vectors_or_refused():
    assert pieces(72) == [(0, 16), (16, 16), (32, 16), (48, 16), (64, 8)]
    with pytest.raises(ValueError, match="multiple of 4"):
        pieces(50)


@pytest.mark.parametrize("output", range(4))
def test_the_last_four_weights_of_the_head_are_its_bias(output):
    net = random_network(1) | {"head": np.zeros(layout.HEAD_SIZE, np.float32)}
    net["head"][400 + output] = 0.75
    expected = np.zeros(4, np.float32)
    expected[output] = 0.75
    assert np.array_equal(compiled(random_observation(2), net), expected)


def test_the_head_holds_a_row_of_four_for_each_hidden_unit():
    net, observation = random_network(3), random_observation(4)
    hidden = plain(observation, net)[1]
    for unit in np.flatnonzero(hidden > 0.1)[:10]:
        for output in range(4):
            net["head"] = np.zeros(layout.HEAD_SIZE, np.float32)
            net["head"][4 * unit + output] = 1.0
            answer = compiled(observation, net)
            assert answer[output] == pytest.approx(hidden[unit], rel=1e-5)
            assert np.count_nonzero(answer) == 1


def test_units_below_zero_pass_nothing_on():
    net = random_network(5)
    net["b2"] = np.full(layout.HIDDEN_2, -1e6, np.float32)
    assert np.array_equal(compiled(random_observation(6), net), net["head"][400:])


SCALE = np.array([1.5, 0.05])


def act(outputs: list[float], noise: tuple[float, float]) -> tuple[float, float]:
    return sample_action(np.array(outputs, np.float32), SCALE, *noise)


def test_an_action_without_noise_is_the_scaled_mean():
    assert act([2.0, -4.0, 0.3, -0.3], (0.0, 0.0)) == (3.0, -0.2)


def test_noise_is_scaled_by_the_exponential_of_the_log_standard_deviation():
    acceleration, turn_rate = act([0.0, 0.0, -1.0, -2.0], (2.0, -3.0))
    assert acceleration == pytest.approx(1.5 * math.exp(-1.0) * 2.0, rel=1e-14)
    assert turn_rate == pytest.approx(0.05 * math.exp(-2.0) * -3.0, rel=1e-14)


@pytest.mark.parametrize(
    ("log_std", "used"), [(9.0, 0.5), (0.51, 0.5), (-5.1, -5.0), (-1e30, -5.0), (1e30, 0.5)]
)
def test_the_log_standard_deviation_is_kept_within_its_limits(log_std, used):
    acceleration, turn_rate = act([0.0, 0.0, log_std, log_std], (1.0, 1.0))
    assert acceleration == pytest.approx(1.5 * math.exp(used), rel=1e-14)
    assert turn_rate == pytest.approx(0.05 * math.exp(used), rel=1e-14)
