"""The diagnosis in report.json: calibration, dome, weak geometry, what would help, why resections miss GNSS."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from photogram.arrays import FloatArray
from photogram.projection import PARAMETER_NAMES
from photogram.quality.diagnosis import REMEDIES, Diagnosis, Dome, diagnose
from photogram.quality.ground_errors import factor_of_differences
from photogram.quality.placing import DatumPrecision
from photogram.quality.resection_vs_gnss import resection_differences
from photogram.report.record.diagnosis import (
    CalibrationRecord,
    DiagnosisRecord,
    DomeRecord,
    GroundErrorsRecord,
    PlacingRecord,
)
from photogram.results import Adjustment
from photogram.sfm.resection import Resection


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _cameras(result: Adjustment, diagnosis: Diagnosis) -> dict[str, CalibrationRecord]:
    """Return the free parameters of every camera with their sigmas and correlations."""
    numbers: dict[str, CalibrationRecord] = {}
    for c, camera in enumerate(result.block.cameras):
        sigma = np.sqrt(np.diag(result.covariances.calibration[c]))
        free = np.flatnonzero(sigma > 0)
        numbers[camera.name] = {
            "parameters": [PARAMETER_NAMES[k] for k in free],
            "value": camera.parameters[free].tolist(),
            "sigma": sigma[free].tolist(),
            "correlation": diagnosis.correlation[camera.name][np.ix_(free, free)].tolist(),
        }
    return numbers


def _rounded(values: FloatArray, digits: int) -> list[Any]:
    return list(np.round(values, digits).tolist())


def ground_error_numbers(result: Adjustment) -> GroundErrorsRecord | None:
    """Return what photographs and calibration do to the ground at places over the block, easting, northing, height;
    None where there are too few tie points to say."""
    frame, known = result.block.frame, result.covariances.deformation
    places, covariance = known.ground_place_world_m, known.ground_covariance_m2
    if not len(places):
        return None
    axes = [frame.rotation_world_from_map(place) for place in places]
    factor = factor_of_differences(covariance)
    blocks = [covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(places))]
    variance = np.array([np.diag(R.T @ block @ R) for R, block in zip(axes, blocks, strict=True)])
    return {
        "position_map_m": _rounded(frame.map_from_world(places), 3),
        "sigma_m": _rounded(np.sqrt(variance), 6),
        "factor_m": _rounded(np.array([R.T @ part for R, part in zip(axes, factor, strict=True)]), 5),
    }


def _dome(dome: Dome) -> DomeRecord:
    return {
        "radius_m": _finite(dome.radius_m),
        "measured_m": _finite(dome.measured_m),
        "sigma_m": _finite(dome.sigma_m),
        "significant": dome.significant,
        "predicted_sigma_m": _finite(dome.predicted_sigma_m),
        "points": dome.points,
        "control_points": dome.control_points,
    }


def _placing(placing: DatumPrecision) -> PlacingRecord:
    return {
        "absolute_plan_m": _finite(placing.absolute_plan_m),
        "absolute_height_m": _finite(placing.absolute_height_m),
        "relative_plan_m": _finite(placing.relative_plan_m),
        "relative_height_m": _finite(placing.relative_height_m),
        "shift_plan_m": _finite(placing.shift_plan_m),
        "shift_height_m": _finite(placing.shift_height_m),
        "tilt_m": _finite(placing.tilt_m),
        "radius_m": _finite(placing.radius_m),
    }


def diagnosis_numbers(result: Adjustment, resections: Sequence[Resection | None]) -> DiagnosisRecord:
    """Return what a finished block is weak in, and what would help."""
    found = diagnose(result)
    differences = resection_differences(result, resections)
    return {
        "cameras": _cameras(result, found),
        "focal_height_correlation": {
            name: {
                "projection_centres": _finite(focal.centres),
                "ground": _finite(focal.ground),
                "gnss_offset": {flight: _finite(r) for flight, r in focal.offset.items()},
                "sigma_height_m": _finite(focal.height_sigma_m),
            }
            for name, focal in found.focal_height.items()
        },
        "residual_pattern": {
            name: {
                "pattern_px": pattern.pattern_px,
                "residual_px": pattern.residual_px,
                "chance_px": pattern.chance_px,
                "squares": pattern.squares,
                "significant": pattern.significant,
            }
            for name, pattern in found.patterns.items()
        },
        "pattern_effect": {
            "slopes_m": [_finite(s) for s in result.covariances.deformation.pattern_sigma_m[:2]],
            "dome_m": _finite(result.covariances.deformation.pattern_sigma_m[2]),
            "radius_m": _finite(result.covariances.deformation.radius_m),
        },
        "dome": _dome(found.dome),
        "placing": None if found.datum_precision is None else _placing(found.datum_precision),
        "intersection_sigma_m": [_finite(s) for s in result.covariances.deformation.intersection_sigma_m],
        "ground_errors": ground_error_numbers(result),
        "warnings": list(found.warnings),
        "remedies": [
            {
                "what": remedy.what,
                "sigma_height_before_m": remedy.sigma_height_before_m,
                "sigma_height_after_m": remedy.sigma_height_after_m,
                "sigma_dome_before_m": remedy.sigma_dome_before_m,
                "sigma_dome_after_m": remedy.sigma_dome_after_m,
                "title": REMEDIES[remedy.what],
                "helps": remedy.helps,
                "sentence": remedy.sentence,
            }
            for remedy in found.remedies
        ],
        "undetermined": list(found.undetermined),
        "resections": [
            {
                "camera": d.camera,
                "flight": d.flight,
                "photographs": len(d.distance_m),
                "mean_m": d.mean_m.tolist(),
                "focal_m": d.focal_m,
                "offset_m": d.offset_m.tolist(),
                "rest_m": d.rest_m.tolist(),
                "scatter_m": d.scatter_m,
                "sentence": d.sentence,
            }
            for d in differences
        ],
    }
