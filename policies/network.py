"""The driver network's forward pass as compiled code, with the same bits on every processor.

Each unit's sum runs over the inputs in index order; inputs that are zero (rectified units, mostly) are left out.
Vectors run across units, so no sum changes its order (`policies.vectors`). Several vehicles go through a block of
weights one after the other, while it lies in the processor's nearest cache.
"""

import numpy as np

from policies.exactmath import exp
from policies.jit import kernel
from policies.layout import HIDDEN_1, HIDDEN_2, LOG_STD_MAX, LOG_STD_MIN, OBSERVATION_SIZE, OUTPUTS
from policies.vectors import add_rows

ZERO = np.float32(0.0)


@kernel
def _read(observation: np.ndarray, inputs: np.ndarray, used: np.ndarray) -> int:
    """Fill `inputs` (51,) float32 and `used` with the indices of those that are not zero; how many there are."""
    count = 0
    for i in range(OBSERVATION_SIZE):
        inputs[i] = observation[i]
        used[count] = i
        count += int(inputs[i] != ZERO)  # no branch: which are zero is not to be foreseen
    return count


@kernel
def _positive(values: np.ndarray, size: int, used: np.ndarray) -> int:
    """Fill `used` (size + 1,) with the indices of positive `values` (size,); how many there are."""
    count = 0
    for j in range(size):
        used[count] = j
        count += int(values[j] > ZERO)
    return count


@kernel
def forward_all(
    observations: np.ndarray,
    rows: np.ndarray,
    n: int,
    w1: np.ndarray,
    b1: np.ndarray,
    w2: np.ndarray,
    b2: np.ndarray,
    head: np.ndarray,
    outputs: np.ndarray,
) -> None:
    """Fill rows[:n] of `outputs` (vehicles, 4) float32 from those of `observations` (vehicles, 51) float64.

    w1: (51, 200), b1: (200,), w2: (200, 100), b2: (100,), head: (404,), all float32

    The head holds its weights (100, 4) row by row, then its bias (4,).
    """
    inputs = np.empty((n, OBSERVATION_SIZE), np.float32)
    hidden_1 = np.empty((n, HIDDEN_1), np.float32)
    hidden_2 = np.empty((n, HIDDEN_2), np.float32)
    used = np.empty((n, HIDDEN_1 + 1), np.int32)
    counts = np.empty(n, np.intp)
    for v in range(n):
        counts[v] = _read(observations[rows[v]], inputs[v], used[v])
        for j in range(HIDDEN_1):
            hidden_1[v, j] = b1[j]
        for j in range(HIDDEN_2):
            hidden_2[v, j] = b2[j]
    for v in range(n):
        add_rows(inputs[v], used[v], counts[v], w1, 200, 0, 64, hidden_1[v])
    for v in range(n):
        add_rows(inputs[v], used[v], counts[v], w1, 200, 64, 64, hidden_1[v])
    for v in range(n):
        add_rows(inputs[v], used[v], counts[v], w1, 200, 128, 72, hidden_1[v])
    for v in range(n):
        counts[v] = _positive(hidden_1[v], HIDDEN_1, used[v])
    for v in range(n):
        add_rows(hidden_1[v], used[v], counts[v], w2, 100, 0, 64, hidden_2[v])
    for v in range(n):
        add_rows(hidden_1[v], used[v], counts[v], w2, 100, 64, 36, hidden_2[v])
    for v in range(n):
        count = _positive(hidden_2[v], HIDDEN_2, used[v])
        for o in range(OUTPUTS):
            outputs[rows[v], o] = head[HIDDEN_2 * OUTPUTS + o]
        add_rows(hidden_2[v], used[v], count, head, OUTPUTS, 0, 4, outputs[rows[v]])


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
    """Fill `outputs` (4,) float32 from `observation` (51,) float64: `forward_all` for one vehicle."""
    rows = np.zeros(1, np.intp)
    forward_all(
        observation.reshape(1, OBSERVATION_SIZE), rows, 1, w1, b1, w2, b2, head, outputs.reshape(1, OUTPUTS)
    )


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
