"""Figures in tags that stand for nothing: zeros in all photographs of a camera that moved, or in a few of them, and
heights that are the same in all.

A camera without a sensor of its attitude, or without a barometer, writes zeros where it has nothing to write; a program
that fills in a height writes one figure. An aircraft may hold its height, so that figure alone proves nothing.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray
from photogram.files.photographs.tags import PhotographTags

FEWEST = 3
"""Photographs of a camera from which zeros in all of them are none of its measurements."""

FLOWN_M = 1.0
"""Range of heights above the place of take-off that contradicts one height of all positions."""

WIDEST = 3.0
"""Diagonal of what a photograph shows of the ground over the height that it is taken from, of the widest lens."""

SITES_M = 1000.0
"""Distance of neighbours from which they are of different sites, whatever their height."""

EARTH_M = 6_371_000.0

FAR_FROM_ZERO_M = 20.0
"""Height above or below 0 of all others, from which one of exactly 0 is none."""

Tags = Sequence[PhotographTags | None]


def _alike(
    tags: Tags, figures: Callable[[PhotographTags], tuple[float | None, ...]]
) -> Iterator[tuple[list[int], tuple[float, ...]]]:
    """Yield the photographs of each camera that has FEWEST with such figures, and the figures where they are the same
    in all of them."""
    of_camera = defaultdict[tuple[str | None, str | None], dict[int, tuple[float, ...]]](dict)
    for i, own in enumerate(tags):
        if own is not None:
            known = tuple(figure for figure in figures(own) if figure is not None)
            if known and len(known) == len(figures(own)):
                of_camera[own.make, own.model][i] = known
    for members in of_camera.values():
        if len(members) >= FEWEST and len(set(members.values())) == 1:
            yield list(members), next(iter(members.values()))


def _marked(tags: Tags, members: Iterable[list[int]]) -> BoolArray:
    marked = np.zeros(len(tags), dtype=bool)
    for own in members:
        marked[own] = True
    return marked


def zero_attitudes(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have an attitude of 0, 0, 0 as all of their camera have."""
    alike = _alike(tags, lambda own: (own.gimbal_yaw_deg, own.gimbal_pitch_deg, own.gimbal_roll_deg))
    return _marked(tags, (members for members, figures in alike if not any(figures)))


def is_no_height(tags: Tags, members: Sequence[int], height_m: float) -> bool:
    """Return whether one height of several photographs is none that was measured: 0, or another while their heights
    above the place of take-off say that the camera rose and sank."""
    flown_m = [t.height_above_take_off_m for i in members if (t := tags[i]) is not None]
    known_m = [h for h in flown_m if h is not None]
    return height_m == 0.0 or (len(known_m) == len(members) and max(known_m) - min(known_m) > FLOWN_M)


def constant_heights(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have a position with the height that all of their camera have, and that nothing
    measured."""
    alike = _alike(tags, lambda own: (own.height_m if own.longitude_deg is not None else None,))
    return _marked(tags, (members for members, (height_m,) in alike if is_no_height(tags, members, height_m)))


def constant_flying_heights(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have the height above ground that all of their camera have, and from which no two
    neighbours would show the same ground."""

    def is_none(members: list[int], height_m: float) -> bool:
        place_deg = [(t.latitude_deg, t.longitude_deg) for i in members if (t := tags[i]) is not None]
        known_deg = np.array([p for p in place_deg if None not in p], dtype=np.float64).reshape(-1, 2)
        if len(np.unique(known_deg, axis=0)) < FEWEST:
            return False
        place_m = np.unique(np.radians(known_deg) * EARTH_M * [1.0, np.cos(np.radians(known_deg[0, 0]))], axis=0)
        apart_m = float(np.median(cKDTree(place_m).query(place_m, k=[2])[0]))
        return WIDEST * height_m < apart_m < SITES_M

    alike = _alike(tags, lambda own: (own.height_above_take_off_m,))
    return _marked(tags, (members for members, (height_m,) in alike if is_none(members, height_m)))


def stray_zero_heights(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have a position with a height of 0 while most of them lie far above or below."""
    height_m = np.array(
        [np.nan if t is None or t.height_m is None or t.longitude_deg is None else t.height_m for t in tags]
    )
    zero, other_m = height_m == 0.0, height_m[np.isfinite(height_m) & (height_m != 0.0)]
    if len(other_m) < max(FEWEST, int(zero.sum()) + 1) or np.min(np.abs(other_m)) < FAR_FROM_ZERO_M:
        return np.zeros(len(tags), dtype=bool)
    return np.asarray(zero)


def without_zero_attitudes(tags: Tags) -> list[PhotographTags | None]:
    """Return the tags without attitudes that were not measured."""
    zero = zero_attitudes(tags)
    return [
        replace(own, gimbal_yaw_deg=None, gimbal_pitch_deg=None, gimbal_roll_deg=None)
        if own is not None and placeholder
        else own
        for own, placeholder in zip(tags, zero.tolist(), strict=True)
    ]
