"""The diagnosis in report.json: calibration, dome, weak geometry, what would help, why resections miss GNSS."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from photogram.arrays import FloatArray
from photogram.projection import PARAMETER_NAMES
from photogram.quality.diagnosis import Diagnosis, diagnose
from photogram.quality.ground_errors import factor_of_differences
from photogram.quality.resection_vs_gnss import resection_differences
from photogram.report.record.diagnosis import (
    CalibrationRecord,
    DiagnosisRecord,
    DomeRecord,
    GroundErrorsRecord,
    PlacingRecord,
    RemedyRecord,
    ResectionsRecord,
    ResidualPatternRecord,
)
from photogram.report.values import finite, finites, record_of
from photogram.results import Adjustment
from photogram.sfm.resection import Resection


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


def diagnosis_numbers(result: Adjustment, resections: Sequence[Resection | None]) -> DiagnosisRecord:
    """Return what a finished block is weak in, and what would help."""
    diagnosis, known = diagnose(result), result.covariances.deformation
    return {
        "cameras": _cameras(result, diagnosis),
        "focal_height_correlation": {
            name: {
                "projection_centres": finite(focal.centres),
                "ground": finite(focal.ground),
                "gnss_offset": {flight: finite(r) for flight, r in focal.offset.items()},
                "sigma_height_m": finite(focal.height_sigma_m),
            }
            for name, focal in diagnosis.focal_height.items()
        },
        "residual_pattern": {
            name: record_of(ResidualPatternRecord, pattern) for name, pattern in diagnosis.patterns.items()
        },
        "pattern_effect": {
            "slopes_m": finites(known.pattern_sigma_m[:2]),
            "dome_m": finite(known.pattern_sigma_m[2]),
            "radius_m": finite(known.radius_m),
        },
        "dome": record_of(DomeRecord, diagnosis.dome),
        "placing": None if diagnosis.datum_precision is None else record_of(PlacingRecord, diagnosis.datum_precision),
        "intersection_sigma_m": finites(known.intersection_sigma_m),
        "ground_errors": ground_error_numbers(result),
        "warnings": list(diagnosis.warnings),
        "remedies": [record_of(RemedyRecord, remedy) for remedy in diagnosis.remedies],
        "undetermined": list(diagnosis.undetermined),
        "resections": [
            record_of(ResectionsRecord, difference, photographs=len(difference.distance_m))
            for difference in resection_differences(result, resections)
        ],
    }
