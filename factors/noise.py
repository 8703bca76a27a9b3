"""Noise of surveyed and satellite positions: sigmas are stated along easting, northing and height of the map."""

from __future__ import annotations

import gtsam
import numpy as np

from photogram.arrays import FloatArray


def along_axes(sigma_m: FloatArray, axes: FloatArray | None) -> gtsam.noiseModel.Base:
    """Return the noise of a position with sigmas (3,) in m along the columns of ``axes`` (3, 3), a rotation.

    Without ``axes`` the sigmas lie along the axes of the world itself. An infinite sigma leaves its axis open.
    """
    if axes is None or np.array_equal(axes, np.eye(3)):
        return gtsam.noiseModel.Diagonal.Sigmas(sigma_m)
    return gtsam.noiseModel.Gaussian.SqrtInformation(axes.T / sigma_m[:, None])
