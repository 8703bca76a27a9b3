"""What is known of a camera's interior orientation before the adjustment."""

from __future__ import annotations

import gtsam
import numpy as np

from photogram.arrays import FloatArray
from photogram.factors.variables import CALIBRATION, key


def calibration_prior(camera: int, expected: FloatArray, sigmas: FloatArray) -> gtsam.NonlinearFactor | None:
    """Return the prior on a camera's free parameters, in the units of the calibration variable; None when all are
    unbounded.

    ``expected`` and ``sigmas`` (free,); an infinite sigma says nothing about its parameter.
    """
    known = np.flatnonzero(np.isfinite(sigmas))
    if not len(known):
        return None
    selection = np.zeros((len(known), len(sigmas)))
    selection[np.arange(len(known)), known] = 1.0

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        if jacobians is not None:
            jacobians[0] = selection
        return np.asarray(values.atVector(factor.keys()[0])[known] - expected[known])

    return gtsam.CustomFactor(gtsam.noiseModel.Diagonal.Sigmas(sigmas[known]), [key(CALIBRATION, camera)], error)
