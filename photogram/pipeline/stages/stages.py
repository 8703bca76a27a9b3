"""The stages of a survey: what each reads from the workspace, what it computes, what it writes.

A stage reads only what earlier stages have written, so that a resumed run sees exactly what an uninterrupted one sees.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from photogram.adjustment.oriented_subset import part_of_block
from photogram.adjustment.self_calibration import held_parameters, with_priors
from photogram.arrays import ByteArray, FloatArray
from photogram.crs import plan_of
from photogram.errors import ImageError, PhotogramError, ProjectError
from photogram.files.clouds.points import read_cloud
from photogram.files.maps.rasters import read_raster, write_geotiff
from photogram.files.npz_json import read_arrays, read_record, write_arrays, write_json, write_record
from photogram.files.photographs.copies import find_copies
from photogram.files.photographs.images import check_photograph, read_tags
from photogram.files.photographs.tags import PhotographTags
from photogram.frames import LocalFrame, map_heights
from photogram.pipeline.store.run import Run, adjustment_arrays, orientation_to, write_comparison
from photogram.project.measured_positions import measured_position, position_note
from photogram.project.positions.frozen import frozen_positions
from photogram.project.project import Project, ProjectPhotograph
from photogram.project.validation.positions import time_findings
from photogram.quality.cloud_comparison import compare, triangulate
from photogram.quality.gross_errors.blunder_naming import withdrawn_attitudes
from photogram.quality.gross_errors.snooped_adjustment import adjust_and_judge
from photogram.quality.improvements import block_deformation
from photogram.sfm.orientation import Orientation, believed_attitudes, orient
from photogram.sfm.reconstruction import Structure
from photogram.sfm.tie_points.features import SMALLEST_PX, coarseness, find_features, photographs_at_once, picture_scale
from photogram.sfm.tie_points.guided_matching import Found, cut_patches, transfer_to, with_found
from photogram.sfm.tie_points.matching import match_pair
from photogram.sfm.tie_points.pairs import SelectedPairs, select_pairs
from photogram.sfm.tie_points.retrieval import most_similar
from photogram.sfm.tie_points.tracks import join_matches, key_point_sigmas_px
from photogram.surface.tin_dsm import surface_with_sigma
from photogram.survey import Features, Matches, PointCloud, Raster, TiePoints
from photogram.triangulation import ideal_observations, intersect_tie_points


class Progress(Protocol):
    """Told by a stage how far it is."""

    def __call__(self, done: int, total: int, text: str) -> None:
        """``done`` of ``total`` pieces are finished; ``total`` is 0 while it is not known."""


# ---- photographs ---------------------------------------------------------------------------------------------------


def _described(
    project: Project, photograph: ProjectPhotograph, sha256: str
) -> tuple[dict[str, object], PhotographTags]:
    """Decode a photograph once, so that damage shows before hours of work, and return what is known of its pose, and
    its tags."""
    camera = project.cameras[photograph.camera]
    check_photograph(photograph.path, (camera.width_px, camera.height_px), sha256)
    tags = read_tags(photograph.path)
    angles = photograph.attitude_deg
    gimbal = (tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg)
    if angles is None and None not in gimbal:
        angles = gimbal  # type: ignore[assignment]
    note = {
        "name": photograph.name,
        **position_note(measured_position(project, photograph, tags)),
        "height_is_ellipsoidal": tags.height_is_ellipsoidal,
        "attitude_deg": None if angles is None else list(angles),
        "time": tags.time.isoformat() if tags.time else None,
        "height_above_ground_m": photograph.height_above_ground_m or tags.height_above_take_off_m,
    }
    return note, tags


def _leave_out_copies(run: Run, notes: Sequence[dict[str, object]], tags: Sequence[PhotographTags]) -> int:
    """Note of each photograph that is another one saved again which that is; it then measures nothing. Returns how many
    there are."""
    photographs = run.project.photographs
    groups = find_copies([p.path for p in photographs], tags, [p.camera for p in photographs], run.executor)
    for original, *copies in groups:
        for i in copies:
            notes[i].update(position_note(None), attitude_deg=None, copy_of=photographs[original].name)
    return sum(len(group) - 1 for group in groups)


def _leave_out_frozen(notes: Sequence[dict[str, object]], times: Sequence[datetime | None]) -> int:
    """Note which positions a receiver gave that had stopped; they are not used. Returns how many there are."""
    nowhere = (np.nan,) * 3
    stated = np.array([note["gnss_map_m"] or nowhere for note in notes], dtype=np.float64).reshape(-1, 3)
    frozen = frozen_positions(stated, times)
    for note, stopped in zip(notes, frozen, strict=True):
        if stopped:
            note.update(position_note(None), gnss_frozen=True)
    return int(frozen.sum())


def read_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Decode every photograph and note its GNSS position and attitude; every damaged one is named at once.

    A photograph that is there twice is used once, and positions of a receiver that had stopped are not used.
    """
    photographs = run.project.photographs
    known = zip(photographs, run.photograph_fingerprints, strict=True)
    futures = [run.executor.submit(_described, run.project, photograph, sha256) for photograph, sha256 in known]
    notes, tags, faults = list[dict[str, object]](), list[PhotographTags](), list[str]()
    for done, future in enumerate(futures, 1):
        try:
            note, own = future.result()
            notes.append(note)
            tags.append(own)
        except PhotogramError as fault:
            faults.append(str(fault))
        progress(done, len(futures), photographs[done - 1].name)
    if faults:
        raise ImageError("\n".join(faults))
    times = [None if note["time"] is None else datetime.fromisoformat(str(note["time"])) for note in notes]
    contradictions = [f for f in time_findings(list(zip(photographs, times, strict=True))) if f.severity == "error"]
    if contradictions:
        raise ProjectError("\n".join(map(str, contradictions)))
    copies, frozen = _leave_out_copies(run, notes, tags), _leave_out_frozen(notes, times)
    write_json(folder / "tags.json", notes)
    summary = {"photographs": len(notes), "copies": copies, "frozen_positions": frozen}
    return {name: count for name, count in summary.items() if count or name == "photographs"}


# ---- features, matches, tie points ---------------------------------------------------------------------------------


REDUCTIONS = {"high": 1, "medium": 2, "low": 4}


def _coarseness(project: Project, photograph: int) -> float:
    """Return how much coarser than with ``quality: high`` the picture is in which key points of a photograph are
    found."""
    camera = project.cameras[project.photographs[photograph].camera]
    return coarseness(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])


def detect_features(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Find key points, one file per photograph; photographs that an interrupted run has finished are kept.

    As many photographs at once as there are workers and as the memory holds.
    """
    project = run.project
    reduction = REDUCTIONS[project.quality]
    largest = max(camera.width_px * camera.height_px for camera in project.cameras)
    room = BoundedSemaphore(photographs_at_once(largest // reduction**2))

    def detect(index: int) -> int:
        path = folder / f"{index:05d}.npz"
        if not path.is_file():
            with room:
                found = find_features(run.names[index], run.pixels(index), project.features, reduction)
            write_record(path, found)
        return len(read_record(path, Features))

    counts = []
    for index, count in enumerate(run.executor.map(detect, range(len(run.names)))):
        counts.append(count)
        progress(index + 1, len(run.names), run.names[index])
    return {"key_points": counts}


def select_photograph_pairs(run: Run) -> SelectedPairs:
    """Select the pairs of photographs to match; where positions are missing, by what the photographs show."""
    block, settings = run.block(), run.project.pairs
    used = [i for i, note in enumerate(run.notes()) if note.get("copy_of") is None]
    photographs = [block.photographs[i] for i in used]
    similar = None
    if any(photograph.gnss_world_m is None for photograph in photographs):
        similar = most_similar(lambda i: run.features(used[i]), len(used), 3 * settings.retrieved)
    selected = select_pairs(photographs, block.cameras, settings, similar=similar)
    return replace(selected, pairs=tuple((used[i], used[j]) for i, j in selected.pairs))


def choose_pairs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Select the pairs of photographs to match."""
    selected = select_photograph_pairs(run)
    write_json(folder / "pairs.json", [list(pair) for pair in selected.pairs])
    progress(1, 1, f"{len(selected)} pairs")
    return {
        "pairs": len(selected),
        "selected_by": {reason: selected.reasons.count(reason) for reason in sorted(set(selected.reasons))},
    }


def match_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Match and verify all selected pairs, one file per pair; pairs that an interrupted run has finished are kept."""
    project, pairs = run.project, run.selected_pairs()

    def match(pair: tuple[int, int]) -> bool:
        i, j = pair
        path = folder / f"{i:05d}-{j:05d}.npz"
        if not path.is_file():
            cameras = (project.cameras[project.photographs[i].camera], project.cameras[project.photographs[j].camera])
            coarser = max(_coarseness(project, i), _coarseness(project, j))
            matches, good = match_pair(pair, cameras, (run.features(i), run.features(j)), project.matching, coarser)
            write_arrays(path, {"index": matches.index, "verified": good})
        return bool(read_arrays(path)["verified"].any())

    verified = 0
    with threadpool_limits(1, "blas"):  # the pairs keep the cores busy already
        for done, ((i, j), found) in enumerate(zip(pairs, run.executor.map(match, pairs), strict=True)):
            verified += found
            progress(done + 1, len(pairs), f"{run.names[i]} – {run.names[j]}")
    write_json(folder / "pairs.json", pairs)
    return {"pairs": len(pairs), "verified_pairs": verified}


def _key_point_sigmas_px(project: Project, photograph: int, features: Features) -> FloatArray:
    """Return the standard deviations (N,) of the key points of a photograph."""
    camera = project.cameras[project.photographs[photograph].camera]
    scale = picture_scale(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])
    best_px = project.adjustment.tie_point_sigma_px * _coarseness(project, photograph)
    return key_point_sigmas_px(features.size_px, SMALLEST_PX * scale, best_px)


def join_tie_points(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Join verified matches to tie points over all photographs."""
    features = [run.features(i) for i in range(len(run.names))]
    matches = [Matches(m.first, m.second, m.index[good]) for m, good in run.matches()]
    sigmas_px = [_key_point_sigmas_px(run.project, i, f) for i, f in enumerate(features)]
    joined = join_matches(features, matches, sigmas_px)
    if not len(joined.tie_points):
        raise ImageError(
            f"no two of the {len(features)} photographs have {run.project.matching.minimum_inliers} verified matches "
            "in common: give photographs of one site that overlap by 60 % or more"
        )
    write_record(folder / "tie_points.npz", joined.tie_points)
    progress(1, 1, f"{len(joined.tie_points)} tie points")
    return {"tie_points": len(joined.tie_points), "conflicts": joined.conflicts}


# ---- orientation ---------------------------------------------------------------------------------------------------


def _with_copies(found: Orientation, kept: Sequence[int], copies: Sequence[str | None]) -> Orientation:
    """Return the orientation of the photographs ``kept`` as one of all; the others are ``copies`` of those named."""
    place = {i: k for k, i in enumerate(kept)}
    rows = [place.get(i) for i in range(len(copies))]
    return replace(
        found,
        poses=tuple(None if k is None else found.poses[k] for k in rows),
        resections=tuple(None if k is None else found.resections[k] for k in rows),
        component=np.array([-1 if k is None else found.component[k] for k in rows], dtype=np.int64),
        reason=tuple(
            f"the same photograph as {copy}" if k is None else found.reason[k]
            for k, copy in zip(rows, copies, strict=True)
        ),
    )


def orient_photographs(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Find a starting pose for every photograph that can be joined to the block."""
    block = replace(run.block(), tie_points=run.tie_points())
    copies = [note.get("copy_of") for note in run.notes()]
    part, kept = part_of_block(block, np.array([copy is None for copy in copies], dtype=bool))
    orientation = _with_copies(orient(part, run.project.orientation, progress), kept.tolist(), copies)
    write_json(folder / "poses.json", orientation_to(orientation, run.names))
    registered = int(orientation.registered.sum())
    progress(len(run.names), len(run.names), f"{registered} of {len(run.names)} oriented")
    return {
        "method": orientation.method,
        "registered": registered,
        "resected": sum(r is not None for r in orientation.resections),
    }


# ---- transfer ------------------------------------------------------------------------------------------------------


def _oriented_tie_points(run: Run, orientation: Orientation) -> TiePoints:
    """Return the tie points with positions, and those of their observations that agree with the oriented block."""
    block, tie_points = run.block(), run.tie_points()
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    structure = Structure.empty(tie_points, orientation.calibrated(block.cameras), camera_of, run.project.orientation)
    for index, pose in enumerate(orientation.poses):
        if pose is not None:
            structure.register(index, pose)
    structure.intersect()
    return replace(tie_points, position_world_m=structure.point).select(structure.known, structure.good)


def transfer_tie_points(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Measure tie points in the further photographs that show them.

    Poses from control points alone are too rough to predict places by; there the tie points stay as they are.
    """
    project, orientation, joined = run.project, run.orientation(), run.tie_points()
    if orientation.method == "control" or project.transfer.correlation == 1.0:
        write_record(folder / "tie_points.npz", joined)
        return {"tie_points": len(joined), "transferred": 0}
    tie_points = _oriented_tie_points(run, orientation)
    calibrated = orientation.calibrated(project.cameras)
    cameras = [calibrated[p.camera] for p in project.photographs]
    position = np.array([np.zeros(3) if p is None else p.position_world_m for p in orientation.poses])
    progress(0, len(cameras), "windows")
    patches = cut_patches(tie_points, position, run.grey)

    def search(index: int) -> Found:
        return transfer_to(index, tie_points, patches, cameras, orientation.poses, run.grey(index), project.transfer)

    found = []
    for index, places in enumerate(run.executor.map(search, range(len(cameras)))):
        found.append(places)
        progress(index + 1, len(cameras), run.names[index])
    whole = with_found(tie_points, found, project.adjustment.tie_point_sigma_px)
    write_record(folder / "tie_points.npz", whole)
    return {
        "tie_points": len(whole),
        "disagreeing": len(joined.photograph) - len(tie_points.photograph),
        "transferred": len(whole.photograph) - len(tie_points.photograph),
    }


# ---- clouds --------------------------------------------------------------------------------------------------------


def intersect_clouds(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Intersect tie points linearly from the photographs as oriented, from two and from three views each."""
    block, tie_points, orientation = run.block(), run.transferred_tie_points(), run.orientation()
    camera_of = np.array([p.camera for p in block.photographs], dtype=np.int64)
    ideal = ideal_observations(orientation.calibrated(block.cameras), camera_of, tie_points)
    counts = {}
    for rays in (2, 3):
        world = intersect_tie_points(tie_points, ideal, orientation.poses, rays)
        known = np.isfinite(world).all(axis=1)
        cloud = _cloud(block.frame, world[known], tie_points.colour[known])
        write_record(folder / f"linear_{rays}view.npz", cloud)
        counts[f"linear_{rays}view"] = len(cloud)
        progress(rays - 1, 2, f"{len(cloud)} points from {rays} views")
    return counts


def _cloud(
    frame: LocalFrame, position_world_m: FloatArray, colour: ByteArray, sigma_m: FloatArray | None = None
) -> PointCloud:
    """Return points (N, 3) of the world as a cloud in the map, without those where the geoid has no height."""
    position = frame.map_from_world(position_world_m)
    known = np.isfinite(position).all(axis=1)
    return PointCloud(position[known], colour[known], None if sigma_m is None else sigma_m[known])


def _sigma_map_m(
    frame: LocalFrame, covariance_m2: np.ndarray[Any, np.dtype[np.float64]]
) -> np.ndarray[Any, np.dtype[np.float64]]:
    R = frame.rotation_world_from_map(np.zeros(3))
    return np.asarray(np.sqrt(np.einsum("ki,nkl,li->ni", R, covariance_m2, R)))


def adjust_block(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Adjust the block jointly."""
    orientation = run.orientation()
    block = replace(run.block(), tie_points=run.transferred_tie_points(), poses=orientation.poses)
    measured = block
    if orientation.method != "control":
        block = replace(block, photographs=believed_attitudes(block, orientation.poses))
    kinds = zip(block.cameras, run.project.calibration, strict=True)
    block = replace(block, cameras=tuple(with_priors(c) if kind == "auto" else c for c, kind in kinds))
    settings, start = run.project.adjustment, orientation.parameters
    readings_px = run.project.focal_readings_px
    verdict = adjust_and_judge(block, settings, start, lambda text: progress(0, 0, text), readings_px)
    blunders = [*verdict.blunders, *withdrawn_attitudes(measured, block, verdict.result)]
    progress(0, 0, "deformation of the block")
    known_before = [camera.parameters for camera in block.cameras]
    deformation = block_deformation(verdict.result, run.project.adjustment, known_before)
    result = replace(verdict.result, deformation=deformation)
    frame, tie_points = block.frame, result.block.tie_points
    sigma = _sigma_map_m(frame, result.tie_point_covariance_m2)
    cloud = _cloud(frame, tie_points.position_world_m, tie_points.colour, sigma)
    write_record(folder / "adjusted.npz", cloud)
    write_record(folder / "tie_points.npz", tie_points)
    write_arrays(folder / "adjustment.npz", adjustment_arrays(result))
    write_record(folder / "reliability.npz", result.reliability)
    write_record(folder / "components.npz", result.components)
    write_record(folder / "deformation.npz", result.deformation)
    write_json(folder / "held.json", held_parameters(block.cameras, result, verdict.focal_lengths))
    write_json(
        folder / "verdict.json",
        {
            "accused": [(a.kind, a.name, a.photograph, list(a.axes)) for a in verdict.rejected],
            "blunders": blunders,
            "focal_lengths": {name: decision.sentence for name, decision in verdict.focal_lengths.items()},
            "check_points": verdict.check_before,
            "check_points_without": verdict.check_after,
        },
    )
    return {
        "sigma0": result.sigma0,
        "converged": result.converged,
        "blunders": len(blunders),
        "iterations": result.iterations,
        "disbelieved_headings": sum(not p.heading_known for p in block.photographs),
        "disbelieved_attitudes": sum(
            m.attitude_sigma_rad is not None and p.attitude_sigma_rad is None
            for m, p in zip(measured.photographs, block.photographs, strict=True)
        ),
    }


HEIGHT, SIGMA = "height of the surface", "standard deviation of the height"
RELATIVE_SIGMA = "standard deviation of the height relative to the survey's mean height, without the datum"
RELATIVE_SIGMA_FILE = "dsm_sigma_relative.tif"
"""Descriptions of the bands of `dsm.tif`, `dsm_sigma.tif` and RELATIVE_SIGMA_FILE."""


def interpolate_surface(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Make the DSM from the adjusted tie points alone, and the standard deviations of its heights."""
    surface = surface_with_sigma(run.cloud("adjusted"), run.precision(), run.project.surface, run.shape())
    raster = surface.heights
    write_geotiff(folder / "dsm.tif", raster, run.project.product_crs, description=HEIGHT)
    write_geotiff(folder / "dsm_sigma.tif", surface.sigma, plan_of(run.project.crs), description=SIGMA)
    if surface.relative is not None:
        path, plan = folder / RELATIVE_SIGMA_FILE, plan_of(run.project.crs)
        write_geotiff(path, surface.relative, plan, description=RELATIVE_SIGMA)
    write_arrays(folder / "held_out.npz", {"held_out_m": surface.held_out_m})
    rows, columns = raster.values.shape
    progress(1, 1, f"{columns} × {rows} cells of {raster.cell_m:g} m")
    return {"rows": rows, "columns": columns, "cell_m": raster.cell_m}


# ---- comparison ----------------------------------------------------------------------------------------------------


def read_reference(path: Path) -> Raster | PointCloud:
    """Read a reference surface: a GeoTIFF, or a cloud as text, LAS or LAZ. Raises ProjectError when it cannot be
    read."""
    return read_raster(path)[0] if path.suffix.lower() in {".tif", ".tiff"} else read_cloud(path)


def _with_map_heights(project: Project, reference: Raster | PointCloud) -> Raster | PointCloud:
    """Return the reference with the heights of the map, each point or cell by itself."""
    crs, heights = project.crs, project.heights
    if heights.sign_to_map(heights.reference) == 0.0:
        return reference
    if isinstance(reference, PointCloud):
        return replace(reference, position_map_m=map_heights(crs, heights, heights.reference, reference.position_map_m))
    values = reference.values.copy()
    row, column = np.nonzero(np.isfinite(values))
    east = reference.west_map_m + (column + 0.5) * reference.cell_m
    north = reference.north_map_m - (row + 0.5) * reference.cell_m
    cells = np.column_stack([east, north, values[row, column]])
    values[row, column] = map_heights(crs, heights, heights.reference, cells)[:, 2]
    return replace(reference, values=values)


def compare_clouds(run: Run, folder: Path, progress: Progress) -> Mapping[str, object]:
    """Compare the clouds with the reference, when the project names one."""
    statistics: dict[str, object] = {}
    if run.project.reference is not None:
        given = _with_map_heights(run.project, read_reference(run.project.reference))
        reference = triangulate(given) if isinstance(given, PointCloud) else given
        for name in ("linear_2view", "linear_3view", "adjusted"):
            cloud = run.cloud(name)
            if len(cloud) >= 3:
                comparison = compare(cloud, reference)
                statistics[name] = write_comparison(folder / f"{name}.npz", comparison)
            progress(len(statistics), 3, name)
    write_json(folder / "statistics.json", statistics)
    return {"clouds": len(statistics)}


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
