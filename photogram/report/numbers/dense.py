"""The numbers of report.json that tell of the dense surface and the orthophoto, and their tests at the check points."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.grid import bands
from photogram.quality.asprs import MINIMUM_POINTS, asprs_accuracy
from photogram.report.numbers.dense_surface import DenseSurface, GroundMarks, OrthophotoPicture, is_assumed, sampled
from photogram.report.record.block import OverlapRecord
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.surfaces import (
    AreasRecord,
    CellsRecord,
    ConfidenceRecord,
    DenseRecord,
    OrthophotoCheckRecord,
    OrthophotoPointRecord,
    OrthophotoRecord,
    SigmaRecord,
    SurfaceCheckRecord,
    SurfacePointRecord,
    SurfaceSummaryRecord,
    UntestedPointRecord,
    WaterAreaRecord,
    WaterRecord,
)
from photogram.report.values import finite
from photogram.surface.dense.pyramid import MINIMUM_RAYS
from photogram.surface.ortho.marked_targets import LocatedTarget

SEEN_BY = 3
"""Of the cells that so many photographs show the measured ones are the completeness."""
FEWEST_CHECKS = 3
"""With fewer check points on the surface no RMSE is given."""
REFUTED_RMS_Z = 2.0
"""Differences that are so many times their predicted standard deviations refute these."""


def dense_numbers(
    dense: DenseSurface,
    ground: GroundMarks,
    matching_sigma_m: float | None = None,
    *,
    left_out_m2: float = 0.0,
    upright: bool = False,
) -> DenseRecord:
    """Return the key `dense` of report.json: size and completeness, standard deviations, and check points;
    ``matching_sigma_m`` is what the matched heights scatter by themselves, None where that is not known,
    ``left_out_m2`` the area that is not mapped. Of a surface on an ``upright`` plane all is along its axes."""
    rows, columns = dense.heights.values.shape
    check_points = surface_check_numbers(dense, ground, upright=upright)
    cells, by_rays, by_level = _counted(dense)
    several, rays = int(by_rays[3:].sum()), int(by_rays.sum())
    land = (cells["seen_3_or_more"] or 0) - (cells["water_of_these"] or 0)
    return {
        "cell_m": dense.cell_m,
        "rows": rows,
        "columns": columns,
        "cells": cells,
        "areas": _areas(cells, dense.cell_m**2, left_out_m2),
        "completeness": (cells["measured_of_these"] or 0) / land if land else None,
        "by_rays": {str(n): int(by_rays[n]) for n in np.flatnonzero(by_rays).tolist()},
        "by_level": {str(n): int(by_level[n]) for n in np.flatnonzero(by_level).tolist()},
        "share_3_or_more": several / rays if rays else None,
        "sigma_m": sigma_numbers(dense),
        "confidence": _confidence(dense),
        "photographs": {"used": len(dense.photographs), "names": list(dense.photographs)},
        "settings": dict(dense.settings),
        "check_points": check_points,
        "warnings": _warnings(check_points),
        "matching_sigma_m": matching_sigma_m,
    }


def sigma_numbers(dense: DenseSurface) -> SigmaRecord | None:
    """Return the spread of the standard deviations of the measured cells, None where there are none."""
    values = _measured(dense, dense.sigma.values)
    if not len(values):
        return None
    mean, maximum = float(values.mean(dtype=np.float64)), float(values.max())
    median, far = np.percentile(values, [50, 95], overwrite_input=True).tolist()
    return {"median": median, "mean": mean, "percentile_95": far, "maximum": maximum}


def _confidence(dense: DenseSurface) -> ConfidenceRecord | None:
    """Return the spread of the confidence of the measured cells, None where there are none."""
    values = _measured(dense, dense.confidence)
    if not len(values):
        return None
    mean, minimum = float(values.mean(dtype=np.float64)), float(values.min())
    median, far = np.percentile(values, [50, 5], overwrite_input=True).tolist()
    return {"median": median, "mean": mean, "percentile_5": far, "minimum": minimum}


def _counted(dense: DenseSurface) -> tuple[CellsRecord, IntArray, IntArray]:
    """Count cells: those mapped, which are measured, filled, on water or interpolated from far off; those
    measured by so many photographs, and those measured in cells of so many to a side."""
    shape = dense.heights.values.shape
    mapped = measured = filled = water = twice = several = told = under = 0
    by_rays, by_level = np.zeros((2, 256), dtype=np.int64)
    for band in bands(shape):
        known, made_up = dense.measured(band), dense.filled[band]
        wet = np.zeros_like(known) if dense.water is None else dense.water[band]
        seen = np.full(known.shape, SEEN_BY) if dense.seen is None else dense.seen[band]
        often = seen >= SEEN_BY
        twice += int((seen >= MINIMUM_RAYS).sum())
        far = seen >= MINIMUM_RAYS if dense.interpolated is None else dense.interpolated[band]
        # a height that was closed at the rim counts where it is, though one photograph alone may show it
        mapped += int((far | known | made_up | wet).sum())
        measured, filled, water = measured + int(known.sum()), filled + int(made_up.sum()), water + int(wet.sum())
        several, told = several + int(often.sum()), told + int((known & often).sum())
        under += int((wet & often).sum())
        by_rays += np.bincount(dense.rays[band][known], minlength=256)
        by_level += np.bincount(dense.level[band][known], minlength=256)
    asked = dense.settings.get("photographs")
    is_known = not isinstance(asked, int) or asked >= SEEN_BY
    cells: CellsRecord = {
        "grid": shape[0] * shape[1],
        "mapped": mapped,
        "measured": measured,
        "filled": filled,
        "water": water,
        "interpolated": mapped - measured - filled - water,
        "seen_2_or_more": twice,
        "seen_3_or_more": several if is_known else None,
        "measured_of_these": told if is_known else None,
        "water_of_these": under if is_known else None,
    }
    return cells, by_rays, by_level


def _areas(cells: CellsRecord, cell_m2: float, left_out_m2: float) -> AreasRecord:
    several = cells["seen_3_or_more"]
    return {
        "mapped_m2": cells["mapped"] * cell_m2,
        "measured_m2": cells["measured"] * cell_m2,
        "filled_m2": cells["filled"] * cell_m2,
        "water_m2": cells["water"] * cell_m2,
        "interpolated_m2": cells["interpolated"] * cell_m2,
        "seen_3_or_more_m2": None if several is None else several * cell_m2,
        "left_out_m2": left_out_m2,
    }


def _measured(dense: DenseSurface, values: np.ndarray[Any, np.dtype[np.float32]]) -> np.ndarray[Any, Any]:
    """Return the finite values of the measured cells; no more than these is copied."""
    known = np.empty(sum(int(_finite(dense, values, band).sum()) for band in bands(values.shape)), dtype=np.float32)
    start = 0
    for band in bands(values.shape):
        part = values[band][_finite(dense, values, band)]
        known[start : start + len(part)] = part
        start += len(part)
    return known


def _finite(dense: DenseSurface, values: np.ndarray[Any, Any], band: slice) -> np.ndarray[Any, np.dtype[np.bool_]]:
    return np.asarray(dense.measured(band) & np.isfinite(values[band]))


def overlap_on_surface(overlap: OverlapRecord, dense: DenseRecord) -> OverlapRecord:
    """Return the key `block.overlap` of report.json with area and share of the surface in plan, which counts what was
    looked up in finer cells and knows what hides."""
    twice, several = dense["cells"]["seen_2_or_more"], dense["cells"]["seen_3_or_more"]
    if not twice or several is None:
        return overlap
    return {**overlap, "area_m2": dense["areas"]["mapped_m2"], "share_3_or_more": several / twice}


def water_numbers(areas: Sequence[WaterAreaRecord], cells: CellsRecord) -> WaterRecord:
    """Return the key `dense.water` of report.json: the cells on water, and their share of those that are mapped."""
    share = cells["water"] / cells["mapped"] if cells["mapped"] else None
    return {"cells": cells["water"], "share": share, "areas": list(areas)}


def orthophoto_numbers(orthophoto: OrthophotoPicture) -> OrthophotoRecord:
    """Return the key `orthophoto` of report.json: size, which part of it shows anything, and its rim."""
    rows, columns = orthophoto.source_shape
    covered = float(np.mean(orthophoto.rgba[..., 3] > 0))
    return {
        "cell_m": orthophoto.source_cell_m,
        "rows": rows,
        "columns": columns,
        "covered": covered,
        "rim": orthophoto.rim,
    }


# ---- the surface at the check points -------------------------------------------------------------------------------


def surface_check_numbers(dense: DenseSurface, ground: GroundMarks, *, upright: bool = False) -> SurfaceCheckRecord:
    """Return the heights of the surface, interpolated bilinearly, minus those of the points that are checks in height.

    Control points never enter: the adjustment was fitted to them. The standard deviation of a difference is
    √(σ_surface² + σ_survey² + (∂h/∂E σ_E)² + (∂h/∂N σ_N)²), since the surveyor's error in plan is one in height on a
    slope. A point over a hole or a filled cell does not test the surface, and is named with the reason.
    """
    checks = ground.select(ground.checks_height)
    at = sampled(dense, checks.place_map_m[:, :2])
    known = np.isfinite(at.height_m)
    difference_m = at.height_m - checks.place_map_m[:, 2]
    survey_m = np.hypot(checks.sigma_m[:, 2], np.hypot(*(at.slope * checks.sigma_m[:, :2]).T))
    sigma_m = np.hypot(at.sigma_m, survey_m)
    with np.errstate(invalid="ignore", divide="ignore"):
        z = difference_m / sigma_m
    reason = np.where(at.filled, "its cells are filled, not measured", "it lies in a hole")
    reason = np.where(at.inside, reason, "it lies outside the surface")
    stated_m = np.where(checks.sigma_assumed, np.nan, survey_m)
    summary = _summary(difference_m[known], stated_m[known], z[known])
    points: list[SurfacePointRecord] = [
        {
            "name": checks.name[i],
            "surveyed_m": float(checks.place_map_m[i, 2]),
            "surface_m": float(at.height_m[i]),
            "difference_m": float(difference_m[i]),
            "sigma_m": float(at.sigma_m[i]),
            "survey_sigma_m": float(survey_m[i]),
            "z": float(z[i]) if np.isfinite(z[i]) else None,
        }
        for i in np.flatnonzero(known).tolist()
    ]
    not_tested: list[UntestedPointRecord] = [
        {"name": checks.name[i], "reason": str(reason[i])} for i in np.flatnonzero(~known).tolist()
    ]
    sentence = _sentence(summary, points, not_tested, "across the plane" if upright else "in height")
    return {**summary, "points": points, "not_tested": not_tested, "sentence": sentence}


def _summary(difference_m: FloatArray, survey_m: FloatArray, z: FloatArray) -> SurfaceSummaryRecord:
    """Return n and, from FEWEST_CHECKS on, mean, RMSE and normalised RMS of differences (n,), null before; ``survey_m``
    (n,) is NaN where nobody has stated it."""
    n = len(difference_m)
    if n < FEWEST_CHECKS:
        return {
            "n": n,
            "mean_m": None,
            "sd_m": None,
            "rmse_m": None,
            "survey_rmse_m": None,
            "rmse_v_m": None,
            "rms_z": None,
        }
    plan = np.full((n, 2), np.nan)
    accuracy = asprs_accuracy(np.column_stack([plan, difference_m]), np.column_stack([plan, survey_m]))
    height, tested = accuracy.axes[2], z[np.isfinite(z)]
    return {
        "n": n,
        "mean_m": height.mean_m,
        "sd_m": height.sd_m,
        "rmse_m": height.rmse_m,
        "survey_rmse_m": finite(accuracy.survey_v_m),
        "rmse_v_m": finite(accuracy.rmse_v_m),
        "rms_z": float(np.sqrt(np.mean(tested**2))) if len(tested) else None,
    }


def _sentence(
    summary: SurfaceSummaryRecord,
    points: list[SurfacePointRecord],
    not_tested: list[UntestedPointRecord],
    where: str,
) -> str:
    n = summary["n"]
    if not n:
        why = f" ({len(not_tested)} lie beside it or in holes)" if not_tested else ""
        return (
            f"no check point lies on a measured part of the dense surface{why}: its heights are predicted, not tested"
        )
    if n < FEWEST_CHECKS:
        differences = " and ".join(f"{p['name']} {p['difference_m']:+.3f} m" for p in points).replace("-", "−")
        return f"the dense surface is tested by {differences} only: too few check points for an RMSE"
    few = f"; the standard requires at least {MINIMUM_POINTS} check points" if n < MINIMUM_POINTS else ""
    mean = f"{summary['mean_m']:+.3f}".replace("-", "−")
    times = "" if summary["rms_z"] is None else f", {summary['rms_z']:.2g} times the predicted sigmas"
    return f"the dense surface at {n} check points: RMSE {summary['rmse_m']:.3f} m, mean {mean} m {where}{times}{few}"


def _warnings(check_points: SurfaceCheckRecord) -> list[str]:
    rms_z = check_points["rms_z"]
    if rms_z is None or not math.isfinite(rms_z) or rms_z <= REFUTED_RMS_Z:
        return []
    return [
        f"the heights of the dense surface at {check_points['n']} check points are off by {rms_z:.2g} times their "
        "predicted standard deviations: do not rely on dsm_sigma.tif here; examine the profiles and single points"
    ]


# ---- the orthophoto at the check points ----------------------------------------------------------------------------


def checks_plan(point: GroundPointRecord) -> bool:
    """Return whether a ground point tests the plan: no coordinate in plan took part in the adjustment."""
    return point["axis_roles"][:2] == ["check", "check"]


def orthophoto_check_numbers(
    points: list[GroundPointRecord], targets: Mapping[str, LocatedTarget | str], *, upright: bool = False
) -> OrthophotoCheckRecord:
    """Return by how much the orthophoto shows the targets of check points off their surveyed places.

    ``targets`` are the targets by the name of their point, or why one was not found; places of both are those on the
    plane of an ``upright`` surface. Control points never enter: the adjustment was fitted to them.
    """
    rows, not_tested = list[OrthophotoPointRecord](), list[UntestedPointRecord]()
    for point in points:
        target = targets.get(point["name"])
        if target is None or not checks_plan(point):
            continue
        if isinstance(target, str):
            not_tested.append({"name": point["name"], "reason": target})
            continue
        off_m = target.place_map_m - np.array(point["surveyed_map_m"][:2])
        rows.append(
            {
                "name": point["name"],
                "found_map_m": target.place_map_m.tolist(),
                "difference_m": off_m.tolist(),
                "survey_sigma_m": [float(s or 0.0) for s in point["surveyed_sigma_m"][:2]],
                "correlation": target.correlation,
                "marks": target.marks,
            }
        )
    n = len(rows)
    record: OrthophotoCheckRecord = {
        "n": n,
        "mean_m": None,
        "rmse_m": None,
        "fit_rmse_h_m": None,
        "survey_rmse_h_m": None,
        "rmse_h_m": None,
        "points": rows,
        "not_tested": not_tested,
        "sentence": "",
    }
    if n >= FEWEST_CHECKS:
        difference_m, sigma_m = (np.array([r[key] for r in rows]) for key in ("difference_m", "survey_sigma_m"))
        of_row = {point["name"]: point for point in points}
        sigma_m[is_assumed([of_row[r["name"]] for r in rows])] = np.nan
        nothing = np.full((n, 1), np.nan)
        tested = asprs_accuracy(np.hstack([difference_m, nothing]), np.hstack([sigma_m, nothing]))
        record["mean_m"] = [tested.axes[0].mean_m, tested.axes[1].mean_m]
        record["rmse_m"] = [tested.axes[0].rmse_m, tested.axes[1].rmse_m]
        record["fit_rmse_h_m"], record["survey_rmse_h_m"] = tested.fit_h_m, finite(tested.survey_h_m)
        record["rmse_h_m"] = finite(tested.rmse_h_m)
    record["sentence"] = _plan_sentence(record, upright)
    return record


def _plan_sentence(record: OrthophotoCheckRecord, upright: bool) -> str:
    n, missing = record["n"], len(record["not_tested"])
    missed = f"; {missing} more {'was' if missing == 1 else 'were'} not found in it" if missing else ""
    if not n:
        return f"none of {missing} targets of check points was found in the orthophoto: it is not tested in plan"
    if record["fit_rmse_h_m"] is None or record["mean_m"] is None:
        names = " and ".join(row["name"] for row in record["points"])
        return f"the orthophoto shows {names} only: too few check points for an RMSE{missed}"
    few = f"; the standard requires at least {MINIMUM_POINTS} check points" if n < MINIMUM_POINTS else ""
    east, north = (f"{m:+.3f}".replace("-", "−") for m in record["mean_m"])
    where, right, up = ("along the plane", "to the right", "up") if upright else ("in plan", "east", "north")
    return (
        f"the orthophoto at {n} check points whose targets it shows: RMSE {record['fit_rmse_h_m']:.3f} m {where}, mean "
        f"{east} m {right}, {north} m {up}{missed}{few}"
    )
