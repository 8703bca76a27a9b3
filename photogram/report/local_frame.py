"""Numbers of measured distances, and of a free network: its frame, its unit and its relative precision."""

from __future__ import annotations

import numpy as np

from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.constraints.between_points import Distance, gives_scale, observations
from photogram.report.record.local_frame import (
    DistanceRecord,
    LocalFrameRecord,
    MarkedPointRecord,
    RelativePrecisionRecord,
)
from photogram.results import Adjustment
from photogram.sfm.local_frame import SPACING, Vertical, VerticalBy, vertical_by_view
from photogram.survey import Block

_EXTENT = (5.0, 95.0)  # percentiles of tie points, between which the object lies


def distance_numbers(result: Adjustment) -> list[DistanceRecord]:
    """Return the measured distances beside the adjusted ones."""
    tests, numbers = result.constraints, list[DistanceRecord]()
    for k, observed in enumerate(observations(result.block.constraints)):
        distance = result.block.constraints[observed.constraint]
        if not isinstance(distance, Distance):
            continue
        figures = (tests.residual_m, tests.adjusted_sigma_m, tests.w, tests.redundancy, tests.z)
        residual, sigma, w, redundancy, z = (_finite(values[k]) for values in figures)
        mdb = float(minimal_detectable_blunder(np.array(distance.sigma_m), np.array(redundancy or 0.0)))
        numbers.append(
            {
                "ends": list(distance.ends),
                "length_m": distance.length_m,
                "sigma_m": distance.sigma_m,
                "residual_m": residual,
                "adjusted_sigma_m": sigma,
                "w": w,
                "name": observed.label,
                "role": distance.role,
                "redundancy": redundancy,
                "mdb_m": _finite(mdb),
                "z": z,
            }
        )
    return numbers


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


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
    count = sum(gives_scale([constraint]) for constraint in block.constraints)
    held = f"scale by {count} measured distance{'s' if count > 1 else ''}"
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
