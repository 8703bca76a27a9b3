"""The numbers of report.json. Its keys are kept stable: scripts rely on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from photogram.accuracy import check_accuracy
from photogram.camera import PARAMETER_NAMES, Pose, omega_phi_kappa_deg
from photogram.comparison import Comparison
from photogram.frames import LocalFrame
from photogram.orientation import Orientation, Resection
from photogram.survey import Adjustment, FloatArray, Photograph, PointCloud

Json = dict[str, Any]


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


def photograph_numbers(result: Adjustment, orientation: Orientation) -> Json:
    """Return exterior orientation, sigmas and resection of every photograph."""
    block, frame = result.block, result.block.frame
    control = block.control_points.with_role("control")
    rays = np.bincount(block.tie_points.photograph, minlength=len(block.photographs))
    numbers: Json = {}
    for i, (photograph, pose) in enumerate(zip(block.photographs, block.poses, strict=True)):
        if pose is None:
            continue
        rotation = pose.rotation_world_from_camera.T @ frame.rotation_world_from_map(pose.position_world_m)
        entry: Json = {
            "camera": block.cameras[photograph.camera].name,
            "position_map_m": _map(frame, pose.position_world_m).tolist(),
            "sigma_m": _sigma_map_m(frame, pose.position_world_m, result.position_covariance_m2[i]),
            "omega_phi_kappa_deg": omega_phi_kappa_deg(rotation.T).tolist(),
            "sigma_attitude_deg": np.rad2deg(np.sqrt(np.diag(result.rotation_covariance_rad2[i]))).tolist(),
            "rotation_camera_from_map": rotation.tolist(),
            "tie_points": int(rays[i]),
        }
        if photograph.gnss_world_m is not None:
            flight = result.flights.index(photograph.flight) if photograph.flight in result.flights else None
            offset = np.zeros(3) if flight is None else result.offset_world_m[flight]
            residual = _difference_map_m(frame, pose.position_world_m, photograph.gnss_world_m + offset)
            entry["gnss_residual_m"] = residual.tolist()
        resection = orientation.resections[i]
        if resection is not None:
            names = [control.name[g] for g in control.mark_point[control.mark_photograph == i]]
            entry["resection"] = _resection(frame, photograph, resection, names)
        numbers[photograph.name] = entry
    return numbers


def camera_numbers(result: Adjustment) -> Json:
    """Return the interior orientation of every camera with the sigmas of its free parameters (null where it was
    held)."""
    numbers: Json = {}
    for c, camera in enumerate(result.block.cameras):
        sigma = np.sqrt(np.diag(result.calibration_covariance[c]))
        free = camera.sigmas > 0
        numbers[camera.name] = {
            "focal_px": camera.focal_px,
            "principal_point_px": camera.principal_point_px.tolist(),
            "radial": camera.radial.tolist(),
            "tangential": camera.tangential.tolist(),
            "sigma": {n: float(s) if f else None for n, s, f in zip(PARAMETER_NAMES, sigma, free, strict=True)},
            "width_px": camera.width_px,
            "height_px": camera.height_px,
        }
    return numbers


def ground_numbers(result: Adjustment) -> list[Json]:
    """Return surveyed and adjusted positions of all ground points; check points took no part in the adjustment."""
    block, frame, points = result.block, result.block.frame, result.block.control_points
    numbers: list[Json] = []
    for g, name in enumerate(points.name):
        surveyed = _map(frame, points.position_world_m[g])
        known = bool(np.isfinite(result.ground_world_m[g]).all())
        adjusted = _map(frame, result.ground_world_m[g])
        marks = np.flatnonzero(points.mark_point == g)
        numbers.append(
            {
                "name": name,
                "role": points.role[g],
                "surveyed_map_m": surveyed.tolist(),
                "adjusted_map_m": adjusted.tolist() if known else None,
                "residual_m": (adjusted - surveyed).tolist() if known else None,
                "sigma_m": _sigma_map_m(frame, result.ground_world_m[g], result.ground_covariance_m2[g])
                if known
                else None,
                "marks": [
                    {
                        "photograph": block.photographs[points.mark_photograph[m]].name,
                        "pixel": points.mark_pixel[m].tolist(),
                        "residual_px": result.mark_residual_px[m].tolist() if known else None,
                    }
                    for m in marks
                ],
            }
        )
    return numbers


def check_numbers(points: list[Json]) -> Json:
    """Summarise the differences of the check points: control points never enter here."""
    rows = [p["residual_m"] for p in points if p["role"] == "check" and p["residual_m"] is not None]
    accuracy = check_accuracy(np.array(rows).reshape(-1, 3))
    return {name: getattr(accuracy, name) for name in ("n", "rmse_m", "mean_m", "rmse_h_m", "rmse_v_m")}


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
    *,
    version: str,
    seconds: Mapping[str, float],
) -> Json:
    """Return the whole of report.json; ``seconds`` holds the time of every stage."""
    frame, points = result.block.frame, ground_numbers(result)
    return {
        "photogram": version,
        "crs": frame.crs,
        "world": {"kind": frame.kind, "origin_map_m": list(frame.origin_map_m)},
        "photographs": photograph_numbers(result, orientation),
        "cameras": camera_numbers(result),
        "adjustment": adjustment_numbers(result, seconds["adjustment"]),
        "control_points": points,
        "check_points": check_numbers(points),
        "clouds": cloud_numbers(clouds, comparisons),
        "seconds": dict(seconds),
    }
