"""Results as they lie on disk: orientation, adjustment and comparison, to JSON and npz and back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.camera import Pose
from photogram.files.npz_json import read_arrays, read_record, record_arrays, write_arrays
from photogram.quality.cloud_comparison import CloudStatistics, Comparison
from photogram.quality.gross_errors.data_snooping import Accusation, without
from photogram.results import Adjustment, Deformation, Reliability, VarianceComponents
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.survey import Block, TiePoints


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


_WORDS = ("flights", "held_flights", "warnings", "reason")  # of an adjustment, tuples of text


def adjustment_arrays(result: Adjustment) -> dict[str, NDArray[Any]]:
    """Return the arrays of an adjustment but for those of its parts that have files of their own."""
    parts = dict.fromkeys(("block", *_WORDS, "reliability", "components", "deformation"))
    arrays = record_arrays(replace(result, **parts))  # type: ignore[arg-type]
    nowhere = Pose(np.full((3, 3), np.nan), np.full(3, np.nan))
    poses = [pose or nowhere for pose in result.block.poses]
    for name in _WORDS:
        arrays[name] = np.array(getattr(result, name), dtype=np.str_)
    arrays["camera_parameters"] = np.array([c.parameters for c in result.block.cameras])
    arrays["pose_rotation"] = np.array([p.rotation_world_from_camera for p in poses])
    arrays["pose_position_world_m"] = np.array([p.position_world_m for p in poses])
    return arrays


def adjustment_from(block: Block, file: Callable[[str], Path], accused: Sequence[Accusation] = ()) -> Adjustment:
    """Return the adjustment of a measured block from its arrays, ``file`` giving their paths by name; what was
    ``accused`` took no part."""
    arrays = read_arrays(file("adjustment.npz"))
    values: dict[str, Any] = {name: (a if a.ndim else a.item()) for name, a in arrays.items()}
    for name in _WORDS:
        values[name] = tuple(str(word) for word in values[name])
    parameters = values.pop("camera_parameters")
    rotation, position = values.pop("pose_rotation"), values.pop("pose_position_world_m")
    adjusted = replace(
        block,
        cameras=tuple(c.with_parameters(q) for c, q in zip(block.cameras, parameters, strict=True)),
        poses=tuple(Pose(R, C) if np.isfinite(C[0]) else None for R, C in zip(rotation, position, strict=True)),
        tie_points=read_record(file("tie_points.npz"), TiePoints),
    )
    adjusted = without(adjusted, [a for a in accused if a.kind != "focal length"])
    return Adjustment(
        block=adjusted,
        reliability=read_record(file("reliability.npz"), Reliability),
        components=read_record(file("components.npz"), VarianceComponents),
        deformation=read_record(file("deformation.npz"), Deformation),
        **values,
    )


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
