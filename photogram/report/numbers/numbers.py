"""The numbers of report.json. Its keys are kept stable: scripts rely on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np

from photogram.adjustment.reliability import CRITICAL, minimal_detectable_blunder
from photogram.arrays import FloatArray
from photogram.camera import Pose, omega_phi_kappa_deg
from photogram.frames import LocalFrame
from photogram.projection import PARAMETER_NAMES
from photogram.quality.accuracy import check_accuracy, suspects
from photogram.quality.cloud_comparison import Comparison
from photogram.report.numbers.diagnosis import diagnosis_numbers
from photogram.report.numbers.overlap import Overlap, ground_sampling_distance_m
from photogram.report.numbers.statistics import consistency_numbers
from photogram.report.numbers.verdicts import control_test, control_verdict, effect_sentence
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.survey import ControlPoints, Photograph, PointCloud

Json = dict[str, Any]
Held = Mapping[str, Mapping[str, str]]
"""Why parameters are held, by the names of the camera and of the parameter."""

NOT_ADJUSTED = "none of its observations was adjusted"


def _map(frame: LocalFrame, position_world_m: FloatArray) -> FloatArray:
    return np.asarray(frame.map_from_world(position_world_m[None])[0])


def _sigma_map_m(frame: LocalFrame, position_world_m: FloatArray, covariance_m2: FloatArray) -> list[float]:
    """Standard deviations along easting, northing and up of a position with a covariance (3, 3) in the world frame."""
    R = frame.rotation_world_from_map(position_world_m)
    return [float(s) for s in np.sqrt(np.diag(R.T @ covariance_m2 @ R))]


def _difference_map_m(frame: LocalFrame, position_world_m: FloatArray, reference_world_m: FloatArray) -> FloatArray:
    return _map(frame, position_world_m) - _map(frame, reference_world_m)


def _resection(frame: LocalFrame, photograph: Photograph, resection: Resection, names: list[str]) -> Json:
    def place(pose: Pose) -> Json:
        value: Json = {"position_map_m": _map(frame, pose.position_world_m).tolist()}
        if photograph.gnss_world_m is not None:
            difference = _difference_map_m(frame, pose.position_world_m, photograph.gnss_world_m)
            value["gnss_difference_m"] = float(np.linalg.norm(difference))
            value["gnss_difference_map_m"] = difference.tolist()
        rotation = pose.rotation_world_from_camera.T @ frame.rotation_world_from_map(pose.position_world_m)
        value["omega_phi_kappa_deg"] = omega_phi_kappa_deg(rotation.T).tolist()
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
    """Return adjusted projection centre − (GNSS position + lever arm + flight's offset) of every photograph (N, 3):
    easting, northing, height; NaN rows for photographs without a GNSS position and for those that are not registered.
    """
    photographs, frame = result.block.photographs, result.block.frame
    centre, expected = np.full((len(photographs), 3), np.nan), np.full((len(photographs), 3), np.nan)
    offset = dict(zip(result.flights, result.offset_world_m, strict=True))
    for i, (photograph, pose) in enumerate(zip(photographs, result.block.poses, strict=True)):
        measured = None if pose is None else photograph.measured_centre_world_m(pose.rotation_world_from_camera)
        if pose is not None and measured is not None:
            centre[i] = pose.position_world_m
            expected[i] = measured + offset.get(photograph.flight, np.zeros(3))
    return frame.map_from_world(centre) - frame.map_from_world(expected)


def _exterior(result: Adjustment, index: int, pose: Pose) -> Json:
    frame = result.block.frame
    rotation = pose.rotation_world_from_camera.T @ frame.rotation_world_from_map(pose.position_world_m)
    return {
        "position_map_m": _map(frame, pose.position_world_m).tolist(),
        "sigma_m": _sigma_map_m(frame, pose.position_world_m, result.position_covariance_m2[index]),
        "omega_phi_kappa_deg": omega_phi_kappa_deg(rotation.T).tolist(),
        "sigma_attitude_deg": np.rad2deg(np.sqrt(np.diag(result.rotation_covariance_rad2[index]))).tolist(),
        "rotation_camera_from_map": rotation.tolist(),
    }


def photograph_numbers(result: Adjustment, orientation: Orientation) -> Json:
    """Return exterior orientation, sigmas and resection of every photograph; of those that are not registered, why."""
    block, frame = result.block, result.block.frame
    control = block.control_points.fully_controlled()
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    gsd_m, residual_m = ground_sampling_distance_m(result), gnss_residual_m(result)
    numbers: Json = {}
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        entry: Json = {"camera": block.cameras[photograph.camera].name, "registered": pose is not None}
        numbers[photograph.name] = entry
        if pose is None:
            left_out = result.reason[i] if result.reason else ""
            entry.update(reason=orientation.reason[i] or left_out or NOT_ADJUSTED, tie_points=0, gnss_residual_m=None)
            continue
        entry.update(reason=None, **_exterior(result, i, pose), tie_points=int(rays[i]))
        entry["gsd_m"] = float(gsd_m[i])
        entry["gnss_residual_m"] = residual_m[i].tolist() if np.isfinite(residual_m[i]).all() else None
        sigma_m = np.full(3, np.nan) if photograph.gnss_sigma_m is None else photograph.gnss_sigma_m
        gnss = _tested("m", result.reliability.gnss_redundancy[i], result.reliability.gnss_w[i], sigma_m)
        entry.update({f"gnss_{name}": value for name, value in gnss.items()})
        resection = orientation.resections[i]
        if resection is not None:
            names = [control.name[g] for g in control.mark_point[control.mark_photograph == i]]
            entry["resection"] = _resection(frame, photograph, resection, names)
    return numbers


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values))) if len(values) else None


def _overlap(overlap: Overlap) -> Json:
    return {
        "median": float(np.median(overlap.counts)),
        "mean": float(overlap.counts.mean()),
        "share_2_or_more": overlap.share(2),
        "share_3_or_more": overlap.share(3),
        "area_m2": overlap.area_m2,
        "cell_m": overlap.photographs.cell_m,
    }


def block_numbers(result: Adjustment, orientation: Orientation, overlap: Overlap | None) -> Json:
    """Return what describes the block as a whole; ``overlap`` is None where the tie points span no area."""
    block, tie = result.block, result.block.tie_points
    names = np.array([photograph.name for photograph in block.photographs])
    components = [
        names[orientation.component == c].tolist() for c in range(int(orientation.component.max(initial=-1)) + 1)
    ]
    gsd_m, residual_m = ground_sampling_distance_m(result), gnss_residual_m(result)
    squares = residual_m[np.isfinite(residual_m).all(axis=1)] ** 2
    return {
        "registered": sum(pose is not None for pose in block.poses),
        "photographs": len(block.photographs),
        "components": components,
        "component_sizes": [len(component) for component in components],
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
    result: Adjustment, held: Held, sources: Sequence[str], focal_lengths: Mapping[str, str] = MappingProxyType({})
) -> Json:
    """Return the interior orientation of every camera, the sigmas of its free parameters (null where it was held) and
    what was known before; ``sources`` by camera, or empty; ``focal_lengths`` what was decided where the photographs
    contradict the source."""
    numbers: Json = {}
    for c, camera in enumerate(result.block.cameras):
        sigma = np.sqrt(np.diag(result.calibration_covariance[c]))
        free = (camera.sigmas > 0) & (sigma > 0)
        numbers[camera.name] = {
            "model": camera.model,
            "focal_px": camera.focal_px,
            "principal_point_px": camera.principal_point_px.tolist(),
            "radial": camera.radial.tolist(),
            "tangential": camera.tangential.tolist(),
            "affinity": camera.affinity.tolist(),
            "sigma": {n: float(s) if f else None for n, s, f in zip(PARAMETER_NAMES, sigma, free, strict=True)},
            "prior_sigma": {
                n: float(s) if np.isfinite(s) else None for n, s in zip(PARAMETER_NAMES, camera.sigmas, strict=True)
            },
            "held": dict(held.get(camera.name, {})),
            "focal_length": focal_lengths.get(camera.name),
            "source": (sources[c] or None) if sources else None,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
        }
    return numbers


def _tested(unit: str, redundancy: FloatArray, w: FloatArray, sigma: FloatArray) -> Json:
    """Return redundancy numbers, w-tests and minimal detectable blunders along the axes of a measurement, null where
    it is not tested."""
    if not np.isfinite(redundancy).any():
        return {"redundancy": None, "w": None, f"mdb_{unit}": None, "suspect": None}
    return {
        "redundancy": _finites(redundancy),
        "w": _finites(w),
        f"mdb_{unit}": _finites(minimal_detectable_blunder(sigma, redundancy)),
        "suspect": bool(np.any(np.abs(w) > CRITICAL)),
    }


def _finites(values: FloatArray) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]


def _ground_reliability(result: Adjustment, g: int) -> Json:
    """Return the tests of a control point's surveyed coordinates, the effect of a blunder that just escapes them on
    the adjusted ones, and what everything else would predict; null for check points."""
    r, sigma_m = result.reliability, result.block.control_points.sigma_m[g]
    numbers = _tested("m", r.ground_redundancy[g], r.ground_w[g], sigma_m)
    if numbers["redundancy"] is None:
        return {**numbers, "effect_m": None, "left_out_m": None, "left_out_sigma_m": None}
    effect = minimal_detectable_blunder(sigma_m, r.ground_redundancy[g]) * (1.0 - r.ground_redundancy[g])
    spread = np.sqrt(np.diag(r.ground_left_out_covariance_m2[g]))
    predicted = bool(np.isfinite(spread).any())
    return {
        **numbers,
        "effect_m": _finites(effect),
        "left_out_m": _finites(r.ground_left_out_m[g]) if predicted else None,
        "left_out_sigma_m": _finites(spread) if predicted else None,
    }


def _axis_roles(measured: ControlPoints, used: ControlPoints, g: int) -> list[str]:
    """Return the role of a ground point along its axes: control, check, or left out of the adjustment."""
    return [
        ("control" if part else "left out") if control else "check"
        for control, part in zip(measured.controlled[g], used.used[g], strict=True)
    ]


def ground_numbers(
    result: Adjustment, blunders: Sequence[Mapping[str, Any]] = (), measured: ControlPoints | None = None
) -> list[Json]:
    """Return surveyed and adjusted positions of all ground points; check points took no part in the adjustment.

    ``measured`` are the points as they were given, with what was left out of the adjustment.
    """
    block, frame, used = result.block, result.block.frame, result.block.control_points
    points = used if measured is None else measured
    r, numbers = result.reliability, list[Json]()
    for g, name in enumerate(points.name):
        surveyed = _map(frame, points.position_world_m[g])
        known = bool(np.isfinite(result.ground_world_m[g]).all())
        adjusted = _map(frame, result.ground_world_m[g])
        marks = np.flatnonzero(points.mark_point == g)
        numbers.append(
            {
                "name": name,
                "role": points.role[g],
                "axis_roles": _axis_roles(points, used, g),
                "surveyed_map_m": surveyed.tolist(),
                "surveyed_sigma_m": points.sigma_m[g].tolist(),
                "adjusted_map_m": adjusted.tolist() if known else None,
                "residual_m": (adjusted - surveyed).tolist() if known else None,
                "sigma_m": _sigma_map_m(frame, result.ground_world_m[g], result.ground_covariance_m2[g])
                if known
                else None,
                **_ground_reliability(result, g),
                "chi2": control_test(r.ground_left_out_m[g], r.ground_left_out_covariance_m2[g]),
                "verdict": control_verdict(result, g, blunders),
                "marks": [
                    {
                        "photograph": block.photographs[points.mark_photograph[m]].name,
                        "left_out": bool(np.isinf(used.mark_sigma_px[m])),
                        "pixel": points.mark_pixel[m].tolist(),
                        "residual_px": result.mark_residual_px[m].tolist()
                        if np.isfinite(result.mark_residual_px[m]).all()
                        else None,
                        **_tested("px", r.mark_redundancy[m], r.mark_w[m], np.full(2, points.mark_sigma_px[m])),
                    }
                    for m in marks
                ],
            }
        )
    return numbers


def check_numbers(points: list[Json]) -> Json:
    """Summarise the differences of the check points: control points never enter here."""
    rows = [
        [d if role == "check" else np.nan for d, role in zip(p["residual_m"], p["axis_roles"], strict=True)]
        for p in points
        if p["residual_m"] is not None
    ]
    accuracy = check_accuracy(np.array(rows).reshape(-1, 3))
    return {name: getattr(accuracy, name) for name in ("n", "n_axis", "rmse_m", "mean_m", "rmse_h_m", "rmse_v_m")}


def adjustment_numbers(result: Adjustment, seconds: float) -> Json:
    """Return what the joint adjustment says of itself; GNSS offsets along easting, northing and up."""
    residual = np.sum(result.residual_px**2, axis=1)
    rays = result.block.tie_points.rays
    axes = result.block.frame.rotation_world_from_map(np.zeros(3))
    return {
        "sigma0": result.sigma0,
        "redundancy": result.redundancy,
        "reprojection_rms_px": float(np.sqrt(residual.mean())) if len(residual) else None,
        "tie_points": len(result.block.tie_points),
        "tie_points_by_rays": {str(n): int(np.count_nonzero(rays == n)) for n in np.unique(rays)},
        "observations": len(residual),
        "discarded_observations": result.discarded_observations,
        "discarded_tie_points": result.discarded_points,
        "iterations": result.iterations,
        "rounds": result.rounds,
        "converged": result.converged,
        "gnss_offsets": {
            flight: {
                "offset_m": (axes.T @ result.offset_world_m[f]).tolist(),
                "sigma_m": np.sqrt(np.diag(axes.T @ result.offset_covariance_m2[f] @ axes)).tolist(),
            }
            for f, flight in enumerate(result.flights)
        },
        "seconds": seconds,
    }


def _comparison(comparison: Comparison) -> Json:
    surface, cloud = comparison.cloud_to_surface, comparison.cloud_to_cloud
    return {
        "compared": surface.compared,
        "removed_by_sor": comparison.removed,
        "mean_m": surface.mean_m,
        "std_m": surface.std_m,
        "median_m": surface.median_m,
        "nmad_m": surface.nmad_m,
        "cloud_to_cloud": {
            "mean_m": cloud.mean_m,
            "std_m": cloud.std_m,
            "median_m": cloud.median_m,
            "nmad_m": cloud.nmad_m,
        },
    }


def cloud_numbers(clouds: Mapping[str, PointCloud], comparisons: Mapping[str, Comparison]) -> Json:
    """Return the size of every cloud and its differences from the reference, null where there is none."""
    nothing = {"mean_m": None, "std_m": None, "median_m": None, "nmad_m": None}
    return {
        name: {"points": len(cloud), **(_comparison(comparisons[name]) if name in comparisons else nothing)}
        for name, cloud in clouds.items()
    }


def report_numbers(
    result: Adjustment,
    orientation: Orientation,
    clouds: Mapping[str, PointCloud],
    comparisons: Mapping[str, Comparison],
    overlap: Overlap | None,
    *,
    version: str,
    seconds: Mapping[str, float],
    held: Held = MappingProxyType({}),
    sources: Sequence[str] = (),
    verdict: Mapping[str, Any] = MappingProxyType({"blunders": ()}),
    measured: ControlPoints | None = None,
) -> Json:
    """Return the whole of report.json.

    ``seconds`` holds the time of every stage, ``held`` why parameters of a camera were held, ``sources`` where the
    calibration of each camera comes from, empty texts where that is not known, ``verdict`` the blunders found,
    ``measured`` the ground points as they were given.
    """
    frame, blunders = result.block.frame, verdict["blunders"]
    points = ground_numbers(result, blunders, measured)
    effect = {name: verdict[name] for name in ("check_points", "check_points_without")} if blunders else None
    return {
        "photogram": version,
        "crs": frame.crs,
        "world": {"kind": frame.kind, "origin_map_m": list(frame.origin_map_m)},
        "block": block_numbers(result, orientation, overlap),
        "photographs": photograph_numbers(result, orientation),
        "cameras": camera_numbers(result, held, sources, verdict.get("focal_lengths", {})),
        "adjustment": adjustment_numbers(result, seconds["adjustment"]),
        "control_points": points,
        "check_points": check_numbers(points),
        "blunders": list(blunders),
        "blunders_effect": effect and {**effect, "sentence": effect_sentence(*effect.values())},
        **consistency_numbers(result, points),
        "suspects": [{**asdict(s), "sentence": s.sentence} for s in suspects(result)],
        "diagnosis": diagnosis_numbers(result, orientation.resections),
        "clouds": cloud_numbers(clouds, comparisons),
        "seconds": dict(seconds),
    }
