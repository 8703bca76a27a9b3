"""Positions that lie far from where they should: would another way to read their figures put them there?

Tried are the neighbouring zones of the map grid, easting and northing exchanged, and longitude and latitude exchanged.
"""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import neighbouring_zones, plan_of
from photogram.geodesy.frames import geodetic_from_map, map_from_crs, map_from_geodetic

AMONG_M = 2000.0
"""Positions whose median is nearer than this to a survey's lie among its own."""


def _in_zone(zone: str, crs: str, points_map_m: FloatArray) -> FloatArray | None:
    try:
        return map_from_crs(zone, plan_of(crs), points_map_m)
    except FrameError:
        return None  # the figures mean no place in that zone, so they were not meant in it


def _degrees_exchanged(crs: str, points_map_m: FloatArray) -> FloatArray | None:
    geodetic = geodetic_from_map(crs, points_map_m)
    if not np.isfinite(geodetic).all() or np.abs(geodetic[:, 0]).max() > 90.0:
        return None
    try:
        return map_from_geodetic(crs, geodetic[:, [1, 0, 2]])
    except FrameError:
        return None  # the exchanged figures mean no place of this map


def _readings(crs: str, points_map_m: FloatArray) -> Iterator[tuple[str, str, FloatArray | None]]:
    """Yield every other way to read positions (N, 3) of the map: the condition in words, the remedy, and where they
    would lie."""
    for zone in neighbouring_zones(crs):
        yield f"in {zone}", f"give {zone} as their crs", _in_zone(zone, crs, points_map_m)
    yield "with easting and northing exchanged", "write easting before northing", points_map_m[:, [1, 0, 2]]
    exchanged = _degrees_exchanged(crs, points_map_m)
    yield "with longitude and latitude exchanged", "write longitude before latitude", exchanged


def zones_within(
    given_crs: str, crs: str, points_map_m: FloatArray, contains: Callable[[FloatArray], BoolArray]
) -> list[str]:
    """Return the zones beside the CRS ``given_crs`` of positions (N, 3) of the map ``crs`` in which the same figures
    lie where the map ``contains`` them (N, 2)."""
    try:
        figures = map_from_crs(crs, plan_of(given_crs), points_map_m)
        zones = [(zone, _in_zone(zone, crs, figures)) for zone in neighbouring_zones(given_crs)]
    except FrameError:
        return []  # of degrees, or of a place that this CRS does not have
    return [zone for zone, places in zones if places is not None and contains(places[:, :2]).all()]


def other_reading(crs: str, points_map_m: FloatArray, reference_map_m: FloatArray) -> tuple[str, str] | None:
    """Return how positions (N, 3) of the map would lie among others (M, 2 or more), and what to do; None where no other
    reading of their figures puts them there.

    Returned are words such as "in EPSG:25833", and the remedy. Raises FrameError where ``crs`` is no map grid.
    """
    if not len(points_map_m) or not len(reference_map_m):
        return None
    tree = cKDTree(reference_map_m[:, :2])
    best, nearest_m = None, AMONG_M
    for words, remedy, places in _readings(crs, points_map_m):
        if places is None or not np.isfinite(places).all():
            continue
        distance_m = float(np.median(tree.query(places[:, :2])[0]))
        if distance_m < nearest_m:
            best, nearest_m = (words, remedy), distance_m
    return best
