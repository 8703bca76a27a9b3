"""How well a block is placed as a whole, and how well its points are known relative to each other.

The datum, which control points and GNSS give, shifts all points together; what is left of their uncertainty is the
shape of the block. Where GNSS alone places a survey the two differ by two orders of magnitude, and a surveyor asks for
each.
"""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.quality.deformation import GROUND, SLOPES
from photogram.results import Deformation

WHOLE_BLOCK = "The block as a whole may be"
DATUM_TIMES = 2.0
"""Times the precision of intersection, beyond which an uncertain datum is worth a word."""


@dataclass(frozen=True)
class DatumPrecision:
    """Datum and shape of a block, 1 sigma in m."""

    absolute_plan_m: float
    """A point in plan."""
    absolute_height_m: float
    """A point in height."""
    relative_plan_m: float
    """A point relative to the block, in plan."""
    relative_height_m: float
    """A point relative to the block, in height."""
    shift_plan_m: float
    """Common shift in plan."""
    shift_height_m: float
    """Common shift in height."""
    tilt_m: float
    """Tilt over ``radius_m``."""
    radius_m: float
    """Radius of the block."""


def _plan_and_height(variance_m2: FloatArray) -> tuple[float, float]:
    return float(np.sqrt(variance_m2[0] + variance_m2[1])), float(np.sqrt(variance_m2[2]))


def datum_precision(known: Deformation) -> DatumPrecision | None:
    """Return how well a block is placed, the datum's part by itself; None where nothing is known."""
    if not known.known:
        return None
    variance, own = np.diag(known.covariance), known.intersection_sigma_m**2
    absolute, relative = known.absolute_sigma_m**2 + own, known.relative_sigma_m**2 + own
    of, at, by = (_plan_and_height(v) for v in (absolute, relative, variance[GROUND]))
    return DatumPrecision(*of, *at, *by, float(np.sqrt(variance[SLOPES].max())), known.radius_m)


def datum_sentence(known: Deformation) -> str | None:
    """Return what the datum adds to the uncertainty of every point, said once; None where it adds little."""
    precision, precise = datum_precision(known), known.intersection_sigma_m
    if precision is None:
        return None
    plan = float(np.hypot(precise[0], precise[1]))
    parts = [
        f"{figure_m:.3f} m {where}"
        for figure_m, limit_m, where in (
            (precision.shift_plan_m, plan, "in plan"),
            (precision.shift_height_m, float(precise[2]), "in height"),
        )
        if figure_m > DATUM_TIMES * limit_m
    ]
    moved = [f"shifted by {' and '.join(parts)}"] if parts else []
    if precision.tilt_m > DATUM_TIMES * precise[2]:
        moved.append(f"tilted by {precision.tilt_m:.3f} m over {precision.radius_m:.0f} m from its centre")
    if not moved:
        return None
    return (
        f"{WHOLE_BLOCK} {' and '.join(moved)} (1 sigma) without any measurement showing it; relative to each other its "
        f"points are known to {precision.relative_plan_m:.3f} m in plan and {precision.relative_height_m:.3f} m in "
        "height"
    )
