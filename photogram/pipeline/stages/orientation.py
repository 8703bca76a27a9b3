"""The stages `orientation`, `transfer` and `intersection`: starting poses, more rays of tie points, linear clouds."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.adjustment.oriented_subset import part_of_block
from photogram.arrays import BoolArray
from photogram.camera import Camera, Pose
from photogram.files.atomic import make_folder
from photogram.files.npz_json import file_fingerprint, fingerprint, read_json, write_json
from photogram.files.photographs.masks import read_mask, write_mask
from photogram.files.records import read_record, write_record
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import LIBRARIES_BYTES, TIE_POINT_BYTES, Costs, Memory, Rate
from photogram.pipeline.stages.features import orientation_thresholds, transfer_thresholds
from photogram.pipeline.stages.tie_points import stored_tie_points
from photogram.pipeline.store.pieces import PieceType, run_pieces
from photogram.pipeline.store.run import AUTOMATIC_MASKS, Run, mask_file
from photogram.project.project import Project
from photogram.project.rigs.entries import bands_of
from photogram.projection import CX
from photogram.sfm.known_poses import KnownPoses
from photogram.sfm.orientation import Orientation, orient
from photogram.sfm.reconstruction import Structure
from photogram.sfm.rig_poses import carried_by_masters
from photogram.sfm.sky import find_sky, shows_above_horizon
from photogram.sfm.tie_points.band_matching import transfer_to_band
from photogram.sfm.tie_points.guided_matching import (
    Patches,
    TransferredPoints,
    cut_patches,
    transfer_to,
    with_transferred,
)
from photogram.survey import Block, PointCloud, TiePoints
from photogram.triangulation import ideal_observations, intersect_tie_points
from photogram.wording import Progress, things


class OrientationSummary(TypedDict):
    """What the stage `orientation` says of itself."""

    method: str
    """Method that found the starting poses."""
    registered: int
    """Number of photographs oriented."""
    resected: int
    """Number of photographs resected from control points."""


class TransferSummary(TypedDict, total=False):
    """What the stage `transfer` says of itself."""

    tie_points: int
    """Number of tie points."""
    disagreeing: int
    """Number of observations that disagree with the oriented block."""
    transferred: int
    """Number of further observations."""
    sky: int
    """Number of photographs in which sky is masked, where that is asked for."""


class IntersectionSummary(TypedDict):
    """What the stage `intersection` says of itself."""

    linear_2view: int
    """Number of points from two views."""
    linear_3view: int
    """Number of points from three views."""


ORIENTATION_FILE, PLACED_BY = "orientation.npz", "placed_by.json"


@dataclass(frozen=True)
class GeoreferencedBy:
    """What an orientation owes to control points: ``control`` is the fingerprint of those that it was made with,
    ``poses`` whether any pose is a resection from them. Where none is, the block came from its tie points, and control
    points have only placed it in the world."""

    control: str
    poses: bool


def control_fingerprint(project: Project) -> str:
    """Return the fingerprint of the project's ground points with their roles and marks."""
    return fingerprint(project.control_points_in(LocalFrame(project.crs, (0.0, 0.0, 0.0), "grid")))


def _readable(orientation: Orientation, names: Sequence[str]) -> dict[str, object]:
    """Return starting poses and resections as people read them, by photograph."""
    rows = zip(names, orientation.poses, orientation.resections, orientation.component, orientation.reason, strict=True)
    keys = ("name", "pose", "resection", "component", "reason")
    return {
        "method": orientation.method,
        "photographs": [dict(zip(keys, row, strict=True)) for row in rows],
        "parameters": orientation.parameters,
    }


def _with_copies(orientation: Orientation, kept: Sequence[int], copies: Sequence[str | None]) -> Orientation:
    """Return the orientation of the photographs ``kept`` as one of all; the others are ``copies`` of those named."""
    place = {i: k for k, i in enumerate(kept)}
    rows = [place.get(i) for i in range(len(copies))]
    return replace(
        orientation,
        poses=tuple(None if k is None else orientation.poses[k] for k in rows),
        resections=tuple(None if k is None else orientation.resections[k] for k in rows),
        component=np.array([-1 if k is None else orientation.component[k] for k in rows], dtype=np.int64),
        reason=tuple(
            f"the same photograph as {copy}" if k is None else orientation.reason[k]
            for k, copy in zip(rows, copies, strict=True)
        ),
    )


def _known_poses(run: Run, block: Block) -> KnownPoses | None:
    """Return the poses that the project starts from, None where it starts from none."""
    if run.project.start is None or run.project.start.poses == "own" or run.start is None:
        return None
    return KnownPoses(run.start.poses, run.start.calibrated(block.cameras))


def orient_photographs(run: Run, folder: Path, progress: Progress) -> OrientationSummary:
    """Find a starting pose for every photograph that can be joined to the block, by its tie points or by its rig."""
    block = replace(run.block(), tie_points=stored_tie_points(run))
    copies = [note.get("copy_of") for note in run.notes()]
    part, kept = part_of_block(block, np.array([copy is None for copy in copies], dtype=bool))
    known = _known_poses(run, block)
    of_part = orient(
        part, orientation_thresholds(run.project), progress, None if known is None else known.only(kept.tolist())
    )
    if part.rigs:
        of_part = carried_by_masters(part, of_part)
    orientation = _with_copies(of_part, kept.tolist(), copies)
    write_record(folder / ORIENTATION_FILE, orientation)
    write_json(folder / "poses.json", _readable(orientation, run.names))
    write_json(folder / PLACED_BY, GeoreferencedBy(control_fingerprint(run.project), orientation.rests_on_control))
    registered = int(orientation.registered.sum())
    progress(len(run.names), len(run.names), f"{registered} of {len(run.names)} oriented")
    return {
        "method": orientation.method,
        "registered": registered,
        "resected": sum(r is not None for r in orientation.resections),
    }


def stored_orientation(run: Run) -> Orientation:
    """Return starting poses and resections. Needs the stage `orientation`."""
    return read_record(run.workspace.file("orientation", ORIENTATION_FILE), Orientation)


def georeferenced_by(run: Run) -> GeoreferencedBy:
    """Return what the orientation owes to control points. Needs the stage `orientation`."""
    return GeoreferencedBy(**read_json(run.workspace.file("orientation", PLACED_BY)))


def _oriented_tie_points(run: Run, orientation: Orientation) -> TiePoints:
    """Return the tie points with positions, and those of their observations that agree with the oriented block."""
    block, tie_points = run.block(), stored_tie_points(run)
    camera_of = block.camera_of
    cameras = orientation.calibrated(block.cameras)
    structure = Structure.oriented(
        tie_points, cameras, camera_of, orientation_thresholds(run.project), orientation.poses
    )
    return replace(tie_points, position_world_m=structure.point).select(structure.known, structure.good)


def _used(run: Run, folder: Path, index: int) -> BoolArray | None:
    """Return which pixels of a photograph are used in the stage `transfer`, whose folder has the automatic masks."""
    used, path = run.given_mask(index), folder / mask_file(index)
    if not path.is_file():
        return used
    automatic = read_mask(path)
    return automatic if used is None else used & automatic


@dataclass(frozen=True, eq=False)
class _Transfer:
    """What is searched for in every photograph, and what the photographs are; the ``folder`` has their automatic
    masks."""

    run: Run
    folder: Path
    tie_points: TiePoints
    patches: Patches
    cameras: Sequence[Camera]
    poses: Sequence[Pose | None]
    master_of: Mapping[int, tuple[int, float]]
    """The master's photograph of the same exposure, of each photograph of a band, and how far from its predicted places
    the band may show the ground, px."""

    @staticmethod
    def of(
        run: Run, folder: Path, orientation: Orientation, tie_points: TiePoints, patches: Patches | None = None
    ) -> _Transfer:
        """Return it for oriented tie points; the windows around them are cut out where they are not given."""
        calibrated = orientation.calibrated(run.project.cameras)
        position = np.array([np.zeros(3) if p is None else p.position_world_m for p in orientation.poses])
        patches = patches or cut_patches(tie_points, position, run.grey, lambda index: _used(run, folder, index))
        cameras = [calibrated[p.camera] for p in run.project.photographs]
        return _Transfer(run, folder, tie_points, patches, cameras, orientation.poses, _masters_of_bands(run, cameras))

    def write(self, folder: Path) -> None:
        """Write what cannot be read from earlier stages, for other processes."""
        make_folder(folder / _WINDOWS)
        write_record(folder / _WINDOWS / "tie_points.npz", self.tie_points)
        write_record(folder / _WINDOWS / "patches.npz", self.patches)

    @staticmethod
    def read(run: Run, folder: Path) -> _Transfer:
        """Return what another process wrote."""
        tie_points = read_record(folder / _WINDOWS / "tie_points.npz", TiePoints)
        patches = read_record(folder / _WINDOWS / "patches.npz", Patches)
        return _Transfer.of(run, folder, stored_orientation(run), tie_points, patches)


_WINDOWS = "windows"


def _masters_of_bands(run: Run, cameras: Sequence[Camera]) -> dict[int, tuple[int, float]]:
    """Return what ``_Transfer.master_of`` holds: the reach is three standard deviations of a relative rotation that is
    given, and of the principal point."""
    bands, number = bands_of(run.project.rigs), {name: i for i, name in enumerate(run.names)}
    masters = dict[int, tuple[int, float]]()
    for rig in run.block().rigs:
        if rig.name not in bands:
            continue
        for band, master in rig.exposures:
            if band in number and master in number:
                camera, turn = cameras[number[band]], float(rig.sigma[:3].max())
                reach = 3.0 * float(np.hypot(turn * camera.focal_px, camera.sigmas[CX])) if np.isfinite(turn) else 0.0
                masters[number[band]] = number[master], reach
    return masters


def _search(transfer: _Transfer, index: int) -> TransferredPoints:
    """Search one photograph, and that of a band for what its master shows beside it."""
    run, tie, folder = transfer.run, transfer.tie_points, transfer.folder
    settings, grey, used = transfer_thresholds(run.project), run.grey(index), _used(run, folder, index)
    own = transfer_to(index, tie, transfer.patches, transfer.cameras, transfer.poses, grey, settings, used)
    if index not in transfer.master_of:
        return own
    master, reach_px = transfer.master_of[index]
    known = np.concatenate([tie.point[tie.photograph == index], own.point])
    by_master = transfer_to_band(
        (master, index), tie, known, transfer.cameras, transfer.poses, (run.grey(master), grey), settings,
        (_used(run, folder, master), used), reach_px,
    )  # fmt: skip
    return TransferredPoints(np.concatenate([own.point, by_master.point]), np.concatenate([own.pixel, by_master.pixel]))


_SEARCHED = PieceType(_Transfer.read, _search)


def mask_sky(run: Run, folder: Path, orientation: Orientation, progress: Progress) -> TransferSummary:
    """Find sky in the oriented photographs, and write its masks and the share of each photograph that they leave out;
    without a vertical nothing is known to lie above the horizon."""
    block, tie_points = run.block(), _oriented_tie_points(run, orientation)
    calibrated = orientation.calibrated(block.cameras)

    def sky_share(index: int) -> float:
        pose, path = orientation.poses[index], folder / mask_file(index)
        if pose is None or block.is_free:
            return 0.0
        if not path.is_file():
            camera = calibrated[block.photographs[index].camera]
            up = block.frame.rotation_world_from_map(pose.position_world_m)[:, 2]
            if not shows_above_horizon(camera, pose, up):
                return 0.0
            sky = find_sky(camera, pose, up, run.grey(index), tie_points.pixel[tie_points.photograph == index])
            if sky is None or sky.all():
                return 0.0
            write_mask(path, ~sky)
        return 1.0 - float(read_mask(path).mean())

    shares = dict[str, float]()
    for index, share in enumerate(run.executor.map(sky_share, range(len(run.names)))):
        if share:
            shares[run.names[index]] = share
        progress(index + 1, len(run.names), "sky")
    write_json(folder / AUTOMATIC_MASKS, shares)
    return {"sky": len(shares)}


def transfer_tie_points(run: Run, folder: Path, progress: Progress) -> TransferSummary:
    """Find automatic masks, and measure tie points in the further photographs that show them.

    Poses from control points alone are too rough to predict places by; there the tie points stay as they are.
    """
    project, orientation, joined = run.project, stored_orientation(run), stored_tie_points(run)
    masked: TransferSummary = mask_sky(run, folder, orientation, progress) if "sky" in project.masks.auto else {}
    if orientation.method == "control" or project.transfer.correlation == 1.0:
        write_record(folder / "tie_points.npz", joined)
        return {"tie_points": len(joined), "transferred": 0, **masked}
    tie_points = _oriented_tie_points(run, orientation)
    progress(0, len(run.names), "windows")
    transfer = _Transfer.of(run, folder, orientation, tie_points)
    if run.pool is not None:
        transfer.write(folder)
    transferred = []
    for index, places in enumerate(run_pieces(run, folder, _SEARCHED, range(len(run.names)), state=transfer)):
        transferred.append(places)
        progress(index + 1, len(run.names), run.names[index])
    if run.pool is not None:
        shutil.rmtree(folder / _WINDOWS)
    whole = with_transferred(tie_points, transferred, project.adjustment.tie_point_sigma_px)
    write_record(folder / "tie_points.npz", whole)
    return {
        "tie_points": len(whole),
        "disagreeing": len(joined.photograph) - len(tie_points.photograph),
        "transferred": len(whole.photograph) - len(tie_points.photograph),
        **masked,
    }


def transferred_tie_points(run: Run) -> TiePoints:
    """Return the tie points with what was measured of them in further photographs. Needs the stage `transfer`."""
    return read_record(run.workspace.file("transfer", "tie_points.npz"), TiePoints)


def intersect_clouds(run: Run, folder: Path, progress: Progress) -> IntersectionSummary:
    """Intersect tie points linearly from the photographs as oriented, from two and from three views each."""
    block, tie_points, orientation = run.block(), transferred_tie_points(run), stored_orientation(run)
    camera_of = block.camera_of
    ideal = ideal_observations(orientation.calibrated(block.cameras), camera_of, tie_points)
    counts = list[int]()
    for rays in (2, 3):
        world = intersect_tie_points(tie_points, ideal, orientation.poses, rays)
        known = np.isfinite(world).all(axis=1)
        cloud = PointCloud.from_world(block.frame, world[known], tie_points.colour[known])
        write_record(folder / f"linear_{rays}view.npz", cloud)
        counts.append(len(cloud))
        progress(rays - 1, 2, f"{len(cloud)} points from {rays} views")
    return {"linear_2view": counts[0], "linear_3view": counts[1]}


def _transfer_words(summary: TransferSummary) -> str:
    sky = f", sky masked in {things(summary['sky'], 'photograph')}" if "sky" in summary else ""
    if not summary["transferred"]:
        return f"{things(summary['tie_points'], 'tie point')}, no further observations{sky}"
    further = things(summary["transferred"], "further observation")
    return f"{further} of {things(summary['tie_points'], 'tie point')}{sky}"


_METHODS = {
    "control": "from control points",
    "attitude": "from measured positions and attitudes",
    "growth": "from a first pair, photograph by photograph",
    "start": "from the solution that the project starts from",
}


def _orientation_words(summary: OrientationSummary) -> str:
    how = _METHODS.get(summary["method"], f"by {summary['method']}")
    return f"{things(summary['registered'], 'photograph')} oriented, {how}"


def _intersection_words(summary: IntersectionSummary) -> str:
    return f"{summary['linear_2view']} points from two views, {summary['linear_3view']} from three"


def _settings(run: Run, control: str) -> object:
    start = run.project.start
    known_poses = [] if start is None or start.poses == "own" else [file_fingerprint(start.solution)]
    return [run.project.orientation, control, *known_poses]


def _as_made(run: Run) -> object | None:
    """Return what the stage `orientation` was made under where every pose came from tie points, whatever the control
    points now are: they place such a block in the world, which the adjustment does again. None where one came from
    control points, or the stage is not there."""
    if run.workspace.mark("orientation") is None or not run.workspace.has("orientation", PLACED_BY):
        return None
    placed = georeferenced_by(run)
    return None if placed.poses else _settings(run, placed.control)


ORIENTATION: Stage = Stage(
    "orientation",
    "Orientation",
    ("photographs", "tie_points"),
    lambda run: _settings(run, control_fingerprint(run.project)),
    orient_photographs,
    line_of(OrientationSummary, _orientation_words),
    Costs(
        0.1,
        (Rate("photographs", 0.01, pieces=False), Rate("observations", 3e-5, pieces=False)),
        12.0,
        ("photogram.triangulation", "photogram.projection"),
        memory=lambda extent: Memory(LIBRARIES_BYTES + extent.block_bytes),
    ),
    _as_made,
)

TRANSFER: Stage = Stage(
    "transfer",
    "Tie point transfer",
    ("photographs", "tie_points", "orientation"),
    lambda run: [
        run.project.transfer,
        run.project.adjustment.tie_point_sigma_px,
        *([("sky",)] if "sky" in run.project.masks.auto else []),
    ],
    transfer_tie_points,
    line_of(TransferSummary, _transfer_words),
    Costs(
        0.02,
        (Rate("megapixels", 0.025), Rate("observations", 5e-5)),
        2.6,
        ("photogram.sfm.tie_points.guided_matching",),
        disk_bytes=lambda extent: TIE_POINT_BYTES * extent.key_points,
        memory=lambda extent: Memory(LIBRARIES_BYTES + extent.block_bytes + 4.0 * extent.workers * extent.largest_px),
    ),
)

INTERSECTION: Stage = Stage(
    "intersection",
    "Linear intersection",
    ("orientation", "transfer"),
    lambda _: None,
    intersect_clouds,
    line_of(IntersectionSummary, _intersection_words),
    Costs(0.03, (Rate("observations", 2e-6, pieces=False),)),
)
