"""A stand-in for the highway job: 24 Beta(2, 2) start values of six vehicles, 404 driver weights that hardly matter,
and an event of four modes (the left or the right neighbour; the ego slower or faster than it).

The event: the vehicle beside the ego comes alongside (|gap| small at the time it is reached) and drifts towards it.
No closed form is known; p is from 3e8 naive samples in numpy (see `p_of`).
"""

import numpy as np

import ce

VEHICLES = 6
WEIGHTS = 404
LEFT, EGO, RIGHT = 1, 2, 3  # rows of the vehicles
THRESHOLD = 0.0


def base() -> ce.Product:
    """Position, offset, heading and speed of each vehicle in units of their ranges, then the weights."""
    return ce.Product(
        [
            *(ce.Beta(2.0, 2.0, -1.0, 1.0) for _ in range(4 * VEHICLES)),
            ce.Normal(np.zeros(WEIGHTS), np.eye(WEIGHTS)),
        ]
    )


def f(x: np.ndarray) -> np.ndarray:
    """The least over the two neighbours of a smooth measure of danger, (n,)."""
    starts = x[:, : 4 * VEHICLES].reshape(-1, VEHICLES, 4)
    weights = x[:, 4 * VEHICLES :].sum(axis=1) / np.sqrt(WEIGHTS)
    return danger(starts, weights)


def danger(starts: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """starts (n, 6, 4), weights (n,): f, low is dangerous."""
    out = []
    for other, side in ((LEFT, -1.0), (RIGHT, 1.0)):
        gap = starts[:, other, 0] - starts[:, EGO, 0]
        closing = starts[:, EGO, 3] - starts[:, other, 3]
        drift = side * (starts[:, other, 1] - starts[:, EGO, 1]) + 1.5 * side * (
            starts[:, other, 2] - starts[:, EGO, 2]
        )
        alongside = np.abs(gap - closing) - 0.3 * np.abs(closing)
        out.append(SAFE - drift + 1.5 * np.maximum(alongside, 0.0) - 0.5 * np.abs(closing) - 0.1 * weights)
    return np.minimum(*out)


SAFE = 3.9
P = 9.949e-5  # standard error 5.8e-7


def p_of(samples: int, seed: int = 0) -> tuple[float, float]:
    """p and its standard error from naive samples; only what f needs is drawn (the weights enter by their sum)."""
    source = np.random.default_rng(seed)
    events, chunk = 0, 200_000
    for _ in range(samples // chunk):
        starts = np.zeros((chunk, VEHICLES, 4))
        starts[:, LEFT : RIGHT + 1] = 2.0 * source.beta(2.0, 2.0, size=(chunk, 3, 4)) - 1.0
        events += int(np.count_nonzero(danger(starts, source.standard_normal(chunk)) <= THRESHOLD))
    p = events / (samples // chunk * chunk)
    return p, float(np.sqrt(p * (1 - p) / samples))
