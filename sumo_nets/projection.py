"""Longitude and latitude (WGS84) to and from UTM zone 10 north, by Krueger's series (exact to 0.1 mm)."""

from __future__ import annotations

import numpy as np

SEMI_MAJOR_M = 6378137.0  # WGS84
FLATTENING = 1.0 / 298.257223563  # WGS84
SCALE = 0.9996  # UTM
FALSE_EASTING_M = 500_000.0  # UTM
CENTRAL_MERIDIAN_DEG = -123.0  # zone 10
PROJ = "+proj=utm +zone=10 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"

_N = FLATTENING / (2.0 - FLATTENING)
_RADIUS_M = SEMI_MAJOR_M / (1.0 + _N) * (1.0 + _N**2 / 4.0 + _N**4 / 64.0)
_ALPHA = (_N / 2 - 2 * _N**2 / 3 + 5 * _N**3 / 16, 13 * _N**2 / 48 - 3 * _N**3 / 5, 61 * _N**3 / 240)
_BETA = (_N / 2 - 2 * _N**2 / 3 + 37 * _N**3 / 96, _N**2 / 48 + _N**3 / 15, 17 * _N**3 / 480)
_ECCENTRICITY = 2.0 * np.sqrt(_N) / (1.0 + _N)


def to_utm(lon_deg: np.ndarray, lat_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Easting and northing in m of points given in degrees."""
    lat, lon = np.radians(lat_deg), np.radians(np.asarray(lon_deg) - CENTRAL_MERIDIAN_DEG)
    t = np.sinh(np.arctanh(np.sin(lat)) - _ECCENTRICITY * np.arctanh(_ECCENTRICITY * np.sin(lat)))
    xi, eta = np.arctan2(t, np.cos(lon)), np.arctanh(np.sin(lon) / np.sqrt(1.0 + t * t))
    east, north = eta, xi
    for j, a in enumerate(_ALPHA, start=1):
        east = east + a * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        north = north + a * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
    return FALSE_EASTING_M + SCALE * _RADIUS_M * east, SCALE * _RADIUS_M * north


def from_utm(east_m: np.ndarray, north_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Longitude and latitude in degrees of points given in m."""
    xi0 = np.asarray(north_m) / (SCALE * _RADIUS_M)
    eta0 = (np.asarray(east_m) - FALSE_EASTING_M) / (SCALE * _RADIUS_M)
    xi, eta = xi0, eta0
    for j, b in enumerate(_BETA, start=1):
        xi = xi - b * np.sin(2 * j * xi0) * np.cosh(2 * j * eta0)
        eta = eta - b * np.cos(2 * j * xi0) * np.sinh(2 * j * eta0)
    conformal = np.arcsin(np.sin(xi) / np.cosh(eta))
    lat = conformal
    for _ in range(5):  # the conformal latitude is inverted by fixed point
        psi = np.arctanh(np.sin(conformal)) + _ECCENTRICITY * np.arctanh(_ECCENTRICITY * np.sin(lat))
        lat = np.arcsin(np.tanh(psi))
    lon = np.arctan2(np.sinh(eta), np.cos(xi))
    return CENTRAL_MERIDIAN_DEG + np.degrees(lon), np.degrees(lat)
