"""GNSS heights that are one figure for a whole flight while the camera rose and sank.

Programs write the height at which a flight was planned, or that of the site, where a height was to be measured. No
receiver gives the same height again and again, but a barometer that holds an aircraft at its height may: so one figure
alone proves nothing, and the block has to have its photographs farther above and below each other than such heights may
be wrong by. They are withdrawn then, of the whole flight, and alone: positions in plan are measurements all the same.
"""

from collections.abc import Iterator

import numpy as np

from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.amendments.gross_errors.hypothesis import Hypothesis, unmeasured
from photogram.amendments.repeated_positions import MOST_NAMED, MOVED
from photogram.arrays import IntArray
from photogram.gnss import UNKNOWN_M
from photogram.survey import Block
from photogram.wording import some, things

FEWEST = 6
"""Photographs of a flight, from which heights of one figure are looked at."""

ALIKE_M = 0.01
"""Between the highest and the lowest of heights that are the same figure: a geoid bends them by millimetres."""


def constant_heights(block: Block) -> tuple[list[Hypothesis], list[Blunder]]:
    """Return the GNSS heights of oriented photographs that the figures of a flight have in common and its poses do not,
    and one sentence on each flight."""
    withdrawn, blunders = list[Hypothesis](), list[Blunder]()
    for members, height_m, range_m in _constant(block):
        names = [block.photographs[i].name for i in members.tolist()]
        sentence = (
            f"GNSS heights of {things(len(names), 'photograph')} ({some(names, MOST_NAMED)}): all are {height_m:.2f} "
            f"m, and the photographs lie up to {range_m:.1f} m above each other; nothing measured these heights, and "
            "the positions count in plan alone"
        )
        withdrawn += [unmeasured("GNSS height", name) for name in names]
        blunders.append(Blunder("constant height", (), None, sentence))
    return withdrawn, blunders


def _constant(block: Block) -> Iterator[tuple[IntArray, float, float]]:
    """Yield the photographs of a flight whose heights are one figure that cannot be, the figure, and how far their
    poses lie above each other, m."""
    for flight in sorted({p.flight for p in block.photographs}):
        members, measured, posed, sigmas_m = list[int](), [], [], []
        for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
            gnss, sigma_m = photograph.gnss_world_m, photograph.gnss_sigma_m
            if photograph.flight == flight and pose is not None and gnss is not None and sigma_m is not None:
                members.append(i)
                measured.append(gnss)
                posed.append(pose.position_world_m)
                sigmas_m.append(float(sigma_m[2]))
        if len(members) < FEWEST or np.median(sigmas_m) >= UNKNOWN_M:
            continue
        height_m = block.frame.map_from_world(np.array(measured))[:, 2]
        flown_m = block.frame.map_from_world(np.array(posed))[:, 2]
        if np.ptp(height_m) < ALIKE_M and np.std(flown_m) > MOVED * float(np.median(sigmas_m)):
            yield np.array(members), float(np.median(height_m)), float(np.ptp(flown_m))
