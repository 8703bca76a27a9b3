"""Numbers of constraints between points, and of a free network: its frame, its unit and its relative precision."""

from collections.abc import Iterator

import numpy as np
from typing_extensions import TypedDict

from photogram.adjustment.reliability import minimal_detectable_blunder
from photogram.constraints.between_points import (
    Constraint,
    ConstraintRole,
    Distance,
    HeightDifference,
    Observed,
    gives_scale,
    observations,
)
from photogram.constraints.rigs import give_scale
from photogram.measures.vertical import Vertical, VerticalBy, vertical_by_view
from photogram.report.record.local_frame import (
    ConstraintRecord,
    DistanceRecord,
    LocalFrameRecord,
    MarkedPointRecord,
    RelativePrecisionRecord,
)
from photogram.report.values import finite
from photogram.results import Adjustment
from photogram.sfm.local_frame import SPACING
from photogram.survey import Block

_EXTENT = (5.0, 95.0)  # percentiles of tie points, between which the object lies


class _Figures(TypedDict):
    """What every observation of a constraint has in the report, beside what was measured."""

    name: str
    role: ConstraintRole
    sigma_m: float
    residual_m: float | None
    adjusted_sigma_m: float | None
    redundancy: float | None
    w: float | None
    mdb_m: float | None
    z: float | None
    rejected: bool


def _figures(result: Adjustment, measured: Block) -> Iterator[tuple[Observed, Constraint, _Figures]]:
    """Yield the observations of the constraints of a block as it was ``measured``, and their figures."""
    tests, constraints = result.tests.constraints, result.block.constraints
    for k, observed in enumerate(observations(constraints)):
        stated = measured.constraints[observed.constraint]
        sigma_m = stated.sigmas_m[observed.row]
        columns = (tests.residual_m, tests.adjusted_sigma_m, tests.redundancy, tests.w, tests.z)
        residual, adjusted, redundancy, w, z = (finite(values[k]) for values in columns)
        mdb = float(minimal_detectable_blunder(np.array(sigma_m), np.array(redundancy or 0.0)))
        yield (
            observed,
            stated,
            {
                "name": observed.label,
                "role": stated.role,
                "sigma_m": sigma_m,
                "residual_m": residual,
                "adjusted_sigma_m": adjusted,
                "redundancy": redundancy,
                "w": w,
                "mdb_m": finite(mdb),
                "z": z,
                "rejected": not np.isfinite(constraints[observed.constraint].sigmas_m[observed.row]),
            },
        )


def distance_numbers(result: Adjustment, measured: Block) -> list[DistanceRecord]:
    """Return the distances of a block as it was ``measured`` beside the adjusted ones."""
    return [
        {"ends": list(stated.ends), "length_m": stated.length_m, **figures}
        for _, stated, figures in _figures(result, measured)
        if isinstance(stated, Distance)
    ]


def constraint_numbers(result: Adjustment, measured: Block) -> list[ConstraintRecord]:
    """Return the other constraints of a block as it was ``measured``, height differences and points of surfaces,
    beside the adjusted ones."""
    return [
        {
            "kind": observed.kind,
            "points": list(observed.points),
            "difference_m": stated.difference_m if isinstance(stated, HeightDifference) else None,
            **figures,
        }
        for observed, stated, figures in _figures(result, measured)
        if not isinstance(stated, Distance)
    ]


def marked_points(result: Adjustment) -> list[MarkedPointRecord]:
    """Return the points that are marked and not surveyed."""
    block, numbers = result.block, list[MarkedPointRecord]()
    points, R = block.control_points, block.frame.rotation_world_from_map(np.zeros(3))
    for g in np.flatnonzero(~np.isfinite(points.position_world_m).all(axis=1)).tolist():
        position = result.estimates.ground_world_m[g]
        known = bool(np.isfinite(position).all())
        covariance = R.T @ result.covariances.ground_m2[g] @ R
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
    X, tie = result.block.tie_points.position_world_m, result.covariances.tie_point_m2
    along = np.linalg.svd(X - np.median(X, axis=0), full_matrices=False)[2][0]
    low, high = np.percentile(X @ along, _EXTENT)
    position, attitude = result.covariances.position_m2, result.covariances.rotation_rad2
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
    vertical = vertical_by_view(rotation, wanted)
    return vertical.by, vertical.sure


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
    count, baselines = sum(gives_scale([constraint]) for constraint in block.constraints), give_scale(block.rigs)
    source = f"scale by {count} measured distance{'s' if count > 1 else ''}"
    if baselines:
        source = f"{source} and " if count else "scale by "
        source += "the given baseline between cameras of one body"
    if not scale:
        source = f"no scale: lengths are in units, {unit}, and not in metres; a distance gives the scale"
    doubt = "" if sure else ", which the photographs do not prove: orientation: {vertical: down} where they look down"
    sentence = (
        f"Free network without georeference: {source}; vertical {_BY[by]}{doubt}. Standard deviations are relative, "
        "with inner constraints on the tie points: neither the place nor the direction of the frame is measured"
    )
    return {
        "scale_known": scale,
        "unit": unit,
        "vertical_by": by,
        "vertical_sure": sure,
        "relative": relative,
        "sentence": sentence,
    }
