"""Smoothing of recorded positions before they are differentiated.

NGSIM positions come from image tracking; their second differences at 10 Hz swing by +-13 m/s^2, so raw
accelerations and turn rates are noise. Every coordinate is smoothed by the penalised least squares

    min_z  sum_k (x_k - z_k)^2 + penalty * sum_k (z_{k+3} - 3 z_{k+2} + 3 z_{k+1} - z_k)^2          (1)

whose third-difference penalty is the discrete quintic smoothing spline (the fixed-interval Kalman smoother of
a constant-acceleration model with white jerk). It has no phase lag and reproduces constant acceleration
exactly. The penalty is chosen by the frequency at which (1) halves the amplitude.
"""

import itertools

import numpy as np
from scipy.linalg import solveh_banded

DT_S = 0.1  # NGSIM records at 10 Hz

# 0.3 Hz gives accelerations an s.d. of 0.7 m/s^2 on I-80; tables reconstructed by others have 0.5 to 0.7 (0.6 Hz: 1.3).
LONGITUDINAL_CUTOFF_HZ = 0.3
# lane changes take 4 to 8 s; faster lateral motion in the recordings is tracking noise
LATERAL_CUTOFF_HZ = 0.2
MIN_LENGTH = 8  # samples; shorter pieces cannot be smoothed and are dropped


def penalty_for_cutoff(cutoff_hz: float, dt_s: float = DT_S) -> float:
    """The penalty of (1) that halves the amplitude of a sine of `cutoff_hz` sampled every `dt_s`."""
    return (2.0 * np.sin(np.pi * cutoff_hz * dt_s)) ** -6


def smooth(x: np.ndarray, cutoff_hz: float, dt_s: float = DT_S) -> np.ndarray:
    """Minimiser of (1) for a gap-free series x (n,), n >= MIN_LENGTH. Raises ValueError for shorter or NaN."""
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1 or len(x) < MIN_LENGTH:
        raise ValueError(f"smooth needs a series of at least {MIN_LENGTH} samples, got shape {x.shape}")
    if not np.isfinite(x).all():
        raise ValueError("smooth needs a gap-free series; split the track at its gaps first")
    n = len(x)
    penalty = penalty_for_cutoff(cutoff_hz, dt_s)
    stencil = np.array([-1.0, 3.0, -3.0, 1.0])
    bands = np.zeros((4, n))  # upper form of solveh_banded: bands[3 - j, i + j] = A[i, i + j]
    bands[3] = 1.0
    for p in range(4):
        for q in range(p, 4):
            bands[3 - (q - p), q : q + n - 3] += penalty * stencil[p] * stencil[q]
    return solveh_banded(bands, x)


def derivative(z: np.ndarray, dt_s: float = DT_S) -> np.ndarray:
    """Central differences of a smoothed series, second order at the ends too."""
    return np.gradient(z, dt_s, edge_order=2)


def split_at_gaps(frames: np.ndarray) -> list[slice]:
    """Slices of maximal runs of consecutive frame numbers in a sorted array."""
    cuts = np.flatnonzero(np.diff(frames) != 1) + 1
    edges = np.concatenate([[0], cuts, [len(frames)]])
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
