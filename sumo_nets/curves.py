"""Smooth plane curves from noisy or kinked polylines.

One idea: a polyline is resampled evenly, then replaced by the curve that minimises

    sum |p_i - q_i|^2 + lam * sum |third difference of p|^2          (Whittaker smoothing)

with `lam` chosen so that undulations of wavelength `cutoff_m` are halved: shorter ones vanish, longer ones
stay. Arcs and straights are left where they are, kinks are rounded, curvature becomes continuous.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded
from scipy.spatial import cKDTree

from sumo_nets.errors import NetworkError

FINE_M = 0.05  # step of the numerical arc length; its error over 2 km is far below 1 mm
SAME_POINT_M = 1e-3  # consecutive points nearer than this are one point


def drop_repeats(xy: np.ndarray) -> np.ndarray:
    """The polyline (n, 2) without points that repeat their predecessor."""
    step = np.hypot(*np.diff(xy, axis=0).T)
    return xy[np.r_[True, step > SAME_POINT_M]]


def arc_length(xy: np.ndarray) -> np.ndarray:
    """Length along the polyline (n, 2) up to each point, in m: (n,)."""
    return np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T))]


def resample(xy: np.ndarray, step_m: float) -> np.ndarray:
    """Points about every `step_m` along the polyline, both ends kept."""
    xy = drop_repeats(xy)
    along = arc_length(xy)
    at = np.linspace(0.0, along[-1], max(2, round(along[-1] / step_m) + 1))
    return np.column_stack([np.interp(at, along, xy[:, 0]), np.interp(at, along, xy[:, 1])])


def whittaker(values: np.ndarray, cutoff: float, order: int) -> np.ndarray:
    """Smooth evenly spaced `values` (n,) or (n, c); `cutoff` is the half-power wavelength in samples.

    `order` is that of the penalised difference: polynomials of lower degree pass unchanged.
    """
    n = len(values)
    if n <= order + 1:
        return np.array(values, dtype=float)
    lam = (cutoff / (2.0 * np.pi)) ** (2 * order)
    stencil = np.array([(-1) ** (order - j) * comb(order, j) for j in range(order + 1)], dtype=float)
    banded = np.zeros((order + 1, n))  # upper form: banded[order - d, j] is the element (j - d, j)
    banded[order] = 1.0
    for d in range(order + 1):
        for a in range(order + 1 - d):
            banded[order - d, a + d : n - order + a + d] += lam * stencil[a] * stencil[a + d]
    return solveh_banded(banded, values)


@dataclass(frozen=True)
class Curve:
    """A smooth curve sampled at exactly even arc length; heading is continuous (not wrapped), in radians."""

    step_m: float
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    curvature: np.ndarray

    @property
    def length_m(self) -> float:
        """Arc length from the first to the last sample."""
        return (len(self.x) - 1) * self.step_m

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(np.column_stack([self.x, self.y]))

    def to_xy(self, station: ArrayLike, offset: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Point and heading at arc length `station` and lateral `offset` (m, left positive).

        The curve is a circular arc about the nearest sample, which is exact to micrometres at 1 m spacing;
        before the start and past the end the first and last arcs go on.
        """
        station, offset = np.broadcast_arrays(np.asarray(station, float), np.asarray(offset, float))
        k = np.clip(np.rint(station / self.step_m).astype(np.int64), 0, len(self.x) - 1)
        along = station - k * self.step_m
        turn = self.curvature[k] * along
        chord = along * np.sinc(turn / (2.0 * np.pi))
        heading = self.heading[k] + turn
        x = self.x[k] + chord * np.cos(self.heading[k] + turn / 2.0) - offset * np.sin(heading)
        y = self.y[k] + chord * np.sin(self.heading[k] + turn / 2.0) + offset * np.cos(heading)
        return x, y, heading

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Arc length and lateral offset (m, left positive) of the nearest point of the curve to each (x, y).

        Points beyond an end get a station below 0 or above the length.
        """
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        _, nearest = self._tree.query(np.column_stack([x.ravel(), y.ravel()]))
        station = nearest.reshape(x.shape) * self.step_m
        for _ in range(4):
            across, along, curvature = self._local(x, y, station)
            station = station + along / np.maximum(1.0 - curvature * across, 0.1)
        across, _, _ = self._local(x, y, station)
        return station, across

    def _local(
        self, x: np.ndarray, y: np.ndarray, station: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Offsets (m) of points across and along the curve at their stations, and its curvature there (1/m)."""
        cx, cy, heading = self.to_xy(station, 0.0)
        c, s = np.cos(heading), np.sin(heading)
        k = np.clip(np.rint(station / self.step_m).astype(np.int64), 0, len(self.x) - 1)
        dx, dy = x - cx, y - cy
        return c * dy - s * dx, c * dx + s * dy, self.curvature[k]

    def shifted(self, offset_m: float | np.ndarray) -> np.ndarray:
        """The points (n, 2) at lateral `offset_m` of the samples."""
        return np.column_stack(
            [self.x - offset_m * np.sin(self.heading), self.y + offset_m * np.cos(self.heading)]
        )


def even_curve(xy: np.ndarray, step_m: float, length_m: float | None = None) -> Curve:
    """The curve through smooth, closely spaced points `xy`, sampled every `step_m` of arc length.

    It starts at the first point and ends at the last whole step before the last point (or at `length_m`).
    """
    xy = drop_repeats(xy)
    parameter = arc_length(xy)
    spline = CubicSpline(parameter, xy, axis=0)
    fine = np.linspace(0.0, parameter[-1], max(2, int(np.ceil(parameter[-1] / FINE_M)) + 1))
    speed = np.hypot(*spline(fine, 1).T)
    arc = np.r_[0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))]
    end = arc[-1] if length_m is None else length_m
    if end > arc[-1] + 1e-6:
        raise NetworkError(f"a curve of {end:.1f} m was asked for, the points reach {arc[-1]:.1f} m")
    count = int(np.floor(end / step_m + 1e-9))
    if count < 1:
        raise NetworkError(f"the line is {arc[-1]:.2f} m long, shorter than one step of {step_m:g} m")
    at = np.interp(np.arange(count + 1) * step_m, arc, fine)
    p, d1, d2 = spline(at), spline(at, 1), spline(at, 2)
    heading = np.unwrap(np.arctan2(d1[:, 1], d1[:, 0]))
    curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.hypot(d1[:, 0], d1[:, 1]) ** 3
    arrays = (np.ascontiguousarray(a) for a in (p[:, 0], p[:, 1], heading, curvature))
    return Curve(step_m, *arrays)


def smooth_curve(xy: np.ndarray, cutoff_m: float, step_m: float = 1.0) -> Curve:
    """The smooth curve along a polyline: undulations shorter than `cutoff_m` are taken out."""
    even = resample(np.asarray(xy, float), 1.0)
    if len(even) < 5:
        raise NetworkError(f"the line is {arc_length(even)[-1]:.2f} m long; at least 4 m are needed")
    smooth = whittaker(even, cutoff_m, order=3)
    return even_curve(smooth, step_m)
