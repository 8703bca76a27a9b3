"""Numbers of measured distances, and of a free network: its frame, its unit and its relative precision."""

from __future__ import annotations

import numpy as np

from photogram.report.record.local_frame import (
    DistanceRecord,
    LocalFrameRecord,
    MarkedPointRecord,
    RelativePrecisionRecord,
)
from photogram.results import Adjustment
from photogram.sfm.local_frame import SPACING, Vertical, VerticalBy, vertical_by_view
from photogram.survey import Block, Distance

TESTED = 1e-3
"""Least redundancy number of a distance that something else tests."""

_EXTENT = (5.0, 95.0)  # percentiles of tie points, between which the object lies


def distance_numbers(result: Adjustment) -> list[DistanceRecord]:
    """Return the measured distances beside the adjusted ones."""
    return [_distance(result, distance) for distance in result.block.distances]


def _distance(result: Adjustment, distance: Distance) -> DistanceRecord:
    block, sigma = result.block, float("nan")
    if distance.of_photographs:
        poses = {p.name: pose for p, pose in zip(block.photographs, block.poses, strict=True)}
        places = [None if (pose := poses[name]) is None else pose.position_world_m for name in distance.ends]
        ends = np.array([np.full(3, np.nan) if place is None else place for place in places])
    else:
        a, b = (block.control_points.name.index(name) for name in distance.ends)
        ends = result.ground_world_m[[a, b]]
        apart = ends[0] - ends[1]
        along = apart / np.linalg.norm(apart)
        joint = result.ground_joint_covariance_m2.reshape(len(result.ground_world_m), 3, -1, 3)
        C = joint[a, :, a] + joint[b, :, b] - joint[a, :, b] - joint[b, :, a]
        sigma = float(np.sqrt(max(along @ C @ along, 0.0))) if np.isfinite(C).all() else sigma
    residual = float(np.linalg.norm(ends[0] - ends[1])) - distance.length_m
    redundancy = 1.0 - sigma**2 / distance.sigma_m**2
    tested = np.isfinite(residual) and redundancy > TESTED
    return {
        "ends": list(distance.ends),
        "length_m": distance.length_m,
        "sigma_m": distance.sigma_m,
        "residual_m": residual if np.isfinite(residual) else None,
        "adjusted_sigma_m": sigma if np.isfinite(sigma) else None,
        "w": residual / (distance.sigma_m * float(np.sqrt(redundancy))) if tested else None,
    }


def marked_points(result: Adjustment) -> list[MarkedPointRecord]:
    """Return the points that are marked and not surveyed."""
    block, numbers = result.block, list[MarkedPointRecord]()
    points, R = block.control_points, block.frame.rotation_world_from_map(np.zeros(3))
    for g in np.flatnonzero(~np.isfinite(points.position_world_m).all(axis=1)).tolist():
        position = result.ground_world_m[g]
        known = bool(np.isfinite(position).all())
        covariance = R.T @ result.ground_covariance_m2[g] @ R
        numbers.append(
            {
                "name": points.name[g],
                "marks": int(np.count_nonzero(points.mark_point == g)),
                "position": block.frame.map_from_world(position[None])[0].tolist() if known else None,
                "sigma": np.sqrt(np.diag(covariance)).tolist() if known else None,
            }
        )
    return numbers


def _relative(result: Adjustment) -> RelativePrecisionRecord:
    X, tie = result.block.tie_points.position_world_m, result.tie_point_covariance_m2
    along = np.linalg.svd(X - np.median(X, axis=0), full_matrices=False)[2][0]
    low, high = np.percentile(X @ along, _EXTENT)
    position, attitude = result.position_covariance_m2, result.rotation_covariance_rad2
    sigma = [float(np.nanmedian(np.sqrt(np.einsum("naa->n", C) / 3.0))) for C in (position, attitude, tie)]
    return {
        "photographs": sigma[0],
        "attitudes_deg": float(np.rad2deg(sigma[1])),
        "tie_points": sigma[2],
        "tie_points_one_in": float((high - low) / sigma[2]),
    }


def _vertical(block: Block, measured: Block, wanted: Vertical) -> tuple[VerticalBy, bool]:
    attitudes = [p.attitude_world_from_camera is not None for p in measured.photographs]
    if wanted == "auto" and any(attitudes):
        return "attitudes", True
    rotation = np.array([pose.rotation_world_from_camera for pose in block.poses if pose is not None])
    found = vertical_by_view(rotation, wanted)
    return found.by, found.sure


_BY = {
    "attitudes": "by the measured attitudes",
    "down": "by the optical axes of photographs that look down",
    "level": "by photographs held level",
}


def local_frame_numbers(result: Adjustment, measured: Block, wanted: Vertical) -> LocalFrameRecord | None:
    """Return what there is to say of the frame of a free network, None for any other; ``measured`` is the block as
    photographs and tags give it, ``wanted`` the vertical that is asked for."""
    block = result.block
    if not block.is_free:
        return None
    by, sure = _vertical(block, measured, wanted)
    scale, relative = block.has_scale, _relative(result)
    unit = "metres" if scale else f"1 = {SPACING}"
    held = f"scale by {len(block.distances)} measured distance{'s' if len(block.distances) > 1 else ''}"
    if not scale:
        held = f"no scale: lengths are in units, {unit}, and not in metres; a distance gives the scale"
    doubt = "" if sure else ", which the photographs do not prove: orientation: {vertical: down} where they look down"
    sentence = (
        f"Free network without georeference: {held}; vertical {_BY[by]}{doubt}. Standard deviations are relative, with "
        "inner constraints on the tie points: neither the place nor the direction of the frame is measured"
    )
    return {
        "scale_known": scale,
        "unit": unit,
        "vertical_by": by,
        "vertical_sure": sure,
        "relative": relative,
        "sentence": sentence,
    }
