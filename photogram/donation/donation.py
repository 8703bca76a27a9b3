"""What a survey measured and what came of it, as one file to give away."""

from __future__ import annotations

import gzip
import zlib
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from photogram import __version__
from photogram.adjustment.problem import AdjustmentSettings
from photogram.amendments.snooped_adjustment import Verdict, adjust_with_snooping
from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, Pose
from photogram.constraints.between_points import CommonSurface, Distance, HeightDifference
from photogram.constraints.rigs import Companion
from photogram.donation.anonymous_block import SiteAxes, anonymous
from photogram.errors import WorkspaceError
from photogram.files.atomic import replacing
from photogram.files.records import read_record, write_record
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.pipeline import is_up_to_date, open_run
from photogram.pipeline.stages.adjustment import adjustment_input
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.project.project import Project
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints, Photograph, TiePoints, UndeclaredHeights
from photogram.wording import things

FORMAT = 1
MOST_BYTES = 2**28
"""That a file may unpack to."""

MOST_OBSERVATIONS = 250_000
"""Observations of tie points that a file holds at most: some 4 MB."""
_INNER = "donation.npz"

REMOVED = (
    "photographs and colours, names of files, cameras, points and flights, dates, coordinates of the map and its CRS "
    "(places are counted from the middle of the site), masks, known surfaces, rasters and clouds"
)
"""What no donation holds, in words."""


@dataclass(frozen=True, eq=False)
class DonatedResult:
    """What the survey's own adjustment found, in the axes of the site: NaN where nothing was."""

    sigma0: float
    """Standard deviation of unit weight."""
    poses: tuple[Pose | None, ...]
    """Adjusted exterior orientations."""
    position_sigma_m: FloatArray
    """Standard deviations (N, 3) of the projection centres of the oriented photographs."""
    ground_m: FloatArray
    """Adjusted ground points (G, 3)."""
    ground_sigma_m: FloatArray
    """Their standard deviations (G, 3)."""


@dataclass(frozen=True, eq=False)
class Donation:
    """A survey without photographs, names, dates and place: what was measured, as the adjustment was given it."""

    format: int
    """Of the file."""
    photogram: str
    """Version that wrote it."""
    cameras: tuple[Camera, ...]
    """Cameras with their prior calibrations."""
    photographs: tuple[Photograph, ...]
    """Photographs with what was measured of each."""
    poses: tuple[Pose | None, ...]
    """Exterior orientations to start from, None of those that are not oriented."""
    tie_points: TiePoints
    """Tie points, or a part of them."""
    control_points: ControlPoints
    """Surveyed points and their marks."""
    gnss_offset_sigma_m: FloatArray
    """As of a block (3,)."""
    datum_sigma_m: float
    """As of a block."""
    undeclared_heights: UndeclaredHeights | None
    """As of a block."""
    rigs: tuple[Companion, ...]
    """Cameras that are fixed to another on one body."""
    distances: tuple[Distance, ...]
    """Measured distances."""
    height_differences: tuple[HeightDifference, ...]
    """Levelled differences."""
    surfaces: tuple[CommonSurface, ...]
    """Points on one level surface or one plane."""
    settings: AdjustmentSettings
    """Of the adjustment."""
    parameters: tuple[FloatArray, ...]
    """Interior orientation (12,) of each camera to start from; () where it is that of the cameras."""
    focal_readings_px: tuple[tuple[float, ...], ...]
    """Other readings of the source of each focal length."""
    result: DonatedResult
    """What the survey's own adjustment found."""
    observations: int
    """Observations of tie points that the survey has."""

    @property
    def block(self) -> Block:
        """Return what was measured as a block in the axes of the site."""
        return Block(
            LocalFrame.local(),
            self.cameras,
            self.photographs,
            self.poses,
            self.tie_points,
            self.control_points,
            self.gnss_offset_sigma_m,
            self.datum_sigma_m,
            constraints=(*self.distances, *self.height_differences, *self.surfaces),
            rigs=self.rigs,
            undeclared_heights=self.undeclared_heights,
        )

    def adjusted(self) -> Verdict:
        """Adjust it again, as `photogram adjust` does, with all decisions. Raises AdjustmentError as that does."""
        return adjust_with_snooping(self.block, self.settings, self.parameters, readings_px=self.focal_readings_px)

    def content(self) -> list[tuple[str, str]]:
        """Return what stands in it, in words."""
        block, points = self.block, self.control_points
        centres = np.array([p.position_world_m for p in block.poses if p is not None]).reshape(-1, 3)
        east, north, up = np.ptp(centres, axis=0) if len(centres) else np.zeros(3)
        times = sum(p.time is not None for p in block.photographs)
        positions = sum(p.gnss_world_m is not None for p in block.photographs)
        attitudes = sum(p.attitude_world_from_camera is not None for p in block.photographs)
        held = len(block.tie_points.point)
        part = f" of {self.observations}" if held < self.observations else ""
        control = points.role.count("control")
        return [
            ("photographs", f"{len(block.photographs)}, numbered, {int(block.registered.sum())} oriented"),
            ("spread of the centres", f"{east:.0f} m east, {north:.0f} m north, {up:.0f} m in height"),
            *(("camera", repr(camera).strip("<>").partition(": ")[2]) for camera in block.cameras),
            ("tie points", f"{things(len(block.tie_points), 'point')}, {held}{part} image coordinates"),
            ("ground points", f"{things(control, 'control point')}, {things(len(points) - control, 'check point')}, "
                              f"{things(len(points.mark_point), 'mark')}"),
            ("measured", f"{things(positions, 'position')}, {things(attitudes, 'attitude')}, "
                         f"{things(times, 'time')} since the first exposure"),
            *([("between points", things(len(block.constraints), "constraint"))] if block.constraints else []),
            *([("rigs", things(len(block.rigs), "companion camera"))] if block.rigs else []),
            ("result", f"sigma0 {self.result.sigma0:.3f}, poses, ground points and standard deviations"),
        ]  # fmt: skip


def _kept(block: Block, most: int) -> BoolArray:
    """Return which tie points (P,) are kept for at most so many observations: all, or a random part, the same each
    time."""
    rays = block.tie_points.rays
    order = np.random.default_rng(1).permutation(len(rays))
    kept = np.zeros(len(rays), dtype=bool)
    kept[order[np.cumsum(rays[order]) <= most]] = True
    return kept


def _result(result: Adjustment, axes: SiteAxes) -> DonatedResult:
    turn = axes.site_from_world

    def sigmas(covariance_m2: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.einsum("ik,nkl,il->ni", turn, covariance_m2, turn)))

    return DonatedResult(
        result.sigma0,
        tuple(axes.pose(pose) for pose in result.block.poses),
        sigmas(result.covariances.position_m2),
        axes.places(result.estimates.ground_world_m),
        sigmas(result.covariances.ground_m2),
    )


def donated(project: Project, most: int = MOST_OBSERVATIONS) -> Donation:
    """Return what a finished survey gives away; of tie points at most so many observations.

    Raises WorkspaceError where the survey is not adjusted, PhotogramError where nothing is oriented. A known surface is
    left out: it would tell the place.
    """
    with open_run(project) as run:
        if not is_up_to_date(run, "adjustment"):
            raise WorkspaceError(
                f"{project.path}: is not adjusted, or has changed since: run photogram adjust {project.path}"
            )
        given, result = adjustment_input(run), stored_adjustment(run)
    axes, block = SiteAxes.of(given.block), given.block
    every = len(block.tie_points.point)
    block = anonymous(replace(block, tie_points=block.tie_points.select(_kept(block, most))), axes)
    return Donation(
        FORMAT,
        __version__,
        block.cameras,
        block.photographs,
        block.poses,
        block.tie_points,
        block.control_points,
        block.gnss_offset_sigma_m,
        block.datum_sigma_m,
        block.undeclared_heights,
        block.rigs,
        tuple(c for c in block.constraints if isinstance(c, Distance)),
        tuple(c for c in block.constraints if isinstance(c, HeightDifference)),
        tuple(c for c in block.constraints if isinstance(c, CommonSurface)),
        project.adjustment,
        given.orientation.parameters,
        tuple(tuple(readings) for readings in project.focal_readings_px),
        _result(result, axes),
        every,
    )


def write_donation(path: Path, donation: Donation) -> None:
    """Write a donation as npz within gzip, the same bytes for the same donation. Raises WorkspaceError where it cannot
    be written."""
    with TemporaryDirectory() as folder, replacing(path) as temporary, temporary.open("wb") as stream:
        write_record(Path(folder) / _INNER, donation)
        with gzip.GzipFile("", "wb", fileobj=stream, mtime=0) as packed:
            packed.write((Path(folder) / _INNER).read_bytes())


def read_donation(path: Path | str) -> Donation:
    """Read a donation. Raises WorkspaceError where it cannot be read, or is of another format."""
    path = Path(path)
    with TemporaryDirectory() as folder:
        inner = Path(folder) / _INNER
        try:
            with gzip.open(path) as stream:
                content = stream.read(MOST_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise WorkspaceError(f"{path}: cannot be read as a donation: {error}") from error
        if len(content) > MOST_BYTES:
            raise WorkspaceError(f"{path}: is no donation: it holds more than {MOST_BYTES // 2**20} MiB")
        inner.write_bytes(content)
        try:
            donation = read_record(inner, Donation)
        except WorkspaceError as error:
            reason = str(error).partition("cannot be read (")[2].rpartition(")")[0]
            raise WorkspaceError(f"{path}: is no donation that this version reads: {reason}") from error
    if donation.format != FORMAT:
        raise WorkspaceError(f"{path}: is of format {donation.format}, this version reads {FORMAT}")
    return donation
