"""The driver network's forward pass as compiled code, with the same bits on every processor.

Each unit's sum runs over the inputs in index order; inputs that are zero (rectified units, mostly) are left out. The
inner loop is over units, so the compiler uses vector instructions without changing the order of any sum, and takes four
inputs at a time, so that the sums are loaded and stored four times less often.
"""

import numpy as np

from policies.exactmath import exp
from policies.jit import kernel
from policies.layout import HIDDEN_1, HIDDEN_2, LOG_STD_MAX, LOG_STD_MIN, OBSERVATION_SIZE, OUTPUTS

ZERO = np.float32(0.0)


@kernel
def _add_products(
    inputs: np.ndarray, used: np.ndarray, count: int, weights: np.ndarray, sums: np.ndarray
) -> None:
    """Add inputs[i] * weights[i] to `sums` (units,) for i in used[:count], in that order."""
    units = sums.shape[0]
    whole = count - count % 4
    for k in range(0, whole, 4):
        i, i1, i2, i3 = used[k], used[k + 1], used[k + 2], used[k + 3]
        v, v1, v2, v3 = inputs[i], inputs[i1], inputs[i2], inputs[i3]
        w, w1, w2, w3 = weights[i], weights[i1], weights[i2], weights[i3]
        for j in range(units):
            sums[j] = (((sums[j] + v * w[j]) + v1 * w1[j]) + v2 * w2[j]) + v3 * w3[j]
    for k in range(whole, count):
        v = inputs[used[k]]
        w = weights[used[k]]
        for j in range(units):
            sums[j] += v * w[j]


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

    w1: (51, 200), b1: (200,), w2: (200, 100), b2: (100,), head: (404,), all float32

    The head holds its weights (100, 4) row by row, then its bias (4,).
    """
    inputs = np.empty(OBSERVATION_SIZE, np.float32)
    used = np.empty(HIDDEN_1, np.intp)
    count = 0
    for i in range(OBSERVATION_SIZE):
        inputs[i] = observation[i]
        if inputs[i] != ZERO:
            used[count] = i
            count += 1
    hidden_1 = np.empty(HIDDEN_1, np.float32)
    for j in range(HIDDEN_1):
        hidden_1[j] = b1[j]
    _add_products(inputs, used, count, w1, hidden_1)
    count = 0
    for j in range(HIDDEN_1):
        if hidden_1[j] > ZERO:
            used[count] = j
            count += 1
    hidden_2 = np.empty(HIDDEN_2, np.float32)
    for j in range(HIDDEN_2):
        hidden_2[j] = b2[j]
    _add_products(hidden_1, used, count, w2, hidden_2)
    for o in range(OUTPUTS):
        outputs[o] = head[HIDDEN_2 * OUTPUTS + o]
    for i in range(HIDDEN_2):
        if hidden_2[i] > ZERO:
            for o in range(OUTPUTS):
                outputs[o] += hidden_2[i] * head[i * OUTPUTS + o]


@kernel
def sample_action(
    outputs: np.ndarray, action_scale: np.ndarray, acceleration_noise: float, turn_rate_noise: float
) -> tuple[float, float]:
    """Acceleration (m/s^2) and turn rate (rad/s) from a network's outputs and two standard normals."""
    spread_a = exp(min(max(np.float64(outputs[2]), LOG_STD_MIN), LOG_STD_MAX))
    spread_w = exp(min(max(np.float64(outputs[3]), LOG_STD_MIN), LOG_STD_MAX))
    return (
        action_scale[0] * (np.float64(outputs[0]) + spread_a * acceleration_noise),
        action_scale[1] * (np.float64(outputs[1]) + spread_w * turn_rate_noise),
    )
