"""The driver network's forward pass as compiled code, with the same bits on every processor.

Sums run over the inputs in index order for each unit; the inner loop is over units, so that the compiler can use
vector instructions without changing the order of any sum.
"""

import numpy as np

from policies.exactmath import exp
from policies.jit import kernel
from policies.layout import HIDDEN_1, HIDDEN_2, LOG_STD_MAX, LOG_STD_MIN, OBSERVATION_SIZE, OUTPUTS


@kernel
def _layer(inputs: np.ndarray, weights: np.ndarray, bias: np.ndarray, out: np.ndarray) -> None:
    units = out.shape[0]
    for j in range(units):
        out[j] = bias[j]
    for i in range(inputs.shape[0]):
        value = inputs[i]
        if value != 0.0:
            row = weights[i]
            for j in range(units):
                out[j] += value * row[j]


@kernel
def _rectify(values: np.ndarray) -> None:
    for j in range(values.shape[0]):
        values[j] = max(values[j], np.float32(0.0))


@kernel
def forward(
    observation: np.ndarray,
    w1: np.ndarray,
    b1: np.ndarray,
    w2: np.ndarray,
    b2: np.ndarray,
    head: np.ndarray,
    outputs: np.ndarray,
) -> None:
    """Fill `outputs` (4,) float32 from `observation` (51,) float64.

    w1: (51, 200), b1: (200,), w2: (200, 100), b2: (100,), head: (404,), all float32. The head holds its weights
    (100, 4) row by row, then its bias (4,).
    """
    inputs = np.empty(OBSERVATION_SIZE, np.float32)
    for i in range(OBSERVATION_SIZE):
        inputs[i] = observation[i]
    hidden_1 = np.empty(HIDDEN_1, np.float32)
    _layer(inputs, w1, b1, hidden_1)
    _rectify(hidden_1)
    hidden_2 = np.empty(HIDDEN_2, np.float32)
    _layer(hidden_1, w2, b2, hidden_2)
    _rectify(hidden_2)
    for o in range(OUTPUTS):
        outputs[o] = head[HIDDEN_2 * OUTPUTS + o]
    for i in range(HIDDEN_2):
        for o in range(OUTPUTS):
            outputs[o] += hidden_2[i] * head[i * OUTPUTS + o]


@kernel
def sample_action(
    outputs: np.ndarray, action_scale: np.ndarray, noise_acceleration: float, noise_turn_rate: float
) -> tuple[float, float]:
    """Acceleration (m/s^2) and turn rate (rad/s) from a network's outputs and two standard normals."""
    spread_a = exp(min(max(np.float64(outputs[2]), LOG_STD_MIN), LOG_STD_MAX))
    spread_w = exp(min(max(np.float64(outputs[3]), LOG_STD_MIN), LOG_STD_MAX))
    return (
        action_scale[0] * (np.float64(outputs[0]) + spread_a * noise_acceleration),
        action_scale[1] * (np.float64(outputs[1]) + spread_w * noise_turn_rate),
    )
