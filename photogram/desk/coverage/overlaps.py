"""Straight strips of a flight, and by how much neighbouring photographs and strips overlap on level ground."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from photogram.arrays import BoolArray, FloatArray, IntArray

STRAIGHT, PARALLEL = float(np.cos(np.radians(30.0))), float(np.cos(np.radians(15.0)))
"""Cosines of the angles by which steps of one strip, and neighbouring strips, differ at most."""

SAME_STATION_M = 0.2
"""Photographs that lie closer in plan to each other have no base."""

AROUND = 2
"""Photographs before and behind one from which its direction of flight is taken."""

FARTHEST = 2.0
"""Strips farther apart than this many widths of a photograph are no neighbours."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """Overlaps as shares, 0 where neighbours leave a gap: ``forward`` (P,) of ``pair`` (P, 2) photographs that follow
    each other, ``side`` (S,) of ``across`` (S, 2) photographs beside each other; ``strips`` counts the strips."""

    forward: FloatArray
    pair: IntArray
    side: FloatArray
    across: IntArray
    strips: int


def _steps(place_m: FloatArray, flight: Sequence[str]) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the unit steps (F − 1, 2) in plan from a photograph to the next, their lengths, and which of them lie in a
    strip: another step before or behind goes the same way."""
    step = np.diff(place_m[:, :2], axis=0)
    length_m = np.hypot(*step.T)
    same = np.array([a == b for a, b in pairwise(flight)], dtype=bool) & (length_m > 0.0)
    unit = np.where(same[:, None], step / np.where(length_m > 0.0, length_m, 1.0)[:, None], np.nan)
    goes_on = np.einsum("ij,ij->i", unit[:-1], unit[1:]) > STRAIGHT
    return unit, length_m, np.concatenate([[False], goes_on]) | np.concatenate([goes_on, [False]])


def strips_of(place_m: FloatArray, flight: Sequence[str]) -> IntArray:
    """Return the number (F,) of the strip that each photograph lies in, −1 for none, by ``place_m`` (F, 2 or 3) in the
    order of exposure and ``flight`` (F,), names of flights."""
    strip = np.full(len(place_m), -1, dtype=np.int64)
    if len(place_m) < 3:
        return strip
    unit, _, within = _steps(place_m, flight)
    goes_on = np.concatenate([[False], np.einsum("ij,ij->i", unit[:-1], unit[1:]) > STRAIGHT])
    number = np.cumsum(within & ~goes_on) - 1
    own = np.flatnonzero(within)
    strip[own + 1] = number[own]
    strip[own] = number[own]
    return strip


def stations_of(place_m: FloatArray, flight: Sequence[str]) -> IntArray:
    """Return the number (F,) of the station of each photograph: cameras on one body, and a drone that hovers, stay
    within SAME_STATION_M of the first photograph of theirs. ``place_m`` (F, 2 or 3) in the order of exposure."""
    number, last = np.zeros(len(place_m), dtype=np.int64), 0
    for i in range(1, len(place_m)):
        stays = flight[i] == flight[last] and np.hypot(*(place_m[i, :2] - place_m[last, :2])) < SAME_STATION_M
        number[i] = number[i - 1] + (not stays)
        last = last if stays else i
    return number


def track_directions(place_m: FloatArray, flight: Sequence[str]) -> FloatArray:
    """Return the direction (F, 2) in plan of the strip around each photograph, else of its step to the next; NaN where
    it has none. ``place_m`` (F, 2 or 3) in the order of exposure, ``flight`` (F,) names of flights."""
    station = stations_of(place_m, flight)
    first = np.unique(station, return_index=True)[1]
    return _directions(place_m[first], [flight[i] for i in first.tolist()])[station]


def _directions(place_m: FloatArray, flight: Sequence[str]) -> FloatArray:
    direction = np.full((len(place_m), 2), np.nan)
    if len(place_m) < 2:
        return direction
    unit, strip = _steps(place_m, flight)[0], strips_of(place_m, flight)
    for offset in (1, 0):
        own = np.flatnonzero(np.isfinite(unit).all(axis=1))
        direction[own + offset] = unit[own]
    for i in np.flatnonzero(strip >= 0).tolist():
        around = np.arange(max(i - AROUND, 0), min(i + AROUND + 1, len(strip)))
        own = around[strip[around] == strip[i]]
        whole = place_m[own[-1], :2] - place_m[own[0], :2]
        direction[i] = whole / np.linalg.norm(whole)
    return direction


def _chord_m(sides_m: FloatArray, unit: FloatArray) -> FloatArray:
    """Return how far the ground of photographs (F,), parallelograms of ``sides_m`` (F, 2, 2), reaches through its
    middle along directions (F, 2)."""
    share = np.linalg.solve(np.swapaxes(sides_m, 1, 2), unit[..., None])[..., 0]
    return np.asarray(1.0 / np.abs(share).max(axis=1))


def overlaps(place_m: FloatArray, flight: Sequence[str], sides_m: FloatArray) -> Overlaps:
    """Return the overlaps of photographs at ``place_m`` (F, 2 or 3), in the order of exposure, of ``flight`` (F,);
    ``sides_m`` (F, 2, 2) are the vectors of their ground from left to right and from bottom to top, NaN where there is
    none. Of photographs of one station the first that has ground counts."""
    known = np.flatnonzero(np.isfinite(sides_m).all(axis=(1, 2)))
    chosen = known[np.unique(stations_of(place_m, flight)[known], return_index=True)[1]]
    found = _of_stations(place_m[chosen], [flight[i] for i in chosen.tolist()], sides_m[chosen])
    return replace(found, pair=chosen[found.pair], across=chosen[found.across])


def _of_stations(place_m: FloatArray, flight: Sequence[str], sides_m: FloatArray) -> Overlaps:
    strip, direction = strips_of(place_m, flight), _directions(place_m, flight)
    usable = (strip >= 0) & np.isfinite(direction).all(axis=1)
    along, across = np.full((2, len(place_m)), np.nan)
    along[usable] = _chord_m(sides_m[usable], direction[usable])
    across[usable] = _chord_m(sides_m[usable], direction[usable] @ np.array([[0.0, -1.0], [1.0, 0.0]]))
    first = np.flatnonzero(usable[:-1] & usable[1:] & (strip[:-1] == strip[1:]))
    base_m = np.linalg.norm(place_m[first + 1, :2] - place_m[first, :2], axis=1)
    forward = np.maximum(1.0 - 2.0 * base_m / (along[first] + along[first + 1]), 0.0)
    beside = [_beside(i, place_m, strip, direction, along[i], across[i]) for i in np.flatnonzero(usable).tolist()]
    found = [one for pairs in beside for one in pairs]
    pairs = np.array([(i, j) for i, j, _ in found], dtype=np.int64).reshape(-1, 2)
    side = np.array([share for *_, share in found], dtype=np.float64)
    return Overlaps(forward, np.column_stack([first, first + 1]), side, pairs, len(np.unique(strip[usable])))


def _beside(
    i: int, place_m: FloatArray, strip: IntArray, direction: FloatArray, along_m: float, across_m: float
) -> list[tuple[int, int, float]]:
    """Return the next photograph on each side of photograph ``i`` in another, parallel strip, with the overlap."""
    offset, ahead = place_m[:, :2] - place_m[i, :2], direction[i]
    beside_m = offset @ np.array([ahead[1], -ahead[0]])
    parallel = (strip >= 0) & (strip != strip[i]) & (np.abs(direction @ ahead) > PARALLEL)
    level = parallel & (np.abs(offset @ ahead) < along_m / 2)
    pairs = []
    for sign in (-1.0, 1.0):
        there = np.flatnonzero(level & (sign * beside_m > 0.05 * across_m) & (sign * beside_m < FARTHEST * across_m))
        if len(there):
            j = int(there[np.argmin(sign * beside_m[there])])
            pairs.append((i, j, max(1.0 - abs(float(beside_m[j])) / across_m, 0.0)))
    return pairs
