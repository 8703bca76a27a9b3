"""East, north and up at an origin, to and from longitude, latitude and ellipsoidal height of WGS 84.

The inverse is Bowring's, refined until it stands still (Bowring 1976, eq. 2–4); good to a nanometre at any height of a
survey.
"""

from __future__ import annotations

import numpy as np

from photogram.arrays import FloatArray

_A = 6_378_137.0
_F = 1 / 298.257223563
_E2 = _F * (2 - _F)


def _geocentric(longitude: FloatArray, latitude: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return geocentric coordinates (N, 3), m, of angles in radians."""
    N = _A / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
    level = (N + height_m) * np.cos(latitude)
    up = (N * (1 - _E2) + height_m) * np.sin(latitude)
    return np.column_stack([level * np.cos(longitude), level * np.sin(longitude), up])


def _axes(origin_lla: tuple[float, float, float]) -> tuple[FloatArray, FloatArray]:
    """Return the origin (3,), geocentric, and the axes east, north and up (3, 3) as columns."""
    latitude, longitude = np.deg2rad(origin_lla[:2])
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    axes = np.array([[-sl, -s * cl, c * cl], [cl, -s * sl, c * sl], [0.0, c, s]])
    place = _geocentric(np.array([longitude]), np.array([latitude]), np.array([origin_lla[2]]))[0]
    return place, axes


def topocentric_from_geodetic(origin_lla: tuple[float, float, float], lon_lat_height: FloatArray) -> FloatArray:
    """Return east, north, up (N, 3), m, of longitude and latitude, degrees, and height, m (N, 3).

    ``origin_lla`` is latitude, longitude, height of the origin.
    """
    origin, axes = _axes(origin_lla)
    lon, lat, height = lon_lat_height.T
    return np.asarray((_geocentric(np.deg2rad(lon), np.deg2rad(lat), height) - origin) @ axes)


def geodetic_from_topocentric(origin_lla: tuple[float, float, float], enu_m: FloatArray) -> FloatArray:
    """Return longitude and latitude, degrees, and height, m (N, 3), of east, north, up (N, 3), m."""
    origin, axes = _axes(origin_lla)
    x, y, z = (enu_m @ axes.T + origin).T
    level = np.hypot(x, y)
    latitude = np.arctan2(z, level * (1 - _E2))
    for _ in range(6):
        N = _A / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + _E2 * N * np.sin(latitude), level)
    N = _A / np.sqrt(1 - _E2 * np.sin(latitude) ** 2)
    height = level * np.cos(latitude) + z * np.sin(latitude) - N * (1 - _E2 * np.sin(latitude) ** 2)
    return np.column_stack([np.rad2deg(np.arctan2(y, x)), np.rad2deg(latitude), height])
