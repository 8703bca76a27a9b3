"""The stages of a survey: what each reads from the workspace, what it computes, what it writes.

A stage reads only what earlier stages have written, so that a resumed run sees exactly what an uninterrupted one sees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from photogram.adjustment import adjust
from photogram.camera import Pose, rotation_from_gimbal
from photogram.comparison import CloudStatistics, Comparison, compare
from photogram.errors import ImageError, PhotogramError, ProjectError
from photogram.features import find_features
from photogram.files.images import PhotographTags, check_photograph, read_pixels, read_tags
from photogram.files.points import read_cloud
from photogram.files.rasters import read_raster, write_geotiff
from photogram.frames import LocalFrame, map_from_geodetic
from photogram.matching import match_pair, select_pairs
from photogram.orientation import Orientation, Resection, orient
from photogram.project import Project, ProjectPhotograph
from photogram.surface_model import surface_from_points
from photogram.survey import (
    Adjustment,
    Block,
    ControlPoints,
    Features,
    Matches,
    Photograph,
    PointCloud,
    Raster,
    TiePoints,
)
from photogram.tracks import join_matches
from photogram.triangulation import ideal_observations, intersect_tie_points
from photogram.workspace import (
    Workspace,
    file_fingerprint,
    read_arrays,
    read_json,
    read_record,
    record_arrays,
    write_arrays,
    write_json,
    write_record,
)


class Progress(Protocol):
    """Told by a stage how far it is."""

    def __call__(self, done: int, total: int, text: str) -> None:
        """``done`` of ``total`` pieces are finished; ``total`` is 0 while it is not known."""


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
        return tuple(self.executor.map(file_fingerprint, [p.path for p in self.project.photographs]))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the photographs."""
        return tuple(p.name for p in self.project.photographs)

    def block(self) -> Block:
        """Return the block as measured: no poses, no tie points. Needs the stage `photographs`."""
        return _block(self.project, read_json(self.workspace.stage("photographs") / "tags.json"))

    def features(self, index: int) -> Features:
        """Return the key points of one photograph. Needs the stage `features`."""
        return read_record(self.workspace.stage("features") / f"{index:05d}.npz", Features)

    def matches(self) -> list[tuple[Matches, np.ndarray[Any, np.dtype[np.bool_]]]]:
        """Return candidate matches of every pair, and which are verified. Needs the stage `matches`."""
        folder = self.workspace.stage("matches")
        result = []
        for first, second in read_json(folder / "pairs.json"):
            arrays = read_arrays(folder / f"{first:05d}-{second:05d}.npz")
            result.append((Matches(first, second, arrays["index"]), arrays["verified"]))
        return result

    def orientation(self) -> Orientation:
        """Return starting poses and resections. Needs the stage `orientation`."""
        return _orientation_from(read_json(self.workspace.stage("orientation") / "poses.json"))

    def tie_points(self) -> TiePoints:
        """Return the tie points of the whole block, without positions. Needs the stage `tie_points`."""
        return read_record(self.workspace.stage("tie_points") / "tie_points.npz", TiePoints)

    def cloud(self, name: str) -> PointCloud:
        """Return a point cloud: linear_2view, linear_3view (stage `intersection`) or adjusted (stage `adjustment`)."""
        stage = "adjustment" if name == "adjusted" else "intersection"
        return read_record(self.workspace.stage(stage) / f"{name}.npz", PointCloud)

    def adjustment(self) -> Adjustment:
        """Return the joint adjustment. Needs the stage `adjustment`."""
        return _adjustment_from(self.block(), self.workspace.stage("adjustment"))

    def surface(self) -> Raster:
        """Return the DSM. Needs the stage `surface`."""
        return read_raster(self.workspace.stage("surface") / "dsm.tif")[0]

    def comparisons(self) -> dict[str, Comparison]:
        """Return the comparisons of all clouds with the reference, none without a reference. Needs the stage
        `comparison`."""
        folder = self.workspace.stage("comparison")
        return {
            name: _comparison_from(read_arrays(folder / f"{name}.npz"), statistics)
            for name, statistics in read_json(folder / "statistics.json").items()
        }


# ---- photographs ---------------------------------------------------------------------------------------------------


def _gnss_from_tags(project: Project, photograph: ProjectPhotograph, tags: PhotographTags) -> list[float] | None:
    if photograph.gnss_map_m is not None:
        return [float(x) for x in photograph.gnss_map_m]
    if tags.longitude_deg is None or tags.latitude_deg is None or tags.height_m is None:
        return None
    geodetic = np.array([[tags.longitude_deg, tags.latitude_deg, tags.height_m]])
    return [float(x) for x in map_from_geodetic(project.crs, geodetic)[0]]


def _described(project: Project, photograph: ProjectPhotograph) -> dict[str, object]:
    """Decode a photograph once, so that damage shows before hours of work, and return what is known of its pose."""
    camera = project.cameras[photograph.camera]
    check_photograph(photograph.path, (camera.width_px, camera.height_px))
    tags = read_tags(photograph.path)
    angles = photograph.attitude_deg
    gimbal = (tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg)
    if angles is None and None not in gimbal:
        angles = gimbal  # type: ignore[assignment]
    gnss = _gnss_from_tags(project, photograph, tags)
    sigma = photograph.gnss_sigma_m if photograph.gnss_sigma_m is not None else tags.gnss_sigma_m
    if gnss is not None and sigma is None:
        raise ProjectError(
            f"photograph {photograph.name}: its GNSS position has no sigma, neither in the tags nor in the project: "
            "give photographs.gnss_sigma_m (0.02 to 0.05 m with RTK, 2 to 5 m without)"
        )
    return {
        "name": photograph.name,
        "gnss_map_m": gnss,
        "gnss_sigma_m": None if gnss is None or sigma is None else [float(s) for s in sigma],
        "attitude_deg": None if angles is None else list(angles),
        "time": tags.time.isoformat() if tags.time else None,
    }


def read_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Decode every photograph and note its GNSS position and attitude; every damaged one is named at once."""
    photographs = run.project.photographs
    futures = [run.executor.submit(_described, run.project, p) for p in photographs]
    notes, faults = [], []
    for done, future in enumerate(futures, 1):
        try:
            notes.append(future.result())
        except PhotogramError as fault:
            faults.append(str(fault))
        progress(done, len(futures), photographs[done - 1].name)
    if faults:
        raise ImageError("\n".join(faults))
    write_json(folder / "tags.json", notes)
    return {"photographs": len(notes)}


def _frame(project: Project, tags: Sequence[Mapping[str, Any]]) -> LocalFrame:
    # not the check points: they take no part in anything, the origin of the frame included
    positions = [p.position_map_m for p in project.control_points if p.role == "control"]
    positions += [np.array(t["gnss_map_m"]) for t in tags if t["gnss_map_m"] is not None]
    if not positions:
        raise ProjectError(
            f"{project.path}: neither control points nor GNSS positions: nothing says where the survey is; "
            "give control_points, or photographs with GNSS tags"
        )
    return LocalFrame.near(project.crs, np.array(positions), project.world_kind)


def _photograph(project: Project, frame: LocalFrame, index: int, tags: Mapping[str, Any]) -> Photograph:
    source = project.photographs[index]
    gnss = None if tags["gnss_map_m"] is None else frame.world_from_map(np.array([tags["gnss_map_m"]]))[0]
    attitude = None
    if tags["attitude_deg"] is not None:
        place = np.zeros(3) if gnss is None else gnss
        attitude = frame.rotation_world_from_true(place) @ rotation_from_gimbal(*tags["attitude_deg"])
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
    )


def _block(project: Project, tags: Sequence[Mapping[str, Any]]) -> Block:
    frame = _frame(project, tags)
    photographs = tuple(_photograph(project, frame, i, t) for i, t in enumerate(tags))
    return Block(
        frame,
        project.cameras,
        photographs,
        (None,) * len(photographs),
        NO_TIE_POINTS,
        project.control_points_in(frame),
        project.gnss_offset_sigma_m,
    )


# ---- orientation ---------------------------------------------------------------------------------------------------


def _pose_to(pose: Pose) -> dict[str, object]:
    return {
        "position_world_m": pose.position_world_m.tolist(),
        "rotation_world_from_camera": pose.rotation_world_from_camera.tolist(),
    }


def _pose_from(value: Mapping[str, Any]) -> Pose:
    return Pose(np.array(value["rotation_world_from_camera"]), np.array(value["position_world_m"]))


def _resection_to(resection: Resection) -> dict[str, object]:
    return {
        "p3p": _pose_to(resection.p3p),
        "points": list(resection.points),
        "solutions": resection.solutions,
        "check_px": resection.check_px,
        "refined": _pose_to(resection.refined),
        "inliers": resection.inliers.tolist(),
        "residual_px": resection.residual_px.tolist(),
    }


def _resection_from(value: Mapping[str, Any]) -> Resection:
    a, b, c = value["points"]
    return Resection(
        _pose_from(value["p3p"]),
        (a, b, c),
        value["solutions"],
        float("nan") if value["check_px"] is None else value["check_px"],
        _pose_from(value["refined"]),
        np.array(value["inliers"], dtype=bool),
        np.array(value["residual_px"]).reshape(-1, 2),
    )


def orient_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Find a starting pose for every photograph."""
    block = run.block()
    orientation = orient(block)
    pairs = zip(run.names, orientation.poses, orientation.resections, strict=True)
    value = [
        {"name": name, "pose": _pose_to(pose), "resection": None if r is None else _resection_to(r)}
        for name, pose, r in pairs
    ]
    write_json(folder / "poses.json", value)
    progress(len(value), len(value), "resected")
    return {"resected": sum(r is not None for r in orientation.resections)}


def _orientation_from(value: Sequence[Mapping[str, Any]]) -> Orientation:
    resections = [None if v["resection"] is None else _resection_from(v["resection"]) for v in value]
    return Orientation(tuple(_pose_from(v["pose"]) for v in value), tuple(resections))


# ---- features, matches, tie points ---------------------------------------------------------------------------------


def detect_features(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Find key points, one file per photograph; photographs that an interrupted run has finished are kept.

    One photograph after the other: OpenCV works on all cores, and one picture at a time bounds the memory.
    """
    counts = []
    for index, photograph in enumerate(run.project.photographs):
        path = folder / f"{index:05d}.npz"
        progress(index, len(run.names), photograph.name)
        if not path.is_file():
            write_record(path, find_features(photograph.name, read_pixels(photograph.path), run.project.features))
        counts.append(len(read_record(path, Features)))
    progress(len(counts), len(counts), "")
    return {"key_points": counts}


def match_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Match and verify all selected pairs, one file per pair; pairs that an interrupted run has finished are kept."""
    project = run.project
    orientation = run.orientation()
    pairs = select_pairs([pose.position_world_m for pose in orientation.poses], project.matching)
    verified = 0
    for done, (i, j) in enumerate(pairs):
        path = folder / f"{i:05d}-{j:05d}.npz"
        progress(done, len(pairs), f"{run.names[i]} – {run.names[j]}")
        if not path.is_file():
            cameras = (project.cameras[project.photographs[i].camera], project.cameras[project.photographs[j].camera])
            matches, good = match_pair((i, j), cameras, (run.features(i), run.features(j)), project.matching)
            write_arrays(path, {"index": matches.index, "verified": good})
        verified += int(read_arrays(path)["verified"].any())
    write_json(folder / "pairs.json", [list(pair) for pair in pairs])
    progress(len(pairs), len(pairs), "")
    return {"pairs": len(pairs), "verified_pairs": verified}


def join_tie_points(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Join verified matches to tie points over all photographs."""
    features = [run.features(i) for i in range(len(run.names))]
    matches = [Matches(m.first, m.second, m.index[good]) for m, good in run.matches()]
    joined = join_matches(features, matches, run.project.adjustment.tie_point_sigma_px)
    write_record(folder / "tie_points.npz", joined.tie_points)
    progress(1, 1, f"{len(joined.tie_points)} tie points")
    return {"tie_points": len(joined.tie_points), "conflicts": joined.conflicts}


# ---- clouds --------------------------------------------------------------------------------------------------------


def intersect_clouds(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Intersect tie points linearly from the resected photographs, from two and from three views each."""
    block, tie_points, orientation = run.block(), run.tie_points(), run.orientation()
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    ideal = ideal_observations(block.cameras, camera_of, tie_points)
    poses = [None if r is None else r.refined for r in orientation.resections]
    counts = {}
    for rays in (2, 3):
        world = intersect_tie_points(tie_points, ideal, poses, rays)
        known = np.isfinite(world).all(axis=1)
        cloud = PointCloud(block.frame.map_from_world(world[known]), tie_points.colour[known])
        write_record(folder / f"linear_{rays}view.npz", cloud)
        counts[f"linear_{rays}view"] = len(cloud)
        progress(rays - 1, 2, f"{len(cloud)} points from {rays} views")
    return counts


def _sigma_map_m(
    frame: LocalFrame, covariance_m2: np.ndarray[Any, np.dtype[np.float64]]
) -> np.ndarray[Any, np.dtype[np.float64]]:
    R = frame.rotation_world_from_map(np.zeros(3))
    return np.asarray(np.sqrt(np.einsum("ki,nkl,li->ni", R, covariance_m2, R)))


def adjust_block(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Adjust the block jointly."""
    orientation = run.orientation()
    block = replace(run.block(), poses=orientation.poses, tie_points=run.tie_points())
    result = adjust(block, run.project.adjustment, lambda text: progress(0, 0, text))
    frame, tie_points = block.frame, result.block.tie_points
    sigma = _sigma_map_m(frame, result.tie_point_covariance_m2)
    cloud = PointCloud(frame.map_from_world(tie_points.position_world_m), tie_points.colour, sigma)
    write_record(folder / "adjusted.npz", cloud)
    write_record(folder / "tie_points.npz", tie_points)
    write_arrays(folder / "adjustment.npz", _adjustment_arrays(result))
    return {"sigma0": result.sigma0, "converged": result.converged, "iterations": result.iterations}


def _adjustment_arrays(result: Adjustment) -> dict[str, np.ndarray[Any, Any]]:
    arrays = record_arrays(replace(result, block=None, flights=None))  # type: ignore[arg-type]
    poses = [pose for pose in result.block.poses if pose is not None]
    arrays["flights"] = np.array(result.flights, dtype=np.str_)
    arrays["camera_parameters"] = np.array([c.parameters for c in result.block.cameras])
    arrays["pose_rotation"] = np.array([p.rotation_world_from_camera for p in poses])
    arrays["pose_position_world_m"] = np.array([p.position_world_m for p in poses])
    return arrays


def _adjustment_from(block: Block, folder: Path) -> Adjustment:
    arrays = read_arrays(folder / "adjustment.npz")
    values: dict[str, Any] = {name: (a if a.ndim else a.item()) for name, a in arrays.items()}
    values["flights"] = tuple(str(f) for f in values["flights"])
    parameters = values.pop("camera_parameters")
    rotation, position = values.pop("pose_rotation"), values.pop("pose_position_world_m")
    adjusted = replace(
        block,
        cameras=tuple(c.with_parameters(q) for c, q in zip(block.cameras, parameters, strict=True)),
        poses=tuple(Pose(R, C) for R, C in zip(rotation, position, strict=True)),
        tie_points=read_record(folder / "tie_points.npz", TiePoints),
    )
    return Adjustment(block=adjusted, **values)


def model_surface(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Make the DSM from the adjusted cloud."""
    raster = surface_from_points(run.cloud("adjusted"), run.project.surface)
    write_geotiff(folder / "dsm.tif", raster, run.project.crs)
    rows, columns = raster.values.shape
    progress(1, 1, f"{columns} × {rows} cells of {raster.cell_m:g} m")
    return {"rows": rows, "columns": columns, "cell_m": raster.cell_m}


# ---- comparison ----------------------------------------------------------------------------------------------------


def read_reference(path: Path) -> Raster | PointCloud:
    """Read a reference surface: a GeoTIFF, or a cloud as text, LAS or LAZ. Raises ProjectError when it cannot be
    read."""
    return read_raster(path)[0] if path.suffix.lower() in {".tif", ".tiff"} else read_cloud(path)


def compare_clouds(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Compare the clouds with the reference, when the project names one."""
    statistics: dict[str, object] = {}
    if run.project.reference is not None:
        reference = read_reference(run.project.reference)
        for name in ("linear_2view", "linear_3view", "adjusted"):
            cloud = run.cloud(name)
            if len(cloud) >= 3:
                comparison = compare(cloud, reference)
                statistics[name] = _write_comparison(folder / f"{name}.npz", comparison)
            progress(len(statistics), 3, name)
    write_json(folder / "statistics.json", statistics)
    return {"clouds": len(statistics)}


def _write_comparison(path: Path, comparison: Comparison) -> dict[str, object]:
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


def _comparison_from(arrays: Mapping[str, np.ndarray[Any, Any]], statistics: Mapping[str, Any]) -> Comparison:
    return Comparison(
        arrays["position_map_m"],
        arrays["surface_difference_m"],
        arrays["cloud_distance_m"],
        CloudStatistics(**statistics["cloud_to_surface"]),
        CloudStatistics(**statistics["cloud_to_cloud"]),
        statistics["removed"],
    )


Settings = Callable[[Run], object]
Work = Callable[[Run, Path, Progress], Mapping[str, object]]


@dataclass(frozen=True)
class Stage:
    """One stage: what it is called, the stages whose results it reads, the settings it depends on, and its work."""

    name: str
    title: str
    needs: tuple[str, ...]
    settings: Settings
    work: Work


def control_of(project: Project) -> ControlPoints:
    """Return the project's ground points in a frame at the origin of the map, for fingerprints only."""
    return project.control_points_in(LocalFrame(project.crs, (0.0, 0.0, 0.0), "grid"))


def measured_photographs(project: Project) -> list[ProjectPhotograph]:
    """Return what the project says of its photographs but for where they lie, for fingerprints: a moved folder
    changes nothing."""
    return [replace(p, path=Path(p.name)) for p in project.photographs]
