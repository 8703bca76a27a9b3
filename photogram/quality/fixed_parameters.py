"""Fixed camera parameters released in the covariance: would the data determine them, and what does fixing them hide?

A fixed parameter has no sigma, and the heights that depend on it look better than they are. Released within the
uncertainty of an ordinary calibration it either becomes known, or takes heights with it.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera
from photogram.factors.elimination.reduced import SingularError
from photogram.factors.elimination.state import State
from photogram.factors.functionals import factored
from photogram.factors.graph import IndeterminateError, Problem
from photogram.projection import CAMERA_PARAMETERS
from photogram.quality.deformation import Places, parameters_of, stiffness
from photogram.results import Deformation


def ordinary_sigmas(camera: Camera) -> FloatArray:
    """Return the sigmas (12,) with which a camera's fixed parameters are released, 0 for the others and for terms that
    it does without."""
    ordinary = np.array([p.in_its_unit(p.ordinary, camera.focal_px, camera.width_px) for p in CAMERA_PARAMETERS])
    return np.where((camera.sigmas == 0) & (camera.parameters != 0), ordinary, 0.0)


def with_fixed_released(known: Deformation, problem: Problem, state: State, places: Places) -> Deformation:
    """Return the deformation with the sigmas of fixed parameters once released; unchanged where none is fixed,
    or nothing fixes them."""
    cameras = problem.block.cameras
    freed = np.array([ordinary_sigmas(camera) for camera in cameras])
    if not freed.any():
        return known
    loose = tuple(replace(c, sigmas=np.where(s > 0, s, c.sigmas)) for c, s in zip(cameras, freed, strict=True))
    released = replace(problem, block=replace(problem.block, cameras=loose))
    try:
        stiff = stiffness(released, state, factored(released, state), places)
    except (IndeterminateError, SingularError):
        return known
    count = len(cameras)
    variance = [np.diag(stiff.modes[parameters_of(c, count), parameters_of(c, count)]) for c in range(count)]
    return replace(
        known,
        freed_prior=freed,
        freed_sigma=np.where(freed > 0, np.sqrt(np.array(variance)), 0.0),
        freed_height_sigma_m=stiff.summary,
    )
