"""The numbers of report.json that say whether the result is as good as predicted."""

from dataclasses import dataclass

import numpy as np

from photogram.adjustment.stochastic_model.variance_components import Scatter, scatters
from photogram.arrays import FloatArray, nmad
from photogram.quality.prediction_test import (
    LeaveOneOut,
    PredictedAgainstAchieved,
    Shares,
    leave_one_out,
    predicted_against_achieved,
)
from photogram.report.record.ground import (
    EstimatedSigmaRecord,
    GroundPointRecord,
    LeaveOneOutRecord,
    PredictionTestRecord,
    VarianceComponentRecord,
    ZScoresRecord,
)
from photogram.report.record.surfaces import DatumSigmaRecord, DsmRecord, SigmaRecord
from photogram.results import Adjustment, EstimatedSigmas
from photogram.survey import Raster

# what a group's observations are called in a sentence, the unit of their sigmas, and how many of it one px, m or rad is
_GROUPS = {
    "tie_points": ("tie points", "px", 1.0),
    "marks": ("marks", "px", 1.0),
    "control_plan": ("control points in plan", "m", 1.0),
    "control_height": ("control points in height", "m", 1.0),
    "gnss_plan": ("GNSS positions in plan", "m", 1.0),
    "gnss_height": ("GNSS positions in height", "m", 1.0),
    "attitude": ("measured attitudes", "deg", 180.0 / np.pi),
    "gnss_offset": ("offsets of GNSS", "m", 1.0),
    "common_errors": ("common errors", "", 1.0),
    "distances": ("measured distances", "m", 1.0),
    "height_differences": ("height differences", "m", 1.0),
    "level_surfaces": ("points of level surfaces", "m", 1.0),
    "planes": ("points of planes", "m", 1.0),
    "exposure_rotation": ("exposures of rigs in rotation", "deg", 180.0 / np.pi),
    "exposure_offset": ("exposures of rigs in offset", "m", 1.0),
    "relative_poses": ("given relative poses", "", 1.0),
    "calibration": ("given calibrations", "", 1.0),
    "lens_fields": ("coefficients of lens fields", "px", 1.0),
}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _sentence(name: str, found: Scatter) -> str | None:
    """Return what there is to say of a group whose sigmas are refuted, None for any other."""
    if not found.significant:
        return None
    title, unit, factor = _GROUPS[name]
    stated, sd = found.stated_sigma * factor, found.sigma_factor_sd
    times = f"{title} scatter {found.sigma_factor:.2g} ± {sd:.1g} times as much as stated"
    remedy = (
        "a blunder among them, or their sigma is too small" if found.sigma_factor > 1.0 else "their sigma is too large"
    )
    if not unit:
        return f"{times}: {remedy}"
    return f"{times} ({stated:.2g} {unit}): about {found.sigma_factor * stated:.2g} {unit}; {remedy}"


def component_numbers(result: Adjustment) -> dict[str, VarianceComponentRecord]:
    """Return the variance component of every group of observations, at the sigmas that were used."""
    return {
        name: {
            "observations": found.observations,
            "redundancy": found.redundancy,
            "stated_sigma": None if not _GROUPS[name][1] else found.stated_sigma * _GROUPS[name][2],
            "used_sigma": None if not _GROUPS[name][1] else found.used_sigma * _GROUPS[name][2],
            "unit": _GROUPS[name][1] or None,
            "sigma_factor": _finite(found.sigma_factor),
            "sigma_factor_sd": _finite(found.sigma_factor_sd),
            "significant": found.significant,
            "sentence": _sentence(name, found),
        }
        for name, found in scatters(result.tests.components).items()
    }


def estimated_sigma_numbers(sigmas: EstimatedSigmas) -> list[EstimatedSigmaRecord]:
    """Return the standard deviations that were estimated from residuals, beside the stated and the used ones."""
    return [
        {
            "kind": kind,
            "of": str(sigmas.of[k]),
            "observations": int(sigmas.observations[k]),
            "redundancy": float(sigmas.redundancy[k]),
            "stated_sigma": float(sigmas.stated_sigma[k]),
            "estimated_sigma": _finite(sigmas.estimated_sigma[k]),
            "used_sigma": float(sigmas.used_sigma[k]),
            "unit": "m" if kind in ("gnss_plan", "gnss_height") else "px",
            "factor": float(sigmas.factor[k]),
        }
        for k, kind in enumerate(sigmas.kind.tolist())
    ]


def _z_scores(found: Shares) -> ZScoresRecord:
    return {
        "n": found.n,
        "mean_z": found.mean_z,
        "rms_z": found.rms_z,
        "within_1": found.within_1,
        "within_2": found.within_2,
        "within_3": found.within_3,
    }


def _check_point_numbers(found: PredictedAgainstAchieved | None) -> PredictionTestRecord | None:
    if found is None:
        return None
    return {
        "n": found.n,
        "axes": {
            "easting": _z_scores(found.axes["easting"]),
            "northing": _z_scores(found.axes["northing"]),
            "height": _z_scores(found.axes["height"]),
        },
        "chi2": {"value": found.chi2, "dof": found.dof, "p": found.p},
        "consistent": found.consistent,
        "sentence": found.sentence,
    }


def _left_out_numbers(found: LeaveOneOut) -> LeaveOneOutRecord:
    return {
        "n": found.n,
        "rmse_m": list(found.rmse_m),
        "mean_m": list(found.mean_m),
        "rmse_h_m": found.rmse_h_m,
        "rmse_v_m": found.rmse_v_m,
        "rms_z": list(found.rms_z),
        "max": {"name": found.worst, "left_out_m": list(found.worst_m), "z": list(found.worst_z)},
    }


@dataclass(frozen=True)
class Consistency:
    """Whether residuals and check points agree with the stated and the predicted sigmas."""

    predicted_against_achieved: PredictionTestRecord | None
    leave_one_out: LeaveOneOutRecord | None
    variance_components: dict[str, VarianceComponentRecord]
    estimated_sigmas: list[EstimatedSigmaRecord]


def consistency_numbers(result: Adjustment, points: list[GroundPointRecord]) -> Consistency:
    """Return whether a survey is as good as predicted; each of the ground points gets its ``z`` and ``mahalanobis``,
    null where it was not checked; a check point that everything else contradicts is suspect, and its verdict says so.
    """
    found, left_out = predicted_against_achieved(result), leave_one_out(result)
    accused = {} if found is None else {suspect.name: suspect.sentence for suspect in found.suspects}
    for g, point in enumerate(points):
        checked = found is not None and bool(np.isfinite(found.distance2[g]))
        point["z"] = [_finite(z) for z in found.z[g]] if found is not None and checked else None
        point["mahalanobis"] = float(np.sqrt(found.distance2[g])) if found is not None and checked else None
        if checked and point["role"] == "check":
            point["suspect"] = point["name"] in accused
        if point["name"] in accused:
            said = [point["verdict"]] if point["verdict"] else []
            point["suspect"], point["verdict"] = True, "; ".join([*said, accused[point["name"]]])
    loo = None if left_out is None else _left_out_numbers(left_out)
    sigmas = estimated_sigma_numbers(result.decisions.sigmas)
    return Consistency(_check_point_numbers(found), loo, component_numbers(result), sigmas)


def _sigma_numbers(sigma: Raster) -> SigmaRecord:
    known = sigma.values[np.isfinite(sigma.values)].astype(np.float64)
    return {
        "median": float(np.median(known)),
        "mean": float(known.mean()),
        "percentile_95": float(np.percentile(known, 95)),
        "maximum": float(known.max()),
    }


def _datum_sigma(covariance_m2: FloatArray) -> DatumSigmaRecord:
    easting, northing, height = (_finite(s) for s in np.sqrt(np.diag(covariance_m2)).tolist())
    return {"easting": easting, "northing": northing, "height": height}


def dsm_numbers(
    surface: Raster,
    sigma: Raster,
    held_out_m: FloatArray,
    relative: Raster | None = None,
    datum_covariance_m2: FloatArray | None = None,
) -> DsmRecord:
    """Return the size of the DSM, what the standard deviations of its heights are, and by what it is off at tie points
    (K,) that were held out of it, null where none were; ``relative`` are the standard deviations without the datum's
    part, which has a covariance (3, 3) along easting, northing and height."""
    off = held_out_m if len(held_out_m) else np.full(1, np.nan)
    return {
        "rows": surface.values.shape[0],
        "columns": surface.values.shape[1],
        "cell_m": surface.cell_m,
        "cells": int(np.isfinite(sigma.values).sum()),
        "sigma_m": _sigma_numbers(sigma),
        "relative_sigma_m": None if relative is None else _sigma_numbers(relative),
        "datum_sigma_m": None if datum_covariance_m2 is None else _datum_sigma(datum_covariance_m2),
        "held_out": {
            "n": len(held_out_m),
            "rmse_m": _finite(np.sqrt(np.mean(off**2))),
            "nmad_m": _finite(nmad(off)),
        },
    }
