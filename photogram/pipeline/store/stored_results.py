"""Results as they lie on disk: measured photographs, orientation, adjustment and verdict."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter
from typing_extensions import TypedDict

from photogram.adjustment.stochastic_model.estimated_sigmas import with_gnss_sigmas
from photogram.arrays import IntArray
from photogram.camera import Camera, LensField, Pose, calibration_sigmas, calibrations, oriented_by
from photogram.constraints.rigs import Companion, RelativePose
from photogram.files.npz_json import read_arrays, read_json_as, write_arrays
from photogram.files.records import read_record, write_record
from photogram.geodesy.frames import LocalFrame
from photogram.project.measured.measured_block import MeasuredPhotographs
from photogram.project.project import Project
from photogram.projection import PARAMETERS
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


@dataclass(frozen=True, eq=False)
class StoredPhotographs:
    """Photographs as measured, without their files, and of which each is a copy: see MeasuredPhotographs."""

    photographs: tuple[Photograph, ...]
    original: IntArray


@dataclass(frozen=True, eq=False)
class StoredResections:
    """Resections of the photographs from the control points, None where there is none."""

    resections: tuple[Resection | None, ...]


_NOWHERE, _UNTURNED = np.full(3, np.nan), np.full((3, 3), np.nan)


def write_measured(path: Path, measured: MeasuredPhotographs) -> None:
    """Write measured photographs, whose frame and files are stored elsewhere."""
    photographs = tuple(replace(photograph, path=None) for photograph in measured.photographs)
    write_record(path, StoredPhotographs(photographs, measured.original))


def read_measured(path: Path, project: Project, frame: Mapping[str, Any]) -> MeasuredPhotographs:
    """Return the photographs that ``write_measured`` wrote, in the frame of the project that has the origin of
    ``frame``."""
    east, north, height = frame["origin_map_m"]
    world = LocalFrame(project.crs, (east, north, height), project.world_kind, project.heights.map_geoid)
    stored = read_record(path, StoredPhotographs)
    photographs = tuple(
        replace(photograph, name=source.name, camera=source.camera, path=source.path, flight=source.flight)
        for photograph, source in zip(stored.photographs, project.photographs, strict=True)
    )
    return MeasuredPhotographs(world, photographs, stored.original)


def starting_poses(orientation: Orientation, names: Sequence[str]) -> dict[str, object]:
    """Return starting poses and resections as people read them, by photograph."""
    rows = zip(names, orientation.poses, orientation.resections, orientation.component, orientation.reason, strict=True)
    keys = ("name", "pose", "resection", "component", "reason")
    return {
        "method": orientation.method,
        "photographs": [dict(zip(keys, row, strict=True)) for row in rows],
        "parameters": orientation.parameters,
    }


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
    parts = {"block", *_WORDS, _COMMON, _LENS_FIELDS, "reliability", "components", "constraints", "exposures"}
    parts |= {"deformation", "sigmas"}
    arrays = {name: np.asarray(value) for name, value in vars(result).items() if name not in parts}
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
