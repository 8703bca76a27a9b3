"""The numbers of report.json. Its keys are kept stable: scripts rely on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from photogram.adjustment.oriented_subset import registered_block
from photogram.adjustment.reliability import CRITICAL, minimal_detectable_blunder
from photogram.arrays import FloatArray
from photogram.camera import Pose, omega_phi_kappa_deg
from photogram.factors.common_errors import common_shifts
from photogram.geodesy.frames import LocalFrame
from photogram.measures.ground_sampling import photographs_ground_sampling_m
from photogram.measures.mark_covariances import is_isotropic, lower_factors, semi_axes
from photogram.projection import PARAMETER_NAMES
from photogram.quality.accuracy import check_accuracy, suspects
from photogram.quality.cloud_comparison import Comparison
from photogram.quality.prediction_test import checked_axes
from photogram.report.components import component_numbers
from photogram.report.numbers.diagnosis import diagnosis_numbers
from photogram.report.numbers.overlap import Overlap
from photogram.report.numbers.statistics import consistency_numbers
from photogram.report.numbers.verdicts import NO_BLUNDERS, RejectedBlunders, control_test, control_verdict
from photogram.report.record.block import (
    AdjustmentRecord,
    BlockRecord,
    CameraRecord,
    DecisionRecord,
    EffortRecord,
    LensFieldRecord,
    OverlapRecord,
    RollingShutterRecord,
    ScaleFactorsRecord,
    UnitsRecord,
    WorldRecord,
)
from photogram.report.record.ground import (
    AxisRole,
    BlunderRecord,
    CheckPointsRecord,
    GroundPointRecord,
    MarkRecord,
    SuspectRecord,
)
from photogram.report.record.photographs import (
    OrientedPhotograph,
    PhotographRecord,
    ResectedPoseRecord,
    ResectionRecord,
)
from photogram.report.record.report import AdjustedNumbers
from photogram.report.record.surfaces import CloudRecord, DifferencesRecord
from photogram.report.values import finite, finites, record_of
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.survey import ControlPoints, Photograph, PointCloud

FixedParameters = Mapping[str, Mapping[str, str]]
"""Why parameters are fixed, by the names of the camera and of the parameter."""

MarkKinds = Mapping[tuple[str, str], str]
"""How marks were measured, by the names of the point and of the photograph."""


@dataclass(frozen=True)
class RejectedAttitudes:
    """How many measured attitudes and headings contradict the tie points and were not used."""

    attitudes: int = 0
    headings: int = 0


NONE_REJECTED = RejectedAttitudes()
NOT_ADJUSTED = "none of its observations was adjusted"


def _map(frame: LocalFrame, position_world_m: FloatArray) -> FloatArray:
    return np.asarray(frame.map_from_world(position_world_m[None])[0])


def _sigma_map_m(frame: LocalFrame, position_world_m: FloatArray, covariance_m2: FloatArray) -> list[float]:
    """Standard deviations along easting, northing and up of a position with a covariance (3, 3) in the world frame."""
    R = frame.rotation_world_from_map(position_world_m)
    return [float(s) for s in np.sqrt(np.diag(R.T @ covariance_m2 @ R))]


def _resection(frame: LocalFrame, photograph: Photograph, resection: Resection, names: list[str]) -> ResectionRecord:
    def place(pose: Pose) -> ResectedPoseRecord:
        rotation = pose.rotation_world_from_camera.T @ frame.rotation_world_from_map(pose.position_world_m)
        value: ResectedPoseRecord = {
            "position_map_m": _map(frame, pose.position_world_m).tolist(),
            "omega_phi_kappa_deg": omega_phi_kappa_deg(rotation.T).tolist(),
        }
        if photograph.gnss_world_m is not None:
            difference = _map(frame, pose.position_world_m) - _map(frame, photograph.gnss_world_m)
            value["gnss_difference_m"] = float(np.linalg.norm(difference))
            value["gnss_difference_map_m"] = difference.tolist()
        return value

    return {
        "method": f"P3P from {', '.join(names[i] for i in resection.points)}",
        **place(resection.p3p),
        "solutions": resection.solutions,
        "check_px": resection.check_px,
        "refined": {
            **place(resection.refined),
            "marks": int(resection.inliers.sum()),
            "residual_px": resection.residual_px.tolist(),
        },
    }


def gnss_residual_m(result: Adjustment) -> FloatArray:
    """Return adjusted projection centre − (GNSS position + lever arm + common errors) of every photograph (N, 3):
    easting, northing, height; NaN rows for photographs without a GNSS position and for those that are not registered.
    """
    photographs, frame = result.block.photographs, result.block.frame
    centre, expected = np.full((len(photographs), 3), np.nan), np.full((len(photographs), 3), np.nan)
    offset = dict(zip(result.estimates.flights, result.estimates.offset_world_m, strict=True))
    shifts = iter(common_shifts(registered_block(result.block)[0]))
    for i, (photograph, pose) in enumerate(zip(photographs, result.block.poses, strict=True)):
        if pose is None:
            continue
        shift, measured = next(shifts), photograph.measured_centre_world_m(pose.rotation_world_from_camera)
        if measured is not None:
            centre[i] = pose.position_world_m
            expected[i] = measured + offset.get(photograph.flight, np.zeros(3)) + shift
    return frame.map_from_world(centre) - frame.map_from_world(expected)


def photograph_numbers(result: Adjustment, orientation: Orientation) -> dict[str, PhotographRecord]:
    """Return exterior orientation, sigmas and resection of every photograph; of those that are not registered, why."""
    block = result.block
    frame = result.block.frame
    reliability = result.tests.reliability
    control = block.control_points.fully_controlled()
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    gsd_m, residual_m = photographs_ground_sampling_m(result.block), gnss_residual_m(result)
    numbers: dict[str, PhotographRecord] = {}
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        camera = block.cameras[photograph.camera].name
        if pose is None:
            left_out = result.decisions.reason[i] if result.decisions.reason else ""
            numbers[photograph.name] = {
                "camera": camera,
                "registered": False,
                "reason": orientation.reason[i] or left_out or NOT_ADJUSTED,
                "tie_points": 0,
                "gnss_residual_m": None,
            }
            continue
        rotation = pose.rotation_world_from_camera.T @ frame.rotation_world_from_map(pose.position_world_m)
        sigma_m = np.full(3, np.nan) if photograph.gnss_sigma_m is None else photograph.gnss_sigma_m
        gnss = _tested(reliability.gnss_redundancy[i], reliability.gnss_w[i], sigma_m)
        entry: OrientedPhotograph = {
            "camera": camera,
            "registered": True,
            "reason": None,
            "position_map_m": _map(frame, pose.position_world_m).tolist(),
            "sigma_m": _sigma_map_m(frame, pose.position_world_m, result.covariances.position_m2[i]),
            "omega_phi_kappa_deg": omega_phi_kappa_deg(rotation.T).tolist(),
            "sigma_attitude_deg": np.rad2deg(np.sqrt(np.diag(result.covariances.rotation_rad2[i]))).tolist(),
            "rotation_camera_from_map": rotation.tolist(),
            "tie_points": int(rays[i]),
            "gsd_m": float(gsd_m[i]),
            "gnss_residual_m": residual_m[i].tolist() if np.isfinite(residual_m[i]).all() else None,
            "gnss_redundancy": gnss.redundancy,
            "gnss_w": gnss.w,
            "gnss_mdb_m": gnss.mdb,
            "gnss_suspect": gnss.suspect,
        }
        resection = orientation.resections[i]
        if resection is not None:
            names = [control.name[g] for g in control.mark_point[control.mark_photograph == i]]
            entry["resection"] = _resection(frame, photograph, resection, names)
        numbers[photograph.name] = entry
    return numbers


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values))) if len(values) else None


def _overlap(overlap: Overlap) -> OverlapRecord:
    counts = overlap.counts
    return {
        "median": float(np.median(counts)) if len(counts) else 0.0,
        "mean": float(counts.mean()) if len(counts) else 0.0,
        "share_2_or_more": overlap.share_amid,
        "share_3_or_more": overlap.share(3),
        "area_m2": overlap.area_m2,
        "cell_m": overlap.photographs.cell_m,
    }


def block_numbers(result: Adjustment, orientation: Orientation, overlap: Overlap | None) -> BlockRecord:
    """Return what describes the block as a whole; ``overlap`` is None where the tie points span no area."""
    block, tie = result.block, result.block.tie_points
    names = np.array(block.photograph_names)
    components = [
        names[orientation.component == c].tolist() for c in range(int(orientation.component.max(initial=-1)) + 1)
    ]
    gsd_m, residual_m = photographs_ground_sampling_m(result.block), gnss_residual_m(result)
    squares = residual_m[np.isfinite(residual_m).all(axis=1)] ** 2
    return {
        "registered": int(block.registered.sum()),
        "photographs": len(block.photographs),
        "components": components,
        "component_sizes": [len(component) for component in components],
        "component_ties": component_numbers(result, orientation),
        "method": orientation.method,
        "gsd_m": float(np.nanmedian(gsd_m)) if np.isfinite(gsd_m).any() else None,
        "overlap": None if overlap is None else _overlap(overlap),
        "mean_track_length": len(tie.photograph) / len(tie) if len(tie) else None,
        "tie_points": len(tie),
        "observations": len(tie.photograph),
        "gnss_residual_rms_m": {
            "plan": _rms(squares[:, :2].sum(axis=1)),
            "height": _rms(squares[:, 2]),
            "three_d": _rms(squares.sum(axis=1)),
        },
    }


def camera_numbers(
    result: Adjustment,
    fixed: FixedParameters,
    sources: Sequence[str],
    focal_lengths: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, CameraRecord]:
    """Return the interior orientation of every camera, the sigmas of its free parameters (null where it was fixed) and
    what was known before; ``sources`` by camera, or empty; ``focal_lengths`` what was decided where the photographs
    contradict the source."""
    numbers: dict[str, CameraRecord] = {}
    for c, camera in enumerate(result.block.cameras):
        sigma = np.sqrt(np.diag(result.covariances.calibration[c]))
        free = (camera.sigmas > 0) & (sigma > 0)
        field = result.decisions.lens_fields[c] if result.decisions.lens_fields else None
        numbers[camera.name] = record_of(
            CameraRecord,
            camera,
            sigma={n: float(s) if f else None for n, s, f in zip(PARAMETER_NAMES, sigma, free, strict=True)},
            prior_sigma=dict(zip(PARAMETER_NAMES, finites(camera.sigmas), strict=True)),
            held=dict(fixed.get(camera.name, {})),
            focal_length=focal_lengths.get(camera.name),
            source=(sources[c] or None) if sources else None,
            lens_field=None if field is None else record_of(LensFieldRecord, field, why=field.why or None),
            rolling_shutter=_rolling_shutter(result, c),
        )
    return numbers


def _rolling_shutter(result: Adjustment, camera: int) -> RollingShutterRecord | None:
    """Return what was found of a read-out time, None where the camera has none and none was looked for."""

    def of_camera(values: FloatArray) -> float | None:
        return finite(values[camera]) if len(values) else None

    estimate_s = of_camera(result.decisions.readout_s)
    if estimate_s is None and result.block.cameras[camera].readout_s == 0.0:
        return None
    return {
        "estimate_s": estimate_s,
        "sigma_s": of_camera(result.decisions.readout_sigma_s),
        "focal_correlation": of_camera(result.decisions.readout_focal_correlation),
        "time_offset_correlation": of_camera(result.decisions.readout_time_offset_correlation),
        "neighbours_scatter_m_s": finite(result.decisions.neighbours_scatter_m_s),
    }


@dataclass(frozen=True)
class _Tested:
    """Redundancy numbers, w-tests and minimal detectable blunders along the axes of a measurement, and whether it is
    suspect; None where it is not tested."""

    redundancy: list[float | None] | None = None
    w: list[float | None] | None = None
    mdb: list[float | None] | None = None
    suspect: bool | None = None


def _tested(redundancy: FloatArray, w: FloatArray, sigma: FloatArray) -> _Tested:
    """Return the tests of a measurement; blunders are in the unit of its ``sigma``."""
    if not np.isfinite(redundancy).any():
        return _Tested()
    mdb = minimal_detectable_blunder(sigma, redundancy)
    return _Tested(finites(redundancy), finites(w), finites(mdb), bool(np.any(np.abs(w) > CRITICAL)))


@dataclass(frozen=True)
class _Predicted:
    """Of a control point the effect of a blunder that just escapes its tests on the adjusted coordinates, and what
    everything else predicts for it minus what was surveyed, m; None for check points."""

    effect_m: list[float | None] | None = None
    left_out_m: list[float | None] | None = None
    left_out_sigma_m: list[float | None] | None = None


def _predicted(result: Adjustment, g: int) -> _Predicted:
    r, sigma_m = result.tests.reliability, result.block.control_points.sigma_m[g]
    if not np.isfinite(r.ground_redundancy[g]).any():
        return _Predicted()
    effect_m = minimal_detectable_blunder(sigma_m, r.ground_redundancy[g]) * (1.0 - r.ground_redundancy[g])
    spread_m = np.sqrt(np.diag(r.ground_left_out_covariance_m2[g]))
    if not np.isfinite(spread_m).any():
        return _Predicted(finites(effect_m))
    return _Predicted(finites(effect_m), finites(r.ground_left_out_m[g]), finites(spread_m))


def _axis_roles(measured: ControlPoints, used: ControlPoints, g: int) -> list[AxisRole]:
    """Return the role of a ground point along its axes: control, check, or left out of the adjustment, and of what is
    compared with it."""
    checked = checked_axes(measured)[g]
    return [
        "control" if part else "check" if check else "left out"
        for part, check in zip(used.used[g], checked, strict=True)
    ]


def ground_numbers(
    result: Adjustment,
    blunders: Sequence[BlunderRecord],
    measured: ControlPoints | None,
    mark_kinds: MarkKinds,
) -> list[GroundPointRecord]:
    """Return surveyed and adjusted positions of all ground points; check points took no part in the adjustment.

    ``measured`` are the points as they were given, with what was left out of the adjustment, ``mark_kinds`` how their
    marks were measured, where that is known.
    """
    frame, used = result.block.frame, result.block.control_points
    points = used if measured is None else measured
    r, numbers = result.tests.reliability, list[GroundPointRecord]()
    for g, name in enumerate(points.name):
        surveyed = _map(frame, points.position_world_m[g])
        known = bool(np.isfinite(result.estimates.ground_world_m[g]).all())
        adjusted = _map(frame, result.estimates.ground_world_m[g])
        marks = np.flatnonzero(points.mark_point == g).tolist()
        tested, predicted = _tested(r.ground_redundancy[g], r.ground_w[g], used.sigma_m[g]), _predicted(result, g)
        numbers.append(
            {
                "name": name,
                "role": points.role[g],
                "axis_roles": _axis_roles(points, used, g),
                "surveyed_map_m": surveyed.tolist(),
                "surveyed_sigma_m": finites(points.sigma_m[g]),
                "surveyed_sigma_assumed": bool(points.sigma_assumed[g]),
                "adjusted_map_m": adjusted.tolist() if known else None,
                "residual_m": (adjusted - surveyed).tolist() if known else None,
                "sigma_m": [*_sigma_map_m(frame, result.estimates.ground_world_m[g], result.covariances.ground_m2[g])]
                if known
                else None,
                "redundancy": tested.redundancy,
                "w": tested.w,
                "mdb_m": tested.mdb,
                "suspect": tested.suspect,
                "effect_m": predicted.effect_m,
                "left_out_m": predicted.left_out_m,
                "left_out_sigma_m": predicted.left_out_sigma_m,
                "chi2": control_test(r.ground_left_out_m[g], r.ground_left_out_covariance_m2[g]),
                "verdict": control_verdict(result, g, blunders),
                "marks": [_mark(result, points, m, mark_kinds) for m in marks],
                "z": None,
                "mahalanobis": None,
            }
        )
    return numbers


def _mark(result: Adjustment, points: ControlPoints, m: int, kinds: MarkKinds) -> MarkRecord:
    reliability, residual_px = result.tests.reliability, result.estimates.mark_residual_px[m]
    covariance, sigma_px = points.mark_covariance_px2[m][None], points.mark_sigma_px[m]
    used = result.block.control_points.mark_covariance_px2[m][None]
    whitened_px = np.diag(lower_factors(used if np.isfinite(used).all() else covariance)[0])
    tested = _tested(reliability.mark_redundancy[m], reliability.mark_w[m], whitened_px)
    photograph = result.block.photographs[points.mark_photograph[m]].name
    entry: MarkRecord = {
        "photograph": photograph,
        "left_out": bool(np.isinf(result.block.control_points.mark_sigma_px[m])),
        "pixel": points.mark_pixel[m].tolist(),
        "residual_px": residual_px.tolist() if np.isfinite(residual_px).all() else None,
        "redundancy": tested.redundancy,
        "w": tested.w,
        "mdb_px": tested.mdb,
        "suspect": tested.suspect,
    }
    if np.isfinite(sigma_px):
        entry["sigma_px"] = float(sigma_px)
    if not is_isotropic(covariance).all():
        axes_px, direction = semi_axes(covariance)
        entry["semi_axes_px"], entry["direction_deg"] = axes_px[0].tolist(), float(np.degrees(direction[0]))
    kind = kinds.get((points.name[points.mark_point[m]], photograph))
    if kind is not None:
        entry["kind"] = kind
    return entry


def check_numbers(points: list[GroundPointRecord]) -> CheckPointsRecord:
    """Summarise the differences of the check points: control points never enter here."""
    rows = [
        [d if role == "check" else np.nan for d, role in zip(p["residual_m"], p["axis_roles"], strict=True)]
        for p in points
        if p["residual_m"] is not None
    ]
    accuracy = check_accuracy(np.array(rows).reshape(-1, 3))
    return {
        "n": accuracy.n,
        "n_axis": list(accuracy.n_axis),
        "rmse_m": list(accuracy.rmse_m),
        "mean_m": list(accuracy.mean_m),
        "rmse_h_m": accuracy.rmse_h_m,
        "rmse_v_m": accuracy.rmse_v_m,
    }


def adjustment_numbers(
    result: Adjustment, seconds: float, rejected: RejectedAttitudes, effort: Sequence[EffortRecord] = ()
) -> AdjustmentRecord:
    """Return what the joint adjustment says of itself; GNSS offsets along easting, northing and up. ``effort`` is that
    of its decisions, none where it was not counted."""
    residual = np.sum(result.estimates.residual_px**2, axis=1)
    rays = result.block.tie_points.rays
    axes = result.block.frame.rotation_world_from_map(np.zeros(3))
    record: AdjustmentRecord = {
        "sigma0": result.sigma0,
        "redundancy": result.redundancy,
        "reprojection_rms_px": float(np.sqrt(residual.mean())) if len(residual) else None,
        "tie_points": len(result.block.tie_points),
        "tie_points_by_rays": {str(n): int(np.count_nonzero(rays == n)) for n in np.unique(rays)},
        "observations": len(residual),
        "discarded_observations": result.decisions.rejected_observations,
        "discarded_tie_points": result.decisions.rejected_points,
        "iterations": result.iterations,
        "rounds": result.rounds,
        "converged": result.converged,
        "gnss_offsets": {
            flight: {
                "offset_m": (axes.T @ result.estimates.offset_world_m[f]).tolist(),
                "sigma_m": np.sqrt(np.diag(axes.T @ result.covariances.offset_m2[f] @ axes)).tolist(),
            }
            for f, flight in enumerate(result.estimates.flights)
        },
        "seconds": seconds,
        "disbelieved_attitudes": rejected.attitudes,
        "rejected_headings": rejected.headings,
    }
    if effort:
        record["effort"] = list(effort)
    if result.decisions.made:
        record["decisions"] = [record_of(DecisionRecord, decision) for decision in result.decisions.made]
    return record


def _cloud(cloud: PointCloud, comparison: Comparison | None) -> CloudRecord:
    if comparison is None:
        return {"points": len(cloud), "mean_m": None, "std_m": None, "median_m": None, "nmad_m": None}
    surface = comparison.cloud_to_surface
    return {
        "points": len(cloud),
        "compared": surface.compared,
        "removed_by_sor": comparison.removed,
        "mean_m": surface.mean_m,
        "std_m": surface.std_m,
        "median_m": surface.median_m,
        "nmad_m": surface.nmad_m,
        "cloud_to_cloud": record_of(DifferencesRecord, comparison.cloud_to_cloud),
    }


def cloud_numbers(clouds: Mapping[str, PointCloud], comparisons: Mapping[str, Comparison]) -> dict[str, CloudRecord]:
    """Return the size of every cloud and its differences from the reference, null where there is none."""
    return {name: _cloud(cloud, comparisons.get(name)) for name, cloud in clouds.items()}


def world_numbers(result: Adjustment) -> WorldRecord:
    """Return the frame of the adjustment; of a map its units and, at the middle of the tie points, its scale."""
    frame, ties = result.block.frame, result.block.tie_points
    record: WorldRecord = {"kind": frame.kind, "origin_map_m": list(frame.origin_map_m)}
    if frame.is_local:
        return record
    record["units"] = record_of(UnitsRecord, frame.units)
    if len(ties.position_world_m):
        middle = frame.map_from_world(np.median(ties.position_world_m, axis=0)[None])[0]
        record["scale_factors"] = record_of(ScaleFactorsRecord, frame.combined_scale(middle))
    return record


def report_numbers(
    result: Adjustment,
    orientation: Orientation,
    clouds: Mapping[str, PointCloud],
    comparisons: Mapping[str, Comparison],
    overlap: Overlap | None,
    *,
    version: str,
    seconds: Mapping[str, float],
    fixed: FixedParameters = MappingProxyType({}),
    sources: Sequence[str] = (),
    blunders: RejectedBlunders = NO_BLUNDERS,
    rejected: RejectedAttitudes = NONE_REJECTED,
    measured: ControlPoints | None = None,
    mark_kinds: MarkKinds = MappingProxyType({}),
    effort: Sequence[EffortRecord] = (),
) -> AdjustedNumbers:
    """Return what report.json says of an adjusted block.

    ``seconds`` holds the time of every stage, ``fixed`` why parameters of a camera were fixed, ``sources`` where the
    calibration of each camera comes from, empty texts where that is not known, ``blunders`` those that were rejected,
    ``rejected`` the attitudes that the adjustment did not use, ``measured`` the ground points as they were given,
    ``mark_kinds`` how their marks were measured, ``effort`` the work for each decision of the adjustment.
    """
    frame = result.block.frame
    points = ground_numbers(result, blunders.blunders, measured, mark_kinds)
    consistency = consistency_numbers(result, points)
    return {
        "photogram": version,
        "crs": frame.crs,
        "world": world_numbers(result),
        "block": block_numbers(result, orientation, overlap),
        "photographs": photograph_numbers(result, orientation),
        "cameras": camera_numbers(result, fixed, sources, blunders.focal_lengths),
        "adjustment": adjustment_numbers(result, seconds["adjustment"], rejected, effort),
        "control_points": points,
        "check_points": check_numbers(points),
        "blunders": list(blunders.blunders),
        "blunders_effect": blunders.effect,
        "predicted_against_achieved": consistency.predicted_against_achieved,
        "leave_one_out": consistency.leave_one_out,
        "variance_components": consistency.variance_components,
        "estimated_sigmas": consistency.estimated_sigmas,
        "suspects": [record_of(SuspectRecord, suspect) for suspect in suspects(result)],
        "diagnosis": diagnosis_numbers(result, orientation.resections),
        "clouds": cloud_numbers(clouds, comparisons),
        "seconds": dict(seconds),
    }
