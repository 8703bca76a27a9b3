"""One run of a project: what its stages have written, read back as the survey's own types.

A stage reads only what earlier stages have written, so that a resumed run sees exactly what an uninterrupted one sees.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.camera import Pose, rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.files.maps.rasters import read_raster
from photogram.files.npz_json import file_fingerprint, read_arrays, read_json, read_record, record_arrays, write_arrays
from photogram.files.photographs.images import read_grey, read_pixels
from photogram.frames import LocalFrame
from photogram.height_systems import HeightSystem
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project, ProjectPhotograph
from photogram.quality.cloud_comparison import CloudStatistics, Comparison
from photogram.quality.deformation import GROUND
from photogram.quality.gross_errors.data_snooping import Hypothesis, unmeasured, without
from photogram.results import Adjustment, Deformation, Reliability, VarianceComponents
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.surface.tin_dsm import PointPrecision, ShapePrecision
from photogram.survey import Block, ControlPoints, Features, Matches, Photograph, PointCloud, Raster, TiePoints

NO_TIE_POINTS = TiePoints(
    *(np.zeros(0, dtype=np.int64),) * 3,
    np.zeros((0, 2)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((0, 3), dtype=np.uint8),
)


@dataclass(frozen=True)
class Run:
    """One run of a project: the project, its workspace, and the executor for parallel work."""

    project: Project
    workspace: Workspace
    executor: Executor

    @cached_property
    def photograph_fingerprints(self) -> tuple[str, ...]:
        """Return the content fingerprint of every photograph."""
        # with workers of its own, since one of the executor's may be the first to ask
        with ThreadPoolExecutor(os.cpu_count()) as workers:
            return tuple(workers.map(file_fingerprint, [p.path for p in self.project.photographs]))

    def pixels(self, index: int, size_px: tuple[int, int] | None = None) -> NDArray[np.uint8]:
        """Return a photograph as red, green, blue (height, width, 3). Raises ImageError as ``read_pixels``, and where
        it is not what it was when the run began."""
        return read_pixels(self.project.photographs[index].path, size_px, self.photograph_fingerprints[index])

    def grey(self, index: int) -> NDArray[np.uint8]:
        """Return a photograph's luminance (height, width). Raises ImageError as ``pixels``."""
        return read_grey(self.project.photographs[index].path, None, self.photograph_fingerprints[index])

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the photographs."""
        return tuple(p.name for p in self.project.photographs)

    def block(self) -> Block:
        """Return the block as measured: no poses, no tie points. Needs the stage `photographs`."""
        return measured_block(self.project, self.notes())

    def notes(self) -> list[dict[str, Any]]:
        """Return what the project, files of positions and tags say of each photograph. Needs the stage
        `photographs`."""
        return list(read_json(self.workspace.file("photographs", "tags.json")))

    def gnss_systems(self) -> list[HeightSystem | None]:
        """Return the system in which every GNSS height there is was given. Needs the stage `photographs`."""
        notes = self.notes()
        systems = self.project.gnss_systems([note["height_is_ellipsoidal"] for note in notes])
        return [system for system, note in zip(systems, notes, strict=True) if note["gnss_map_m"] is not None]

    def features(self, index: int) -> Features:
        """Return the key points of one photograph. Needs the stage `features`."""
        return read_record(self.workspace.file("features", f"{index:05d}.npz"), Features)

    def selected_pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of photographs to be matched. Needs the stage `pairs`."""
        return [(int(i), int(j)) for i, j in read_json(self.workspace.file("pairs", "pairs.json"))]

    def matches(self) -> Iterator[tuple[Matches, NDArray[np.bool_]]]:
        """Yield candidate matches of every pair, and which are verified, one pair after the other. Needs the stage
        `matches`."""
        for first, second in read_json(self.workspace.file("matches", "pairs.json")):
            arrays = read_arrays(self.workspace.file("matches", f"{first:05d}-{second:05d}.npz"))
            yield Matches(first, second, arrays["index"]), arrays["verified"]

    def orientation(self) -> Orientation:
        """Return starting poses and resections. Needs the stage `orientation`."""
        return orientation_from(read_json(self.workspace.file("orientation", "poses.json")))

    def tie_points(self) -> TiePoints:
        """Return the tie points of the whole block, without positions. Needs the stage `tie_points`."""
        return read_record(self.workspace.file("tie_points", "tie_points.npz"), TiePoints)

    def transferred_tie_points(self) -> TiePoints:
        """Return the tie points with what was measured of them in further photographs. Needs the stage `transfer`."""
        return read_record(self.workspace.file("transfer", "tie_points.npz"), TiePoints)

    def cloud(self, name: str) -> PointCloud:
        """Return a point cloud: linear_2view, linear_3view (stage `intersection`) or adjusted (stage `adjustment`)."""
        stage = "adjustment" if name == "adjusted" else "intersection"
        return read_record(self.workspace.file(stage, f"{name}.npz"), PointCloud)

    def adjustment(self) -> Adjustment:
        """Return the joint adjustment. Needs the stage `adjustment`."""
        rejected = [
            replace(unmeasured(kind, name, photograph), axes=tuple(axes))
            for kind, name, photograph, axes in self.verdict()["accused"]
        ]
        return adjustment_from(self.block(), lambda name: self.workspace.file("adjustment", name), rejected)

    def precision(self) -> PointPrecision:
        """Return the covariances of the adjusted cloud along the axes of the map. Needs the stage `adjustment`."""
        arrays = read_arrays(self.workspace.file("adjustment", "adjustment.npz"))
        R = self.block().frame.rotation_world_from_map(np.zeros(3))
        whole, rays = (R.T @ arrays[f"tie_point_{part}covariance_m2"] @ R for part in ("", "ray_"))
        return PointPrecision(rays, whole - rays)

    def shape(self) -> ShapePrecision | None:
        """Return how well the shape of the survey is known, without its datum, None where there are too few tie points
        to say. Needs the stage `adjustment`."""
        found = read_record(self.workspace.file("adjustment", "deformation.npz"), Deformation)
        if not len(found.place_world_m):
            return None
        frame = self.block().frame
        R = frame.rotation_world_from_map(np.zeros(3))
        places = frame.map_from_world(found.place_world_m)
        datum = R.T @ found.covariance[GROUND, GROUND] @ R
        return ShapePrecision(places, R.T @ found.shape_covariance_m2 @ R, datum)

    def held(self) -> dict[str, dict[str, str]]:
        """Return by camera and parameter why it did not come from the photographs. Needs the stage `adjustment`."""
        return dict(read_json(self.workspace.file("adjustment", "held.json")))

    def verdict(self) -> dict[str, Any]:
        """Return the blunders, what was left out for them, and the accuracy of the check points with them and without.
        Needs the stage `adjustment`."""
        return dict(read_json(self.workspace.file("adjustment", "verdict.json")))

    def surface(self) -> Raster:
        """Return the DSM. Needs the stage `surface`."""
        return self._raster("dsm")

    def filled_surface(self) -> Raster:
        """Return the DSM with its holes closed where it was matched, the DSM as it is otherwise. Needs the stage
        `surface`."""
        matched = self.workspace.has("surface", "dsm_filled.tif")
        return self._raster("dsm_filled" if matched else "dsm")

    def surface_relative_sigma(self) -> Raster | None:
        """Return the standard deviations of the DSM without the datum's part, None where they are not known. Needs the
        stage `surface`."""
        known = self.workspace.has("surface", "dsm_sigma_relative.tif")
        return self._raster("dsm_sigma_relative") if known else None

    def surface_sigma(self) -> Raster:
        """Return the standard deviations of the DSM. Needs the stage `surface`."""
        return self._raster("dsm_sigma")

    def held_out_m(self) -> NDArray[np.float64]:
        """Return what the DSM is off by at tie points that were held out of it. Needs the stage `surface`."""
        return np.asarray(read_arrays(self.workspace.file("surface", "held_out.npz"))["held_out_m"])

    def _raster(self, name: str) -> Raster:
        return read_raster(self.workspace.file("surface", f"{name}.tif"))[0]

    def comparisons(self) -> dict[str, Comparison]:
        """Return the comparisons of all clouds with the reference, none without a reference. Needs the stage
        `comparison`."""
        return {
            name: comparison_from(read_arrays(self.workspace.file("comparison", f"{name}.npz")), statistics)
            for name, statistics in read_json(self.workspace.file("comparison", "statistics.json")).items()
        }


def _frame(project: Project, tags: Sequence[Mapping[str, Any]]) -> LocalFrame:
    # not the check points: they take no part in anything, the origin of the frame included
    positions = [p.control_map_m for p in project.control_points if p.role == "control"]
    positions += [np.array(t["gnss_map_m"]) for t in tags if t["gnss_map_m"] is not None]
    known = np.isfinite(positions).reshape(-1, 3)
    if not known.any(axis=0).all():
        raise ProjectError(
            f"{project.path}: neither control points nor GNSS positions: the survey cannot be georeferenced; "
            "give control_points, or photographs with GNSS tags"
        )
    middle = np.nanmean(positions, axis=0)
    return LocalFrame.near(
        project.crs, np.where(known, positions, middle), project.world_kind, project.heights.map_geoid
    )


def _photograph(project: Project, frame: LocalFrame, index: int, tags: Mapping[str, Any]) -> Photograph:
    source = project.photographs[index]
    gnss = None if tags["gnss_map_m"] is None else frame.world_from_map(np.array([tags["gnss_map_m"]]))[0]
    attitude = None
    if tags["attitude_deg"] is not None:
        place = np.zeros(3) if gnss is None else gnss
        attitude = frame.rotation_world_from_true(place) @ rotation_from_gimbal(*tags["attitude_deg"])
    if gnss is not None and tags.get("lever_arm_enu_m") is not None:
        gnss = gnss + frame.rotation_world_from_true(gnss) @ np.array(tags["lever_arm_enu_m"])
    arm = tags.get("lever_arm_camera_m")
    return Photograph(
        source.name,
        source.camera,
        source.path,
        source.flight,
        None,
        gnss,
        None if gnss is None else np.array(tags["gnss_sigma_m"]),
        attitude,
        None if attitude is None else float(np.deg2rad(source.attitude_sigma_deg)),
        tags["height_above_ground_m"],
        lever_arm_camera_m=None if arm is None else np.array(arm),
    )


def _on_originals(points: ControlPoints, project: Project, tags: Sequence[Mapping[str, Any]]) -> ControlPoints:
    """Return ground points whose marks in copies of a photograph are moved to the photograph itself, unless the point
    is marked there already."""
    names = {photograph.name: i for i, photograph in enumerate(project.photographs)}
    original = np.array([names[t.get("copy_of") or t["name"]] for t in tags], dtype=np.int64)
    own = original[points.mark_photograph] == points.mark_photograph
    order = np.argsort(~own, kind="stable")  # marks in the photograph itself come before those in its copies
    place = np.column_stack([original[points.mark_photograph], points.mark_point])[order]
    kept = np.sort(order[np.unique(place, axis=0, return_index=True)[1]])
    return replace(
        points,
        mark_photograph=original[points.mark_photograph[kept]],
        mark_point=points.mark_point[kept],
        mark_pixel=points.mark_pixel[kept],
        mark_sigma_px=points.mark_sigma_px[kept],
    )


def measured_block(project: Project, tags: Sequence[Mapping[str, Any]]) -> Block:
    """Return the block as the project and the photographs' tags give it: no poses, no tie points. A photograph that is
    there twice has its marks once."""
    frame = _frame(project, tags)
    photographs = tuple(_photograph(project, frame, i, t) for i, t in enumerate(tags))
    points = project.control_points_in(frame)
    if any(t.get("copy_of") for t in tags):
        points = _on_originals(points, project, tags)
    return Block(
        frame,
        project.cameras,
        photographs,
        (None,) * len(photographs),
        NO_TIE_POINTS,
        points,
        project.gnss_offset_sigma_m,
    )


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


def adjustment_from(block: Block, file: Callable[[str], Path], rejected: Sequence[Hypothesis] = ()) -> Adjustment:
    """Return the adjustment of a measured block from its arrays, ``file`` giving their paths by name; what was
    ``rejected`` took no part."""
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
    adjusted = without(adjusted, [a for a in rejected if a.kind != "focal length"])
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


def control_of(project: Project) -> ControlPoints:
    """Return the project's ground points in a frame at the origin of the map, for fingerprints only."""
    return project.control_points_in(LocalFrame(project.crs, (0.0, 0.0, 0.0), "grid"))


def measured_photographs(project: Project) -> list[ProjectPhotograph]:
    """Return what the project says of its photographs but for where they lie, for fingerprints: a moved folder
    changes nothing."""
    return [replace(p, path=Path(p.name)) for p in project.photographs]


def height_marks(project: Project) -> list[object]:
    """Return the height systems as declared, for fingerprints: the grid of a geoid counts by what is in it."""
    heights, geoid = project.heights, project.heights.geoid
    grid = None if geoid is None or geoid.grid is None else file_fingerprint(Path(geoid.grid))
    return [heights.output, heights.gnss, heights.gnss_given, None if geoid is None else geoid.vertical, grid]
