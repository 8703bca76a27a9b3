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
from photogram.files.npz_json import write_json
from photogram.files.photographs.masks import read_mask, write_mask
from photogram.files.records import read_record, write_record
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import LIBRARIES_BYTES, TIE_POINT_BYTES, Costs, Memory, Rate
from photogram.pipeline.stages.features import orientation_thresholds, transfer_thresholds
from photogram.pipeline.store.dependence import (
    automatic_masks,
    control_fingerprint,
    orientation_as_made,
    orientation_settings,
)
from photogram.pipeline.store.pieces import PieceType, run_pieces
from photogram.pipeline.store.run import AUTOMATIC_MASKS, ORIENTATION_FILE, PLACED_BY, Run, mask_file
from photogram.pipeline.store.stored_results import GeoreferencedBy, starting_poses
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
    block = replace(run.block(), tie_points=run.tie_points())
    copies = [note.get("copy_of") for note in run.notes()]
    part, kept = part_of_block(block, np.array([copy is None for copy in copies], dtype=bool))
    known = _known_poses(run, block)
    found = orient(
        part, orientation_thresholds(run.project), progress, None if known is None else known.only(kept.tolist())
    )
    if part.rigs:
        found = carried_by_masters(part, found)
    orientation = _with_copies(found, kept.tolist(), copies)
    write_record(folder / ORIENTATION_FILE, orientation)
    write_json(folder / "poses.json", starting_poses(orientation, run.names))
    write_json(folder / PLACED_BY, GeoreferencedBy(control_fingerprint(run.project), orientation.rests_on_control))
    registered = int(orientation.registered.sum())
    progress(len(run.names), len(run.names), f"{registered} of {len(run.names)} oriented")
    return {
        "method": orientation.method,
        "registered": registered,
        "resected": sum(r is not None for r in orientation.resections),
    }


def _oriented_tie_points(run: Run, orientation: Orientation) -> TiePoints:
    """Return the tie points with positions, and those of their observations that agree with the oriented block."""
    block, tie_points = run.block(), run.tie_points()
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
    found = read_mask(path)
    return found if used is None else used & found


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
        return _Transfer.of(run, folder, run.orientation(), tie_points, patches)


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
    project, orientation, joined = run.project, run.orientation(), run.tie_points()
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


def intersect_clouds(run: Run, folder: Path, progress: Progress) -> IntersectionSummary:
    """Intersect tie points linearly from the photographs as oriented, from two and from three views each."""
    block, tie_points, orientation = run.block(), run.transferred_tie_points(), run.orientation()
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


ORIENTATION: Stage = Stage(
    "orientation",
    "Orientation",
    ("photographs", "tie_points"),
    orientation_settings,
    orient_photographs,
    line_of(OrientationSummary, _orientation_words),
    Costs(
        0.1,
        (Rate("photographs", 0.01, pieces=False), Rate("observations", 3e-5, pieces=False)),
        12.0,
        ("photogram.triangulation", "photogram.projection"),
        memory=lambda extent: Memory(LIBRARIES_BYTES + extent.block_bytes),
    ),
    orientation_as_made,
)

TRANSFER: Stage = Stage(
    "transfer",
    "Tie point transfer",
    ("photographs", "tie_points", "orientation"),
    lambda run: [
        run.project.transfer,
        run.project.adjustment.tie_point_sigma_px,
        *automatic_masks(run.project),
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
