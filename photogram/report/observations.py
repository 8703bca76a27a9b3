"""observations.npz: everything that the last step of the adjustment had, as plain arrays that any program reads.

Observations with the standard deviations that were used, priors, estimates and the frame; docs/verify.md lists the
names. What of a model it does not hold in full is named in its array ``not_held``.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from photogram import __version__
from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.camera import Camera, calibration_sigmas, calibrations
from photogram.constraints.between_points import Distance
from photogram.factors.common_errors import attitude_errors, parts, position_effects, values_of
from photogram.factors.constraints import taking_part
from photogram.factors.elimination.loss import robust_weight
from photogram.geodesy.crs import crs_in_metres
from photogram.geodesy.frames import LocalFrame, geodetic_of
from photogram.geodesy.map_projection import projection_of
from photogram.measures.open_scale import open_scale
from photogram.measures.rough_place import rough_place
from photogram.projection import PARAMETER_NAMES
from photogram.quality.model_error import ground_model_error_m2
from photogram.results import Adjustment
from photogram.survey import Block, TiePoints

Arrays = dict[str, NDArray[np.generic]]
FORMAT = 1


def _texts(values: Sequence[str]) -> NDArray[np.str_]:
    return np.array(list(values), dtype=np.str_)


def _or_nan(value: FloatArray | None, shape: tuple[int, ...]) -> FloatArray:
    return np.full(shape, np.nan) if value is None else value


def _stack(values: Sequence[FloatArray | None], shape: tuple[int, ...]) -> FloatArray:
    """Return values (n, ...) of a shape, NaN where there is none."""
    return np.array([_or_nan(value, shape) for value in values], dtype=np.float64).reshape(-1, *shape)


def _photographs(block: Block) -> Arrays:
    photographs, cameras = block.photographs, block.oriented_cameras()
    arms = _stack([p.lever_arm_camera_m for p in photographs], (3,))
    sigmas = [np.nan if p.attitude_sigma_rad is None else p.attitude_sigma_rad for p in photographs]
    return {
        "photograph_name": _texts(block.photograph_names),
        "photograph_camera": block.camera_of,
        "photograph_flight": _texts([p.flight for p in photographs]),
        "rotation_world_from_camera": cameras.rotation,
        "centre_world_m": cameras.position,
        "velocity_world_m_s": cameras.velocity,
        "gnss_world_m": _stack([p.gnss_world_m for p in photographs], (3,)),
        "gnss_sigma_m": _stack([p.gnss_sigma_m for p in photographs], (3,)),
        "lever_arm_camera_m": np.nan_to_num(arms),
        "attitude_world_from_camera": _stack([p.attitude_world_from_camera for p in photographs], (3, 3)),
        "attitude_sigma_rad": np.array(sigmas, dtype=np.float64),
        "attitude_heading_known": np.array([p.heading_known for p in photographs], dtype=np.bool_),
    }


def _cameras(block: Block, priors: Sequence[Camera]) -> Arrays:
    cameras = block.cameras
    sigmas, found, expected = calibration_sigmas(cameras), calibrations(cameras), calibrations(priors)
    given = np.zeros_like(found)
    given[:, : expected.shape[1]] = expected
    return {
        "camera_name": _texts([c.name for c in cameras]),
        "camera_model": _texts([c.model for c in cameras]),
        "camera_size_px": np.array([(c.width_px, c.height_px) for c in cameras], dtype=np.int64),
        "camera_parameter_name": _texts(PARAMETER_NAMES),
        "camera_parameter": found,
        "camera_prior": given,
        "camera_prior_sigma": sigmas,
        "considered_focal_sigma_px": np.array([c.considered_focal_sigma_px for c in cameras]),
        "lens_function_px": block.oriented_cameras().functions,
    }


def _without(every: TiePoints, used: TiePoints) -> NDArray[np.bool_]:
    """Return which observations are not among those that were used: by photograph and place in it."""
    places = [np.column_stack([t.photograph, t.pixel]) for t in (used, every)]
    both, inverse = np.unique(np.concatenate(places), axis=0, return_inverse=True)
    of_used, of_every = np.split(inverse.ravel(), [len(used.photograph)])
    order, counted = np.argsort(of_every, kind="stable"), np.bincount(of_every, minlength=len(both))
    rank = np.empty(len(of_every), dtype=np.int64)  # among those at the same place
    rank[order] = np.arange(len(order)) - np.repeat(np.cumsum(counted) - counted, counted)
    return np.asarray(rank >= np.bincount(of_used, minlength=len(both))[of_every])


def _tie_points(result: Adjustment, block: Block, every: TiePoints, settings: AdjustmentSettings) -> Arrays:
    tie, lost = block.tie_points, _without(every, result.block.tie_points)
    whitened = result.estimates.residual_px / tie.sigma_px[:, None]
    square = np.einsum("ni,ni->n", whitened, whitened)
    names = np.array(result.block.photograph_names, dtype=np.str_)
    return {
        "tie_photograph": tie.photograph,
        "tie_point": tie.point,
        "tie_pixel_px": tie.pixel,
        "tie_sigma_px": tie.sigma_px,
        "tie_robust_weight": robust_weight(square, settings.robust_loss, settings.robust_threshold),
        "tie_point_world_m": tie.position_world_m,
        "robust_loss": np.array(settings.robust_loss),
        "robust_threshold": np.array(settings.robust_threshold),
        "photograph_not_oriented_name": names[~result.block.registered],
        "rejected_photograph_name": names[every.photograph[lost]],
        "rejected_pixel_px": every.pixel[lost],
        "rejected_sigma_px": every.sigma_px[lost],
    }


def _ground(block: Block, result: Adjustment) -> Arrays:
    points, control = block.control_points, np.array([r == "control" for r in block.control_points.role], dtype=bool)
    held, axes = points.position_world_m.copy(), np.repeat(np.eye(3)[None], len(points), axis=0)
    held[control], axes[control] = result.estimates.held_world_m, result.estimates.held_axes
    adjusted, covariance = result.estimates.ground_world_m, points.mark_covariance_px2.copy()
    seen = result.block.registered[result.block.control_points.mark_photograph]
    residual = result.estimates.mark_residual_px[seen]
    placed = np.asarray(np.isfinite(adjusted).all(axis=1))
    covariance[np.isnan(residual).any(axis=1) & placed[points.mark_point]] = np.inf
    return {
        "ground_name": _texts(points.name),
        "ground_is_control": control,
        "ground_controlled": points.controlled.reshape(-1, 3),
        "ground_surveyed_world_m": points.position_world_m,
        "ground_sigma_m": points.sigma_m,
        "ground_sigma_assumed": points.sigma_assumed,
        "ground_held_world_m": held,
        "ground_held_axes": axes,
        "ground_world_m": adjusted,
        "ground_model_error_m2": np.nan_to_num(ground_model_error_m2(result)),
        "mark_sigma_assumed": points.mark_sigma_assumed,
        "mark_photograph": points.mark_photograph,
        "mark_point": points.mark_point,
        "mark_pixel_px": points.mark_pixel,
        "mark_covariance_px2": covariance,
    }


def _common(block: Block, result: Adjustment) -> Arrays:
    """Return GNSS offsets and other common errors: how each component (S) moves positions (N, 3, S)."""
    errors, where = block.common_errors, parts(block.common_errors)
    values, flights = values_of(errors), {name: k for k, name in enumerate(result.estimates.flights)}
    moves = np.zeros((len(block.photographs), 3, len(values)))
    in_camera = np.zeros(len(values), dtype=np.bool_)
    for i, effects in enumerate(position_effects(block)):
        for effect in effects:
            moves[i, :, where[effect.error]] = effect.matrix
            in_camera[where[effect.error]] = effect.in_camera
    return {
        "gnss_offset_flight": _texts(result.estimates.flights),
        "gnss_offset_number": np.array([flights.get(p.flight, -1) for p in block.photographs], dtype=np.int64),
        "gnss_offset_world_m": result.estimates.offset_world_m,
        "gnss_offset_sigma_m": block.gnss_offset_sigma_m,
        "gnss_offset_common_sigma_m": np.array(block.datum_sigma_m),
        "common_error_kind": _texts([error.kind for error in errors for _ in error.sigma]),
        "common_error_number": np.array([k for k, e in enumerate(errors) for _ in e.sigma], dtype=np.int64),
        "common_error_value": values,
        "common_error_sigma": np.concatenate([np.zeros(0), *(error.sigma for error in errors)]),
        "common_error_moves": moves,
        "common_error_in_camera": in_camera,
        "attitude_common_error": np.array(attitude_errors(block), dtype=np.int64),
    }


def _constraints(block: Block) -> Arrays:
    """Return the distances that took part, and what else holds the block that the file has no arrays for."""
    placed = taking_part(block)
    distances = [(p, p.constraint) for p in placed if isinstance(p.constraint, Distance)]
    control = np.flatnonzero([role == "control" for role in block.control_points.role])
    ends = [p.index if d.of_photographs else control[p.index] for p, d in distances]
    scaled = bool(distances) or bool(block.rigs)
    others = {
        "rigs": bool(block.rigs),
        "known surface": block.known_surface is not None,
        "constraints of heights and surfaces": len(placed) > len(distances),
        "a block that is placed roughly": rough_place(block) is not None,
        "an open scale": not scaled and open_scale(block) is not None,
    }
    return {
        "distance_ends": np.array(ends, dtype=np.int64).reshape(-1, 2),
        "distance_of_photographs": np.array([d.of_photographs for _, d in distances], dtype=np.bool_),
        "distance_m": np.array([d.length_m for _, d in distances], dtype=np.float64),
        "distance_sigma_m": np.array([d.sigma_m for _, d in distances], dtype=np.float64),
        "network_is_free": np.array(block.is_free),
        "not_held": _texts([name for name, there in others.items() if there]),
    }


def _frame(block: Block, ground_world_m: dict[str, FloatArray]) -> Arrays:
    """Return the frame, and what leads from its places to the map: map coordinates, axes and geoid heights."""
    frame = block.frame
    arrays: Arrays = {
        "crs": np.array(frame.crs),
        "frame_kind": np.array(frame.kind),
        "frame_origin_map_m": np.array(frame.origin_map_m, dtype=np.float64),
        "map_axes_world": frame.rotation_world_from_map(np.zeros(3)),
    }
    flat = frame
    if not frame.is_local:
        projection = projection_of(frame.crs)
        arrays["map_projection"] = np.array(projection.method)
        arrays["map_ellipsoid_m"] = np.array(projection.semi_axes_m)
        arrays["map_projection_parameter"] = np.array(projection.parameters, dtype=np.float64)
        raised = float(frame.geoid_height_m(np.array([frame.origin_map_m]))[0])
        easting, northing, height = frame.origin_map_m
        flat = LocalFrame(frame.crs, (easting, northing, height + raised), frame.kind)
        origin = geodetic_of(crs_in_metres(frame.crs), np.array([flat.origin_map_m]), geographic=False)[0]
        arrays["frame_origin_geodetic_rad_m"] = np.array([*np.radians(origin[1::-1]), origin[2]])
    for name, world_m in ground_world_m.items():
        known = np.isfinite(world_m).all(axis=1)
        map_m, above, axes = frame.map_from_world(world_m), flat.map_from_world(world_m), np.zeros((len(world_m), 3, 3))
        for k in np.flatnonzero(known).tolist():
            axes[k] = frame.rotation_world_from_map(world_m[k])
        arrays |= {f"{name}_map_m": map_m, f"{name}_geoid_m": above[:, 2] - map_m[:, 2], f"{name}_map_axes": axes}
    return arrays


def observation_arrays(
    result: Adjustment, priors: Sequence[Camera], every: TiePoints, settings: AdjustmentSettings
) -> Arrays:
    """Return the arrays of observations.npz of an adjustment.

    ``priors`` are the cameras with what was known of them before its last step, ``every`` the tie points with all their
    observations, ``settings`` those of the adjustment. Photographs that are not oriented are left out, with their
    marks. Names carry frame and unit; the world is that of ``frame_kind``.
    """
    block, _ = registered_block(result.block)
    adjusted = result.estimates.ground_world_m
    centres = np.array([pose.position_world_m for pose in block.poses if pose is not None]).reshape(-1, 3)
    places = {
        "centre": centres,
        "ground_surveyed": block.control_points.position_world_m,
        "ground": adjusted,
    }
    return {
        "format": np.array(FORMAT),
        "photogram": np.array(__version__),
        **_photographs(block),
        **_cameras(block, priors),
        **_tie_points(result, block, every, settings),
        **_ground(block, result),
        **_common(block, result),
        **_constraints(block),
        **_frame(block, places),
    }
