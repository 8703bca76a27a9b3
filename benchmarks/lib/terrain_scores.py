"""What a ground filter and the terrain made of it are worth, beside the truth: errors of type I and II, RMS, sigma."""

from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class TerrainScores:
    """Shares as Sithole and Vosselman (2004) define them: ground rejected of the ground, objects accepted of the
    objects, both of all; RMS of the terrain's heights, and of errors over their standard deviations in interpolated and
    in all cells, NaN without."""

    type_i: float
    type_ii: float
    total: float
    rms_m: float
    over_sigma: tuple[float, float] = (float("nan"), float("nan"))


def terrain_scores(
    accepted: BoolArray,
    ground: BoolArray,
    objects: BoolArray,
    error_m: FloatArray,
    sigma_m: FloatArray | None = None,
) -> TerrainScores:
    """Return the scores of cells (rows, columns) taken for ground, and of the errors of the terrain (NaN without)."""
    rejected, wrong = int((~accepted & ground).sum()), int((accepted & objects).sum())
    of_ground, of_objects = int(ground.sum()), int(objects.sum())
    over = (float("nan"), float("nan"))
    if sigma_m is not None:
        ratio = error_m / sigma_m
        over = rms(ratio[~accepted]), rms(ratio)
    return TerrainScores(
        rejected / max(of_ground, 1),
        wrong / of_objects if of_objects else float("nan"),
        (rejected + wrong) / max(of_ground + of_objects, 1),
        rms(error_m),
        over,
    )


def rms(values: FloatArray) -> float:
    """Return the root of the mean square of the finite values, NaN without one."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
