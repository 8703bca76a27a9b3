"""Results as they lie on disk: orientation, adjustment and comparison, to JSON and npz and back."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from typing_extensions import TypedDict

from photogram.adjustment.stochastic_model.estimated_sigmas import with_gnss_sigmas
from photogram.camera import Camera, LensField, Pose, calibration_sigmas, calibrations, oriented_by
from photogram.constraints.rigs import Companion, RelativePose
from photogram.files.npz_json import read_arrays, read_json_as, read_record, record_arrays, write_arrays, write_record
from photogram.frames import LocalFrame
from photogram.project.measured.measured_block import MeasuredPhotographs
from photogram.project.project import Project
from photogram.projection import PARAMETERS
from photogram.quality.cloud_comparison import CloudStatistics, Comparison
from photogram.quality.gross_errors.blunder_naming import Blunder
from photogram.quality.gross_errors.data_snooping import Hypothesis, Suspected, unmeasured, without
from photogram.quality.gross_errors.snooped_adjustment import Verdict
from photogram.report.record.ground import BlunderRecord, CheckPointsRecord
from photogram.results import (
    Adjustment,
    CommonErrorEstimate,
    ConstraintTests,
    Deformation,
    EstimatedSigmas,
    ExposureTests,
    LensFieldDecision,
    Reliability,
    VarianceComponents,
)
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.survey import Block, CommonError, Photograph, TiePoints


@dataclass(frozen=True)
class PlacedBy:
    """What an orientation owes to control points: ``control`` is the fingerprint of those that it was made with,
    ``poses`` whether any pose is a resection from them. Where none is, the block came from its tie points, and control
    points have only placed it in the world."""

    control: str
    poses: bool


class StoredVerdict(TypedDict):
    """What the data snooping decided, as ``verdict.json`` holds it."""

    accused: list[tuple[Suspected, str, str | None, tuple[int, ...]]]
    """Rejected measurements: kind, name, photograph of a mark, and axes, as in Hypothesis."""
    blunders: list[BlunderRecord]
    """Blunders by their names."""
    focal_lengths: dict[str, str]
    """Sentences on focal lengths whose source the photographs contradict, by camera."""
    check_points: CheckPointsRecord
    """Accuracy at the check points with all measurements; null where the block cannot be adjusted with them."""
    check_points_without: CheckPointsRecord
    """Accuracy at the check points of the result."""


_UNKNOWN, _NOWHERE, _UNTURNED = np.array(np.nan), np.full(3, np.nan), np.full((3, 3), np.nan)


def measured_arrays(measured: MeasuredPhotographs) -> dict[str, NDArray[Any]]:
    """Return measured photographs as arrays, NaN or empty where nothing is known."""
    photographs = measured.photographs

    def column(name: str, nothing: NDArray[np.float64]) -> NDArray[Any]:
        values = [getattr(photograph, name) for photograph in photographs]
        known = np.array([nothing if value is None else value for value in values], dtype=np.float64)
        return known.reshape(len(photographs), *nothing.shape)

    return {
        "original": measured.original,
        "time": np.array(["" if p.time is None else p.time.isoformat() for p in photographs], dtype=np.str_),
        "gnss_world_m": column("gnss_world_m", _NOWHERE),
        "gnss_sigma_m": column("gnss_sigma_m", _NOWHERE),
        "attitude_world_from_camera": column("attitude_world_from_camera", _UNTURNED),
        "attitude_sigma_rad": column("attitude_sigma_rad", _UNKNOWN),
        "height_above_ground_m": column("height_above_ground_m", _UNKNOWN),
        "lever_arm_camera_m": column("lever_arm_camera_m", _NOWHERE),
        "velocity_world_m_s": column("velocity_world_m_s", _NOWHERE),
        "gnss_sigma_assumed": np.array([p.gnss_sigma_assumed for p in photographs], dtype=bool),
        "capture": np.array([p.capture or "" for p in photographs], dtype=np.str_),
    }


def measured_from(
    project: Project, frame: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> MeasuredPhotographs:
    """Return the photographs that ``measured_arrays`` wrote, in the frame of the project that has the origin of
    ``frame``."""
    east, north, height = frame["origin_map_m"]
    world = LocalFrame(project.crs, (east, north, height), project.world_kind, project.heights.map_geoid)

    def known(name: str, i: int) -> Any:  # noqa: ANN401 - an array or a number, by the name
        value = arrays[name][i]
        return None if np.isnan(value).any() else value

    photographs = tuple(
        Photograph(
            source.name,
            source.camera,
            source.path,
            source.flight,
            datetime.fromisoformat(str(arrays["time"][i])) if arrays["time"][i] else None,
            known("gnss_world_m", i),
            known("gnss_sigma_m", i),
            known("attitude_world_from_camera", i),
            None if (sigma := known("attitude_sigma_rad", i)) is None else float(sigma),
            None if (above := known("height_above_ground_m", i)) is None else float(above),
            lever_arm_camera_m=known("lever_arm_camera_m", i),
            gnss_sigma_assumed=bool(arrays["gnss_sigma_assumed"][i]),
            velocity_world_m_s=known("velocity_world_m_s", i),
            capture=str(arrays["capture"][i]) or None,
        )
        for i, source in enumerate(project.photographs)
    )
    return MeasuredPhotographs(world, photographs, arrays["original"])


def pose_to(pose: Pose) -> dict[str, object]:
    """Return a pose as JSON."""
    return {
        "position_world_m": pose.position_world_m.tolist(),
        "rotation_world_from_camera": pose.rotation_world_from_camera.tolist(),
    }


def pose_from(value: Mapping[str, Any]) -> Pose:
    """Return the pose that ``pose_to`` wrote."""
    return Pose(np.array(value["rotation_world_from_camera"]), np.array(value["position_world_m"]))


def resection_to(resection: Resection) -> dict[str, object]:
    """Return a resection as JSON."""
    return {
        "p3p": pose_to(resection.p3p),
        "points": list(resection.points),
        "solutions": resection.solutions,
        "check_px": resection.check_px,
        "refined": pose_to(resection.refined),
        "inliers": resection.inliers.tolist(),
        "residual_px": resection.residual_px.tolist(),
    }


def resection_from(value: Mapping[str, Any]) -> Resection:
    """Return the resection that ``resection_to`` wrote."""
    a, b, c = value["points"]
    return Resection(
        pose_from(value["p3p"]),
        (a, b, c),
        value["solutions"],
        float("nan") if value["check_px"] is None else value["check_px"],
        pose_from(value["refined"]),
        np.array(value["inliers"], dtype=bool),
        np.array(value["residual_px"]).reshape(-1, 2),
    )


def orientation_to(orientation: Orientation, names: Sequence[str]) -> dict[str, object]:
    """Return starting poses and resections as JSON."""
    rows = zip(names, orientation.poses, orientation.resections, orientation.component, orientation.reason, strict=True)
    return {
        "method": orientation.method,
        "photographs": [
            {
                "name": name,
                "pose": None if pose is None else pose_to(pose),
                "resection": None if resection is None else resection_to(resection),
                "component": int(component),
                "reason": reason,
            }
            for name, pose, resection, component, reason in rows
        ],
        "parameters": [q.tolist() for q in orientation.parameters],
    }


def orientation_from(value: Mapping[str, Any]) -> Orientation:
    """Return the starting poses and resections that ``orientation_to`` wrote."""
    rows = value["photographs"]
    return Orientation(
        tuple(None if v["pose"] is None else pose_from(v["pose"]) for v in rows),
        tuple(None if v["resection"] is None else resection_from(v["resection"]) for v in rows),
        np.array([v["component"] for v in rows], dtype=np.int64),
        value["method"],
        tuple(v["reason"] for v in rows),
        tuple(np.array(q) for q in value["parameters"]),
    )


ADJUSTED, COVARIANCES, SIGMAS = "adjustment.npz", "covariances.npz", "sigmas.npz"
_WORDS = ("flights", "held_flights", "warnings", "reason")  # of an adjustment, tuples of text
_COMMON, _LENS_FIELDS = "common_errors", "lens_fields"
_OF_RIGS = ("rig_rotation", "rig_offset_m", "rig_value")
_FIELDS = ("field_functions", "field_sigmas", "field_sizes")
_OF_BLOCK = ("camera_parameters", "pose_rotation", "pose_position_world_m", "pose_velocity_world_m_s")


def common_error_to(found: CommonErrorEstimate) -> dict[str, object]:
    """Return an estimated common error as JSON."""
    error = found.error
    return {
        "error": {**vars(error), "sigma": error.sigma.tolist(), "value": error.value.tolist(),
                  "basis": error.basis.tolist()},
        **{name: value for name, value in vars(found).items() if name != "error"},
        "estimate": found.estimate.tolist(),
        "covariance": found.covariance.tolist(),
    }  # fmt: skip


def common_error_from(value: Mapping[str, Any]) -> CommonErrorEstimate:
    """Return the estimated common error that ``common_error_to`` wrote."""
    error = dict(value["error"])
    sigma = np.array(error.pop("sigma"))
    basis = np.array(error.pop("basis")).reshape((3, len(sigma)) if error["kind"] == "lever_arm" else (0, 0))
    common = CommonError(**{**error, "sigma": sigma, "value": np.array(error["value"]), "basis": basis})
    arrays = {name: np.array(value[name]) for name in ("estimate", "covariance")}
    return CommonErrorEstimate(**{**value, "error": common, **arrays})


def adjustment_arrays(result: Adjustment) -> dict[str, NDArray[Any]]:
    """Return the arrays of an adjustment but for those of its parts that have files of their own."""
    parts = dict.fromkeys(
        (
            *("block", *_WORDS, _COMMON, _LENS_FIELDS, "reliability", "components", "constraints", "exposures"),
            *("deformation", "sigmas"),
        )
    )
    arrays = record_arrays(replace(result, **parts))  # type: ignore[arg-type]
    nowhere = Pose(np.full((3, 3), np.nan), np.full(3, np.nan))
    poses = [pose or nowhere for pose in result.block.poses]
    for name in _WORDS:
        arrays[name] = np.array(getattr(result, name), dtype=np.str_)
    arrays[_COMMON] = np.array([json.dumps(common_error_to(found)) for found in result.common_errors], dtype=np.str_)
    arrays[_LENS_FIELDS] = np.array([json.dumps(vars(found)) for found in result.lens_fields], dtype=np.str_)
    cameras = result.block.cameras
    fields = (
        oriented_by(cameras, np.zeros(0, dtype=np.int64), ()).functions,
        calibration_sigmas(cameras)[:, PARAMETERS:],
    )
    sizes = np.array([-1 if c.field is None else len(c.field.coefficients) for c in cameras], dtype=np.int64)
    arrays |= dict(zip(_FIELDS, (*fields, sizes), strict=True))
    arrays["camera_parameters"] = calibrations(cameras)
    arrays["pose_rotation"] = np.array([p.rotation_world_from_camera for p in poses])
    arrays["pose_position_world_m"] = np.array([p.position_world_m for p in poses])
    arrays["pose_velocity_world_m_s"] = np.array([p.velocity_world_m_s for p in poses])
    rigs, unknown = result.block.rigs, RelativePose(_NOWHERE, _UNTURNED)
    given = [rig.given or unknown for rig in rigs]
    arrays["rig_rotation"] = np.array([pose.rotation_master_from_companion for pose in given]).reshape(-1, 3, 3)
    arrays["rig_offset_m"] = np.array([pose.offset_m for pose in given]).reshape(-1, 3)
    arrays["rig_value"] = np.array([rig.value for rig in rigs]).reshape(-1, 6)
    return arrays


def write_adjustment(folder: Path, result: Adjustment) -> None:
    """Write an adjustment: covariances, which few read, in a file of their own."""
    arrays = adjustment_arrays(result)
    covariances = {name: array for name, array in arrays.items() if "covariance" in name}
    write_arrays(folder / ADJUSTED, {name: array for name, array in arrays.items() if name not in covariances})
    write_arrays(folder / COVARIANCES, covariances)
    write_record(folder / "tie_points.npz", result.block.tie_points)
    write_record(folder / "reliability.npz", result.reliability)
    write_record(folder / "components.npz", result.components)
    write_record(folder / "constraints.npz", result.constraints)
    write_record(folder / "exposures.npz", result.exposures)
    write_record(folder / SIGMAS, result.sigmas)
    write_record(folder / "deformation.npz", result.deformation)


def _adjusted_rigs(rigs: Sequence[Companion], arrays: Mapping[str, NDArray[Any]]) -> tuple[Companion, ...]:
    """Return the rigs of a measured block with their relative poses as they were adjusted."""
    poses = zip(*(arrays[name] for name in _OF_RIGS), strict=True)
    return tuple(
        replace(rig, given=RelativePose(o, R) if np.isfinite(o).all() else None, value=value)
        for rig, (R, o, value) in zip(rigs, poses, strict=True)
    )


def _with_lenses(
    cameras: Sequence[Camera], parameters: NDArray[Any], arrays: Mapping[str, NDArray[Any]]
) -> tuple[Camera, ...]:
    """Return cameras with the adjusted parameters (C, 12 + K) and the lens fields of ``arrays``."""
    if not all(name in arrays for name in _FIELDS):  # of an earlier version
        return tuple(camera.with_parameters(q) for camera, q in zip(cameras, parameters, strict=True))
    adjusted = []
    for camera, q, functions, sigmas, size in zip(
        cameras, parameters, *(arrays[name] for name in _FIELDS), strict=True
    ):
        if size < 0:
            adjusted.append(camera.with_parameters(q[:PARAMETERS]))
            continue
        own = np.ascontiguousarray(functions[..., :size])
        field = LensField(own, np.zeros(int(size)), sigmas[:size])
        adjusted.append(replace(camera, field=field).with_parameters(q))
    return tuple(adjusted)


def adjusted_block_from(
    block: Block,
    arrays: Mapping[str, NDArray[Any]],
    tie_points: TiePoints,
    rejected: Sequence[Hypothesis] = (),
    sigmas: EstimatedSigmas | None = None,
) -> Block:
    """Return a measured block as it was adjusted, from the arrays in ADJUSTED; what was ``rejected`` took no part.
    ``tie_points`` have the sigmas that were used, GNSS positions get those that were estimated."""
    parameters, *exterior = (arrays[name] for name in _OF_BLOCK)
    adjusted = replace(
        block,
        cameras=_with_lenses(block.cameras, parameters, arrays),
        poses=tuple(Pose(R, C, v) if np.isfinite(C[0]) else None for R, C, v in zip(*exterior, strict=True)),
        tie_points=tie_points,
        common_errors=tuple(common_error_from(json.loads(str(text))).error for text in arrays.get(_COMMON, ())),
        rigs=_adjusted_rigs(block.rigs, arrays),
    )
    if sigmas is not None:
        adjusted = with_gnss_sigmas(adjusted, sigmas)
    return without(adjusted, [a for a in rejected if a.kind != "focal length"])


def adjustment_from(adjusted: Block, file: Callable[[str], Path]) -> Adjustment:
    """Return the adjustment of which the block is ``adjusted``, ``file`` giving the paths of its arrays by name."""
    arrays = {**read_arrays(file(ADJUSTED)), **read_arrays(file(COVARIANCES))}
    of_block = (*_OF_BLOCK, *_OF_RIGS, *_FIELDS)
    values: dict[str, Any] = {name: (a if a.ndim else a.item()) for name, a in arrays.items() if name not in of_block}
    for name in _WORDS:
        values[name] = tuple(str(word) for word in values[name])
    values[_COMMON] = tuple(common_error_from(json.loads(str(text))) for text in values.get(_COMMON, ()))
    values[_LENS_FIELDS] = tuple(LensFieldDecision(**json.loads(str(text))) for text in values.get(_LENS_FIELDS, ()))
    return Adjustment(
        block=adjusted,
        reliability=read_record(file("reliability.npz"), Reliability),
        components=read_record(file("components.npz"), VarianceComponents),
        constraints=read_record(file("constraints.npz"), ConstraintTests),
        exposures=read_record(file("exposures.npz"), ExposureTests),
        sigmas=read_record(file(SIGMAS), EstimatedSigmas),
        deformation=read_record(file("deformation.npz"), Deformation),
        **values,
    )


def verdict_to(verdict: Verdict, blunders: Sequence[Blunder]) -> dict[str, object]:
    """Return a verdict as JSON; ``blunders`` are its own and those that were left out before."""
    return {
        "accused": [(a.kind, a.name, a.photograph, list(a.axes)) for a in verdict.rejected],
        "blunders": list(blunders),
        "focal_lengths": {name: decision.sentence for name, decision in verdict.focal_lengths.items()},
        "check_points": verdict.check_before,
        "check_points_without": verdict.check_after,
    }


@cache
def _verdict_types() -> TypeAdapter[StoredVerdict]:
    return TypeAdapter(StoredVerdict)


def read_verdict(path: Path) -> StoredVerdict:
    """Read what ``verdict_to`` returned. Raises WorkspaceError where it cannot be read or is something else."""
    return read_json_as(path, _verdict_types())


def rejected_from(verdict: StoredVerdict) -> list[Hypothesis]:
    """Return the rejected measurements, of unknown size."""
    return [
        replace(unmeasured(kind, name, photograph), axes=axes) for kind, name, photograph, axes in verdict["accused"]
    ]


def write_comparison(path: Path, comparison: Comparison) -> dict[str, object]:
    """Write the differences of a comparison as npz and return its statistics as JSON."""
    write_arrays(
        path,
        {
            "position_map_m": comparison.position_map_m,
            "surface_difference_m": comparison.surface_difference_m,
            "cloud_distance_m": comparison.cloud_distance_m,
        },
    )
    return {
        "removed": comparison.removed,
        "cloud_to_surface": comparison.cloud_to_surface,
        "cloud_to_cloud": comparison.cloud_to_cloud,
    }


def comparison_from(arrays: Mapping[str, NDArray[Any]], statistics: Mapping[str, Any]) -> Comparison:
    """Return the comparison that ``write_comparison`` wrote."""
    return Comparison(
        arrays["position_map_m"],
        arrays["surface_difference_m"],
        arrays["cloud_distance_m"],
        CloudStatistics(**statistics["cloud_to_surface"]),
        CloudStatistics(**statistics["cloud_to_cloud"]),
        statistics["removed"],
    )
