"""Figures in tags that stand for nothing: zeros in all photographs of a camera that moved, or in a few of them.

A camera without a sensor of its attitude, or without a barometer, writes zeros where it has nothing to write.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from photogram.arrays import BoolArray
from photogram.files.photographs.tags import PhotographTags

FEWEST = 3
"""Photographs of a camera from which zeros in all of them are none of its measurements."""

FAR_FROM_ZERO_M = 20.0
"""Height above or below 0 of all others, from which one of exactly 0 is none."""

Tags = Sequence[PhotographTags | None]


def _zero_in_all(tags: Tags, figures: Callable[[PhotographTags], tuple[float | None, ...]]) -> BoolArray:
    """Return of which photographs (F,) the figures are exactly zero, as they are in all of their camera's."""
    of_camera = defaultdict[tuple[str | None, str | None], list[int]](list)
    for i, own in enumerate(tags):
        if own is not None and all(figure is not None for figure in figures(own)):
            of_camera[own.make, own.model].append(i)
    zero = np.zeros(len(tags), dtype=bool)
    for members in of_camera.values():
        values = [figures(own) for i in members if (own := tags[i]) is not None]
        zero[members] = len(members) >= FEWEST and not np.any(np.array(values, dtype=np.float64))
    return zero


def zero_attitudes(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have an attitude of 0, 0, 0 as all of their camera have."""
    return _zero_in_all(tags, lambda own: (own.gimbal_yaw_deg, own.gimbal_pitch_deg, own.gimbal_roll_deg))


def zero_heights(tags: Tags) -> BoolArray:
    """Return which photographs (F,) have a position with a height of 0 as all of their camera have."""
    return _zero_in_all(tags, lambda own: (own.height_m if own.longitude_deg is not None else None,))


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
