"""Marks that were measured in pictures of another size: their rays meet once their pixels are scaled.

Whether the marks of a point meet depends on the photographs alone, as their tie points have oriented them, and on no
surveyed coordinate. Where few of them meet as they were measured, a factor on all pixels is looked for with which most
do.
"""

from dataclasses import replace

import numpy as np

from photogram.measures.mark_covariances import isotropic_px2
from photogram.sfm.marked_points import intersected_marks
from photogram.survey import Block

MEETING = 0.8
"""Of the marks, from which they are taken as they are."""

SURE = 0.7
"""Of the marks, that must meet with another factor."""

FEWEST_MARKS = 6

FACTORS = np.geomspace(0.19, 5.3, 340)
"""One per cent apart: what is not exact at the edge of a picture of 5000 px is 25 px, and the limit widens with it."""

_LIMIT_PX = 0.004
"""Of the width of a picture, that marks may miss each other by while the factor is not known exactly."""


def _scaled(block: Block, factor: float) -> Block:
    points = block.control_points
    # sizes count from the outer corner of a picture, pixels from the middle of the first one
    return replace(block, control_points=replace(points, mark_pixel=(points.mark_pixel + 0.5) * factor - 0.5))


def _share(block: Block, factor: float, wider_px: float) -> float:
    scaled = _scaled(block, factor)
    points = scaled.control_points
    wider = isotropic_px2(points.mark_sigma_px + wider_px / 4.0)
    loose = replace(scaled, control_points=replace(points, mark_covariance_px2=wider))
    usable = np.isfinite(points.mark_sigma_px)
    count = np.bincount(points.mark_point[usable], minlength=len(points))
    # two rays nearly always meet somewhere
    tested = usable & (count[points.mark_point] >= 3)
    agreed = intersected_marks(loose)[1]
    return float(agreed[tested].mean()) if tested.sum() >= FEWEST_MARKS else 1.0


def other_size(factor: float) -> str:
    """Return what there is to say of marks that ``factor`` on their pixels makes meet."""
    return (
        f"the marks contradict each other, but intersect with their pixels multiplied by {factor:.3g}: they "
        "were measured "
        f"in pictures {1.0 / factor:.3g} times as large; give the size of those pictures"
    )


def picture_factor(block: Block) -> float | None:
    """Return the factor on the pixels of all marks of an oriented block with which their rays meet; None where they
    meet as they are, are too few to say, or no factor makes most of them meet."""
    if not len(block.control_points.mark_point):
        return None
    width_px = max(camera.width_px for camera in block.cameras)
    before = _share(block, 1.0, 0.0)
    if before >= MEETING:
        return None
    shares = np.array([_share(block, factor, _LIMIT_PX * width_px) for factor in FACTORS.tolist()])
    best = FACTORS[shares >= shares.max() - 1e-9]
    factor = float(np.exp(np.mean(np.log(best))))
    if shares.max() < SURE or shares.max() < before + 0.3 or abs(factor - 1.0) < 0.02:
        return None
    return factor
