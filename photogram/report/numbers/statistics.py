"""The numbers of report.json that say whether the result is as good as predicted."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from photogram.adjustment.stochastic_model.variance_components import Scatter, scatters
from photogram.arrays import FloatArray, nmad
from photogram.quality.asprs import AXES
from photogram.quality.prediction_test import (
    LeaveOneOut,
    PredictedAgainstAchieved,
    leave_one_out,
    predicted_against_achieved,
)
from photogram.report.record.ground import (
    EstimatedSigmaRecord,
    FarthestPointRecord,
    GroundPointRecord,
    LeaveOneOutRecord,
    PredictionTestRecord,
    VarianceComponentRecord,
    ZScoresRecord,
)
from photogram.report.record.surfaces import DatumSigmaRecord, DsmRecord, SigmaRecord
from photogram.report.values import finite, finites, record_of
from photogram.results import Adjustment, EstimatedSigmas
from photogram.survey import Raster


@dataclass(frozen=True)
class Group:
    """A group of observations: what they are called in a sentence, the unit of their sigmas, none where they have
    several, and how many of it one px, m or rad is."""

    title: str
    unit: str = "m"
    factor: float = 1.0


_DEGREES = 180.0 / np.pi
GROUPS: Mapping[str, Group] = MappingProxyType(
    {
        "tie_points": Group("tie points", "px"),
        "marks": Group("marks", "px"),
        "control_plan": Group("control points in plan"),
        "control_height": Group("control points in height"),
        "gnss_plan": Group("GNSS positions in plan"),
        "gnss_height": Group("GNSS positions in height"),
        "attitude": Group("measured attitudes", "deg", _DEGREES),
        "gnss_offset": Group("offsets of GNSS"),
        "common_errors": Group("common errors", ""),
        "distances": Group("measured distances"),
        "height_differences": Group("height differences"),
        "level_surfaces": Group("points of level surfaces"),
        "planes": Group("points of planes"),
        "known_surface": Group("points on the known surface"),
        "exposure_rotation": Group("exposures of rigs in rotation", "deg", _DEGREES),
        "exposure_offset": Group("exposures of rigs in offset"),
        "relative_poses": Group("given relative poses", ""),
        "calibration": Group("given calibrations", ""),
        "lens_fields": Group("coefficients of lens fields", "px"),
    }
)


def _sentence(group: Group, scatter: Scatter) -> str | None:
    """Return what there is to say of a group whose sigmas are refuted, None for any other."""
    if not scatter.significant:
        return None
    ratio = scatter.sigma_factor
    stated = scatter.stated_sigma * group.factor
    unit = group.unit
    times = f"{group.title} scatter {ratio:.2g} ± {scatter.sigma_factor_sd:.1g} times as much as stated"
    remedy = "a blunder among them, or their sigma is too small" if ratio > 1.0 else "their sigma is too large"
    if not unit:
        return f"{times}: {remedy}"
    return f"{times} ({stated:.2g} {unit}): about {ratio * stated:.2g} {unit}; {remedy}"


def component_numbers(result: Adjustment) -> dict[str, VarianceComponentRecord]:
    """Return the variance component of every group of observations, at the sigmas that were used."""
    return {name: _component(GROUPS[name], scatter) for name, scatter in scatters(result.tests.components).items()}


def _component(group: Group, scatter: Scatter) -> VarianceComponentRecord:
    return record_of(
        VarianceComponentRecord,
        scatter,
        stated_sigma=scatter.stated_sigma * group.factor if group.unit else None,
        used_sigma=scatter.used_sigma * group.factor if group.unit else None,
        unit=group.unit or None,
        sentence=_sentence(group, scatter),
    )


def estimated_sigma_numbers(sigmas: EstimatedSigmas) -> list[EstimatedSigmaRecord]:
    """Return the standard deviations that were estimated from residuals, beside the stated and the used ones."""
    return [
        {
            "kind": kind,
            "of": str(sigmas.of[k]),
            "observations": int(sigmas.observations[k]),
            "redundancy": float(sigmas.redundancy[k]),
            "stated_sigma": float(sigmas.stated_sigma[k]),
            "estimated_sigma": finite(sigmas.estimated_sigma[k]),
            "used_sigma": float(sigmas.used_sigma[k]),
            "unit": "m" if kind.endswith(("_plan", "_height")) else "px",
            "factor": float(sigmas.factor[k]),
        }
        for k, kind in enumerate(sigmas.kind.tolist())
    ]


def _check_point_numbers(test: PredictedAgainstAchieved | None) -> PredictionTestRecord | None:
    if test is None:
        return None
    east, north, height = (record_of(ZScoresRecord, test.axes[axis]) for axis in AXES)
    return {
        "n": test.n,
        "axes": {"easting": east, "northing": north, "height": height},
        "chi2": {"value": test.chi2, "dof": test.dof, "p": test.p},
        "consistent": test.consistent,
        "sentence": test.sentence,
    }


def _left_out_numbers(test: LeaveOneOut) -> LeaveOneOutRecord:
    farthest: FarthestPointRecord = {
        "name": test.worst,
        "left_out_m": list(test.worst_m),
        "z": list(test.worst_z),
    }
    return record_of(LeaveOneOutRecord, test, max=farthest)


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
    test, left_out = predicted_against_achieved(result), leave_one_out(result)
    accused = {} if test is None else {suspect.name: suspect.sentence for suspect in test.suspects}
    for g, point in enumerate(points):
        checked = test is not None and bool(np.isfinite(test.distance2[g]))
        point["z"] = finites(test.z[g]) if test is not None and checked else None
        point["mahalanobis"] = float(np.sqrt(test.distance2[g])) if test is not None and checked else None
        if checked and point["role"] == "check":
            point["suspect"] = point["name"] in accused
        if point["name"] in accused:
            before = [point["verdict"]] if point["verdict"] else []
            point["suspect"], point["verdict"] = True, "; ".join([*before, accused[point["name"]]])
    loo = None if left_out is None else _left_out_numbers(left_out)
    sigmas = estimated_sigma_numbers(result.decisions.sigmas)
    return Consistency(_check_point_numbers(test), loo, component_numbers(result), sigmas)


def _sigma_numbers(sigma: Raster) -> SigmaRecord:
    known = sigma.values[np.isfinite(sigma.values)].astype(np.float64)
    return {
        "median": float(np.median(known)),
        "mean": float(known.mean()),
        "percentile_95": float(np.percentile(known, 95)),
        "maximum": float(known.max()),
    }


def _datum_sigma(covariance_m2: FloatArray) -> DatumSigmaRecord:
    easting, northing, height = finites(np.sqrt(np.diag(covariance_m2)))
    return {"easting": easting, "northing": northing, "height": height}


def dsm_numbers(
    surface: Raster,
    sigma: Raster,
    held_out_m: FloatArray,
    relative: Raster | None,
    datum_covariance_m2: FloatArray | None,
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
            "rmse_m": finite(np.sqrt(np.mean(off**2))),
            "nmad_m": finite(nmad(off)),
        },
    }
