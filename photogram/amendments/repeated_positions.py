"""Positions that a receiver has written once more while the camera moved on.

Some receivers answer slower than the camera exposes: the tags of the next photograph repeat the last position, to the
last digit. Two positions that agree to a millimetre where the block has their photographs metres apart are one
measurement, that of the first of them in time; one test by the figures themselves finds all of them, however many.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.survey import Block, Photograph
from photogram.wording import some, things

ALIKE_M = 1e-3
"""By which positions may differ that are the same figures."""

MOVED, MOVED_M = 3.0, 2.0
"""Stated standard deviations of a position, and metres, by which two photographs are apart that have not the same: some
tags write no more than five decimals of a degree."""

MOST_NAMED = 5


def repeated_positions(block: Block) -> tuple[list[Hypothesis], list[Blunder]]:
    """Return the GNSS positions of oriented photographs that repeat another's, and one sentence on them."""
    repeated = list(_repeated(block))
    if not repeated:
        return [], []
    names = [name for name, _ in repeated]
    apart_m = float(np.median([distance for _, distance in repeated]))
    sentence = (
        f"GNSS positions of {things(len(names), 'photograph')} ({some(names, MOST_NAMED)}): they repeat that of the "
        f"photograph before to the last digit, {apart_m:.1f} m away; the receiver was slower than the camera"
    )
    return [unmeasured("GNSS position", name) for name in names], [Blunder("repeated position", (), None, sentence)]


def _repeated(block: Block) -> Iterator[tuple[str, float]]:
    """Yield the photographs whose position repeats that of one before, and how far they are from it, m."""
    for flight in sorted({p.flight for p in block.photographs}):
        own = [i for i, p in enumerate(block.photographs) if p.flight == flight and p.gnss_world_m is not None]
        if all(block.photographs[i].time is not None for i in own):
            own.sort(key=lambda i: (str(block.photographs[i].time), i))
        first = own[0] if own else -1
        for before, i in pairwise(own):
            if not _same(block.photographs[before], block.photographs[i]):
                first = i
                continue
            here, there, sigma_m = block.poses[i], block.poses[first], block.photographs[i].gnss_sigma_m
            if here is None or there is None or sigma_m is None or _together(block, first, i):
                continue
            distance_m = float(np.linalg.norm(here.position_world_m - there.position_world_m))
            stated_m = 0.0 if block.photographs[i].gnss_sigma_assumed else float(np.linalg.norm(sigma_m))
            if distance_m > max(MOVED * stated_m, MOVED_M):
                yield block.photographs[i].name, distance_m


def _same(a: Photograph, b: Photograph) -> bool:
    if a.gnss_world_m is None or b.gnss_world_m is None:
        return False
    return bool(np.all(np.abs(a.gnss_world_m - b.gnss_world_m) < ALIKE_M))


def _together(block: Block, a: int, b: int) -> bool:
    """Return whether two photographs are of one exposure of several cameras."""
    one, other = block.photographs[a], block.photographs[b]
    return one.camera != other.camera or (one.capture is not None and one.capture == other.capture)
