"""Classes of the Brazilian PEC-PCD (cartographic accuracy of digital products; DSG, ET-ADGV 2011 and ET-CQDG 2016).

A product is of a class at a scale where 90 % of the discrepancies at check points are within its PEC, and their root
mean square within its EP (standard error). In plan both are millimetres at the scale, of the discrepancy's length; in
height parts of the contour interval that belongs to the scale.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray

PecClass = Literal["A", "B", "C", "D"]

NAME = "PEC-PCD, Padrão de Exatidão Cartográfica dos Produtos Cartográficos Digitais (DSG, ET-ADGV 2011, ET-CQDG 2016)"
PART_WITHIN = 0.9
LEAST_POINTS = 10
"""From which a tenth of the points is one of them, so that nine tenths can be told from all."""
CONTOUR_INTERVAL_M: Mapping[int, float] = MappingProxyType(
    {1000: 1, 2000: 1, 5000: 2, 10_000: 5, 25_000: 10, 50_000: 20, 100_000: 50, 250_000: 100}
)
"""By the denominator of the scale."""


@dataclass(frozen=True)
class Tolerances:
    """PEC and EP of a class: in plan mm at the scale, in height parts of the contour interval."""

    pec_plan_mm: float
    ep_plan_mm: float
    pec_height: float
    ep_height: float


CLASSES: Mapping[PecClass, Tolerances] = MappingProxyType(
    {
        "A": Tolerances(0.28, 0.17, 0.27, 1 / 6),
        "B": Tolerances(0.5, 0.3, 0.5, 1 / 3),
        "C": Tolerances(0.8, 0.5, 0.6, 0.4),
        "D": Tolerances(1.0, 0.6, 0.75, 0.5),
    }
)
"""From the strictest."""


def _first_held(discrepancy_m: FloatArray, limits: Mapping[PecClass, tuple[float, float]]) -> PecClass | None:
    rms_m = float(np.sqrt(np.mean(discrepancy_m**2)))
    for name, (pec_m, ep_m) in limits.items():
        if np.mean(np.abs(discrepancy_m) <= pec_m) >= PART_WITHIN and rms_m <= ep_m:
            return name
    return None


def plan_class(discrepancy_m: FloatArray, scale: int) -> PecClass | None:
    """Return the strictest class that discrepancies in plan (n,), lengths in m, hold at 1 : ``scale``; None where they
    hold none, or are too few."""
    if len(discrepancy_m) < LEAST_POINTS:
        return None
    m = 1e-3 * scale
    return _first_held(discrepancy_m, {n: (t.pec_plan_mm * m, t.ep_plan_mm * m) for n, t in CLASSES.items()})


def height_class(discrepancy_m: FloatArray, scale: int) -> PecClass | None:
    """Return the strictest class that discrepancies in height (n,), m, hold at the contour interval of 1 : ``scale``,
    one of `CONTOUR_INTERVAL_M`; None where they hold none, or are too few."""
    if len(discrepancy_m) < LEAST_POINTS:
        return None
    m = CONTOUR_INTERVAL_M[scale]
    return _first_held(discrepancy_m, {n: (t.pec_height * m, t.ep_height * m) for n, t in CLASSES.items()})
