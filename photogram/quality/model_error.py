"""What the camera model leaves out, counted in the sigmas of heights: mean, tilt and dome, common to all of the block.

A pattern that the residuals of all photographs share shows that the model is incomplete. What the block follows of such
an error is in no residual and no covariance, see photogram.quality.residual_patterns; here its covariance M (4, 4) is
added to those of heights at places (x, y): g(x, y)ᵀ M g(x', y'), g the four shapes of photogram.quality.deformation. As
the effect of a consider parameter (Tapley, Schutz & Born 2004, sec. 6.2) it changes no estimate.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.quality.deformation import DOME, GROUND, Places, height_shapes
from photogram.results import Adjustment, Deformation

_MODES = slice(GROUND.stop - 1, DOME + 1)


def with_pattern(known: Deformation, pattern_m2: FloatArray, ground_world_m: FloatArray, places: Places) -> Deformation:
    """Return the deformation whose heights count a model error of the covariance ``pattern_m2`` (4, 4) of mean, slopes
    and dome, m²; ``ground_world_m`` (P, 3) are the points of ``places``.

    As it is, but for ``pattern_sigma_m``, where the covariance is zero or not known.
    """
    with_sigma = replace(known, pattern_sigma_m=np.sqrt(np.diag(pattern_m2)[1:]))
    if not known.known or not np.any(pattern_m2 > 0.0):
        return with_sigma
    standing = ground_world_m[:, :2]

    def shapes(xy: FloatArray) -> FloatArray:
        return height_shapes(xy, places.centre_world_m, places.radius_m, standing)

    modes, ground, shape = (
        array.copy() for array in (known.covariance, known.ground_covariance_m2, known.shape_covariance_m2)
    )
    modes[_MODES, _MODES] += pattern_m2
    ground[2::3, 2::3] += _joint(shapes(known.ground_place_world_m[:, :2]), pattern_m2)
    relative_m2 = pattern_m2.copy()
    relative_m2[0], relative_m2[:, 0] = 0.0, 0.0
    shape[:, 2, 2] += _variance(shapes(known.place_world_m[:, :2]), relative_m2)
    looked_at = shapes(standing[places.looked_at])
    whole, without_mean = (float(np.mean(_variance(looked_at, m2))) for m2 in (pattern_m2, relative_m2))
    return replace(
        with_sigma,
        covariance=modes,
        ground_covariance_m2=ground,
        shape_covariance_m2=shape,
        height_sigma_m=np.sqrt(known.height_sigma_m**2 + _variance(looked_at, pattern_m2)),
        absolute_sigma_m=_added(known.absolute_sigma_m, whole),
        relative_sigma_m=_added(known.relative_sigma_m, without_mean),
        model_error_covariance_m2=pattern_m2,
    )


def _added(sigma_m: FloatArray, height_variance_m2: float) -> FloatArray:
    """Return sigmas (3,) with a variance more in height."""
    return np.asarray(np.sqrt(sigma_m**2 + [0.0, 0.0, height_variance_m2]))


def _joint(shapes: FloatArray, pattern_m2: FloatArray) -> FloatArray:
    return np.asarray(shapes @ pattern_m2 @ shapes.T)


def _variance(shapes: FloatArray, pattern_m2: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("pk,kl,pl->p", shapes, pattern_m2, shapes))


def _shapes(known: Deformation, points_world_m: FloatArray) -> FloatArray:
    return height_shapes(points_world_m[:, :2], known.centre_world_m, known.radius_m, known.place_world_m[:, :2])


def ground_model_error_m2(result: Adjustment) -> FloatArray:
    """Return what the model error of the ``deformation`` adds to the covariances (G, G) of the heights of ground
    points; NaN of points without a position, zero where there is no such error, and of a free network."""
    known, points = result.covariances.deformation, result.estimates.ground_world_m
    if result.block.is_free or not np.any(known.model_error_covariance_m2 > 0.0):
        return np.zeros((len(points), len(points)))
    return _joint(_shapes(known, points), known.model_error_covariance_m2)


def with_model_error(result: Adjustment) -> Adjustment:
    """Return the adjustment whose covariances of tie points and ground points count the model error of its
    ``deformation`` in height; as it is where there is none, and of a free network."""
    known = result.covariances.deformation
    if result.block.is_free:  # a tilt and a height mean nothing without a datum
        return result
    if not np.any(known.model_error_covariance_m2 > 0.0):
        return result

    pattern_m2 = known.model_error_covariance_m2
    ties, ground, joint = (
        array.copy()
        for array in (result.covariances.tie_point_m2, result.covariances.ground_m2, result.covariances.ground_joint_m2)
    )
    ties[:, 2, 2] += _variance(_shapes(known, result.block.tie_points.position_world_m), pattern_m2)
    of_ground = ground_model_error_m2(result)
    ground[:, 2, 2] += np.diag(of_ground)
    joint[2::3, 2::3] += of_ground
    return replace(
        result, covariances=replace(result.covariances, tie_point_m2=ties, ground_m2=ground, ground_joint_m2=joint)
    )
