"""Results as they lie on disk: measured photographs, orientation, adjustment and verdict."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from typing_extensions import TypedDict

from photogram.adjustment.stochastic_model.estimated_sigmas import with_gnss_sigmas
from photogram.arrays import FloatArray, IntArray
from photogram.camera import LensField, Pose, calibrations
from photogram.constraints.rigs import RelativePose
from photogram.files.npz_json import read_json_as
from photogram.files.records import read_record, write_record
from photogram.geodesy.frames import LocalFrame
from photogram.project.measured.measured_block import MeasuredPhotographs
from photogram.project.project import Project
from photogram.quality.gross_errors.blunder_naming import Blunder
from photogram.quality.gross_errors.data_snooping import Hypothesis, Suspected, unmeasured, without
from photogram.quality.gross_errors.snooped_adjustment import Verdict
from photogram.report.record.ground import BlunderRecord, CheckPointsRecord
from photogram.results import Adjustment, AdjustmentCovariances, Decisions, Estimates, StatisticalTests
from photogram.sfm.orientation import Orientation
from photogram.sfm.resection import Resection
from photogram.survey import Block, Photograph, TiePoints


@dataclass(frozen=True)
class GeoreferencedBy:
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


@dataclass(frozen=True, eq=False)
class AdjustedBlock:
    """What an adjustment changes in a measured block, beside tie points, common errors and sigmas."""

    parameters: FloatArray
    """Interior orientations (cameras, 12 + K), with the coefficients of lens fields."""
    fields: tuple[LensField | None, ...]
    """Lens field of each camera."""
    poses: tuple[Pose | None, ...]
    """Exterior orientation of each photograph."""
    relative_poses: tuple[RelativePose | None, ...]
    """Where each companion camera sits, as given or to start from."""
    relative_change: FloatArray
    """Its estimated change (rigs, 6)."""

    @staticmethod
    def of(block: Block) -> AdjustedBlock:
        """Return it of a block that was adjusted."""
        return AdjustedBlock(
            calibrations(block.cameras),
            tuple(camera.field for camera in block.cameras),
            block.poses,
            tuple(rig.given for rig in block.rigs),
            np.array([rig.value for rig in block.rigs]).reshape(-1, 6),
        )

    def applied_to(self, block: Block, tie_points: TiePoints, decisions: Decisions) -> Block:
        """Return a measured block as it was adjusted, GNSS positions with the sigmas that were estimated."""
        cameras = zip(block.cameras, self.fields, self.parameters, strict=True)
        rigs = zip(block.rigs, self.relative_poses, self.relative_change, strict=True)
        adjusted = replace(
            block,
            cameras=tuple(replace(camera, field=lens).with_parameters(q) for camera, lens, q in cameras),
            poses=self.poses,
            tie_points=tie_points,
            common_errors=tuple(estimate.error for estimate in decisions.common_errors),
            rigs=tuple(replace(rig, given=given, value=value) for rig, given, value in rigs),
        )
        return with_gnss_sigmas(adjusted, decisions.sigmas)


_BLOCK, _TIE_POINTS, _DECISIONS, COVARIANCES = "block.npz", "tie_points.npz", "decisions.npz", "covariances.npz"


def write_adjustment(folder: Path, result: Adjustment) -> None:
    """Write an adjustment, each part in a file of its own."""
    write_record(folder / _BLOCK, AdjustedBlock.of(result.block))
    write_record(folder / _TIE_POINTS, result.block.tie_points)
    write_record(folder / "estimates.npz", result.estimates)
    write_record(folder / COVARIANCES, result.covariances)
    write_record(folder / "tests.npz", result.tests)
    write_record(folder / _DECISIONS, result.decisions)
    write_record(folder / "adjustment.npz", result, ("block", "estimates", "covariances", "tests", "decisions"))


def read_adjusted_block(block: Block, file: Callable[[str], Path], rejected: Sequence[Hypothesis] = ()) -> Block:
    """Return a measured block as it was adjusted, without covariances; what was ``rejected`` took no part. ``file``
    gives the paths of what ``write_adjustment`` wrote by name."""
    stored, tie_points = read_record(file(_BLOCK), AdjustedBlock), read_record(file(_TIE_POINTS), TiePoints)
    adjusted = stored.applied_to(block, tie_points, read_record(file(_DECISIONS), Decisions))
    return without(adjusted, [a for a in rejected if a.kind != "focal length"])


def read_adjustment(adjusted: Block, file: Callable[[str], Path]) -> Adjustment:
    """Return the adjustment of which the block is ``adjusted``; ``file`` as in ``read_adjusted_block``."""
    parts = {
        "block": adjusted,
        "estimates": read_record(file("estimates.npz"), Estimates),
        "covariances": read_record(file(COVARIANCES), AdjustmentCovariances),
        "tests": read_record(file("tests.npz"), StatisticalTests),
        "decisions": read_record(file(_DECISIONS), Decisions),
    }
    return read_record(file("adjustment.npz"), Adjustment, parts)


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
