"""From standard normals and named causes to what drivers do: their noise along time, and when they look away.

A rollout's randomness beside the starts and xi is one latent vector: the causes (`service.world.scenario.causes`), and
standard normals (steps, vehicles, 4). `Latent.realise` makes of it the table that `step.advance_human` reads. Whether
the normals come from the rollout's seed, from one seed for all, or from an estimator that moves them, is all the same
here.

Noise. Each action's noise has unit variance and correlation (1 + t / T) exp(-t / T) (the critically damped second-order
process: Matern's with smoothness 3/2), whose derivative exists: jerk stays finite, unlike an Ornstein-Uhlenbeck
process's. At equal steps it is the autoregression v[k] = 2 r v[k-1] - r^2 v[k-2] + s e[k], r = exp(-dt / T), started in
equilibrium; in it the correlation after k steps is r^k (1 + k (1 - r^2) / (1 + r^2)). Its lowest Karhunen-Loeve modes
phi_m over the window, with variances lambda_m, are coordinates: the path's own part along them is replaced,

    v += sum_m phi_m (sqrt(lambda_m) c_m - phi_m . v),    c_m ~ N(0, 1) independent,

which leaves its distribution as it was, as phi_m . v is independent of the rest. After the window the recursion goes on
from the path so made.

Glances. While the eyes are on the road the third channel's normal z starts a glance with probability h = dt / every_s:
where its upper tail u is below h; then u / h is uniform and gives the duration. Until the long glance that the causes
name has ended no other long one begins. The fourth channel says whether the glance leaks: where its lower tail is below
epsilon.
"""

import math
from typing import Any

import numpy as np

from policies.exactmath import exp, normal_quantile, normal_tail
from policies.jit import kernel
from service.world.scenario.causes import (
    GLANCE_DURATION_S,
    GLANCE_LEAK,
    GLANCE_ONSET_S,
    MODES,
)
from service.world.scenario.schema import Scenario

# channels of the standard normals, and columns of the table made of them
# of the table: noise, noise, seconds of a glance that begins, 1 = leaks
ACCELERATION, TURN_RATE, GLANCE, LEAK = range(4)
CHANNELS = 4
NOBODY = -1  # in place of the ego's row
POWER_STEPS = 400  # of the iteration for the modes
CERTAIN = 1.0 - 1e-12
SAME_MODE = 1e-9  # a mode this near to what its cause says is left as it is


@kernel
def _correlation(r: float, lag: int) -> float:
    power = 1.0
    for _ in range(lag):
        power *= r
    return power * (1.0 + lag * (1.0 - r * r) / (1.0 + r * r))


@kernel
def _lowest_modes(r: float, steps: int, modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvectors (steps, modes), the largest first, and roots of the eigenvalues (modes,) of the noise's covariance.

    By the power iteration with Gram-Schmidt, from the cosines that they nearly are: the same bits on every processor,
    which a library's solver does not give.
    """
    row = np.empty(steps)
    for lag in range(steps):
        row[lag] = _correlation(r, lag)
    vectors = np.empty((steps, modes))
    roots = np.empty(modes)
    product = np.empty(steps)
    for m in range(modes):
        vector = np.empty(steps)
        for k in range(steps):  # polynomials in time: each with the right number of changes of sign
            t = 2.0 * (k + 0.5) / steps - 1.0
            before, value = 1.0, t
            if m == 0:
                value = 1.0
            for _ in range(1, m):
                before, value = value, 2.0 * t * value - before
            vector[k] = value
        size = 0.0
        for _ in range(POWER_STEPS):
            for k in range(steps):
                total = 0.0
                for j in range(steps):
                    total += row[abs(k - j)] * vector[j]
                product[k] = total
            for n in range(m):
                along = 0.0
                for k in range(steps):
                    along += product[k] * vectors[k, n]
                for k in range(steps):
                    product[k] -= along * vectors[k, n]
            size = 0.0
            for k in range(steps):
                size += product[k] * product[k]
            size = math.sqrt(size)
            for k in range(steps):
                vector[k] = product[k] / size
        sign = 1.0 if vector[0] >= 0.0 else -1.0
        for k in range(steps):
            vectors[k, m] = sign * vector[k]
        roots[m] = math.sqrt(size)
    return vectors, roots


@kernel
def recursion(r: float) -> tuple[float, float, float, float, float]:
    """The constants of `next_noise` for a decay r = exp(-dt / T) a step."""
    a1, a2 = 2.0 * r, -r * r
    first = a1 / (1.0 - a2)
    spread = math.sqrt(1.0 - first * a1 - (first * a1 + a2) * a2)
    return a1, a2, spread, first, math.sqrt(1.0 - first * first)


@kernel
def next_noise(
    k: int, e: float, last: float, before: float, constants: tuple[float, float, float, float, float]
) -> float:
    """The noise of step k, of unit variance, from a standard normal and the values of the two steps before."""
    a1, a2, spread, first, begun = constants
    if k == 0:
        return e
    if k == 1:
        return first * last + begun * e
    return a1 * last + a2 * before + spread * e


@kernel
def glance_of(
    z: float, begins_s: float, long_from_s: float, hazard: float, median_s: float, sigma: float, long_s: float
) -> float:
    """Seconds of the glance that z starts at `begins_s`, 0: none; no long one begins before `long_from_s`."""
    share = normal_tail(z) / hazard
    if share < 1.0:
        seconds = median_s * exp(-sigma * normal_quantile(min(max(share, 1e-300), CERTAIN)))
        if seconds < long_s or begins_s >= long_from_s:
            return seconds
    return 0.0


@kernel
def _realise(
    normals: np.ndarray, causes: np.ndarray, ego: int, modes: np.ndarray, roots: np.ndarray, decays: np.ndarray,
    amplitudes: np.ndarray, dt_s: float, hazard: float, median_s: float, sigma: float, long_s: float, leak_below: float,
    leak_share: float, table: np.ndarray,
) -> None:  # fmt: skip
    """Fill `table` (steps, vehicles, 4).

    modes: (2, window, m), roots: (2, m)
    leak_below: a normal below it leaks
    """
    steps, vehicles = normals.shape[0], normals.shape[1]
    window, count = min(modes.shape[1], steps), modes.shape[2]
    for i in range(vehicles):
        if i == ego:
            for k in range(steps):
                for c in range(CHANNELS):
                    table[k, i, c] = 0.0
            continue
        for c in range(2):
            constants = recursion(decays[c])
            for k in range(steps):
                last = table[k - 1, i, c] if k > 0 else 0.0
                before = table[k - 2, i, c] if k > 1 else 0.0
                table[k, i, c] = next_noise(k, normals[k, i, c], last, before, constants)
                if k == window - 1:
                    for m in range(count):
                        along = 0.0
                        for q in range(window):
                            along += modes[c, q, m] * table[q, i, c]
                        along = roots[c, m] * causes[i, MODES + c * count + m] - along
                        if abs(along) > SAME_MODE:  # else the path is as the cause says, and stays to the bit
                            for q in range(window):
                                table[q, i, c] += along * modes[c, q, m]
            for k in range(steps):
                table[k, i, c] *= amplitudes[c]
        onset, duration = causes[i, GLANCE_ONSET_S], causes[i, GLANCE_DURATION_S]
        for k in range(steps):
            table[k, i, LEAK] = 1.0 if normals[k, i, LEAK] < leak_below else 0.0
            table[k, i, GLANCE] = glance_of(
                normals[k, i, GLANCE], k * dt_s, onset + duration, hazard, median_s, sigma, long_s
            )
        at = onset / dt_s
        if at < steps:
            table[int(at), i, GLANCE] = duration
            table[int(at), i, LEAK] = 1.0 if causes[i, GLANCE_LEAK] < leak_share else 0.0


@kernel
def _modes_in(
    normals: np.ndarray, ego: int, modes: np.ndarray, roots: np.ndarray, decays: np.ndarray, found: np.ndarray
) -> None:  # fmt: skip
    """Fill `found` (vehicles, 2, m) with what the causes have to be for `_realise` to leave the noise as it is."""
    window, count = modes.shape[1], modes.shape[2]
    path = np.empty(window)
    for i in range(normals.shape[1]):
        for c in range(2):
            constants = recursion(decays[c])
            for k in range(window):
                last = path[k - 1] if k > 0 else 0.0
                before = path[k - 2] if k > 1 else 0.0
                path[k] = next_noise(k, normals[k, i, c], last, before, constants)
            for m in range(count):
                along = 0.0
                for q in range(window):
                    along += modes[c, q, m] * path[q]
                found[i, c, m] = 0.0 if i == ego else along / roots[c, m]


class Latent:
    """Realises the latent vectors of one scenario that has a human table."""

    def __init__(self, scenario: Scenario) -> None:
        human = scenario.human
        assert human is not None
        noise, glances, dt_s = human.noise, human.glances, scenario.time.step_s
        times = noise.acceleration_correlation_s, noise.turn_rate_correlation_s
        window = min(round(noise.window_s / dt_s), scenario.steps)
        decays = [float(exp(-dt_s / time)) for time in times]
        found = [_lowest_modes(r, window, noise.modes) for r in decays]
        self._ego = scenario.ego
        self._dt_s = dt_s
        self._fixed = (
            np.ascontiguousarray(np.stack([vectors for vectors, _ in found])),
            np.ascontiguousarray(np.stack([roots for _, roots in found])),
            np.array(decays),
            np.array([noise.acceleration_amplitude, noise.turn_rate_amplitude]),
            dt_s,
            dt_s / glances.every_s,
            glances.median_s,
            glances.sigma,
            glances.long_s,
            _leak_below(glances.epsilon),
            glances.epsilon if glances.epsilon < 1.0 else 2.0,
        )
        self._table = np.zeros((scenario.steps, len(scenario.vehicles), CHANNELS))

    @property
    def fixed(self) -> tuple[Any, ...]:
        """What the kernels read: modes, roots, decays, amplitudes, step, glances' hazard, median, sigma and `long_s`,
        and below which normal, and below which share, one leaks."""
        return self._fixed

    @property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """The modes (2, window, m) of acceleration and turn rate, and the roots of their variances (2, m)."""
        return self._fixed[0], self._fixed[1]

    def modes_in(self, normals: np.ndarray) -> np.ndarray:
        """The modes' coordinates (vehicles, 2, m) that the noise of these normals (steps, vehicles, 4) has by itself:
        with them as causes `realise` leaves it as it is, to the bit."""
        modes, roots, decays = self._fixed[:3]
        found = np.empty((normals.shape[1], 2, modes.shape[2]))
        _modes_in(normals, self._ego, modes, roots, decays, found)
        return found

    def realise(self, normals: np.ndarray, causes: np.ndarray) -> np.ndarray:
        """The table (steps, vehicles, 4) of standard normals of that shape and causes (vehicles, columns).

        It is overwritten by the next call.
        """
        _realise(normals, causes, self._ego, *self._fixed, self._table)
        return self._table

    def realise_all(self, normals: np.ndarray, causes: np.ndarray) -> np.ndarray:
        """As `realise`, a table of its own for any number of vehicles, all of them drivers."""
        table = np.zeros(normals.shape)
        _realise(normals, causes, NOBODY, *self._fixed, table)
        return table


def _leak_below(epsilon: float) -> float:
    if epsilon <= 0.0:
        return -math.inf
    return math.inf if epsilon >= 1.0 else float(normal_quantile(epsilon))
