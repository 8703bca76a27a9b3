"""What the stage `adjustment` has stored, written by it and read back for later stages and notebooks: the adjustment,
its verdict on what is wrong, and clouds of tie points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NotRequired

import numpy as np
from typing_extensions import TypedDict

from photogram.adjustment.stochastic_model.estimated_sigmas import with_assumed_sigmas, with_control_assumed
from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.amendments.gross_errors.data_snooping import without
from photogram.amendments.gross_errors.hypothesis import Hypothesis, Suspected, unmeasured
from photogram.amendments.snooped_adjustment import Verdict
from photogram.amendments.undeclared_heights import with_heights_open
from photogram.arrays import FloatArray
from photogram.camera import LensField, Pose, calibrations
from photogram.constraints.known_surface import SurfaceControl
from photogram.constraints.rigs import RelativePose
from photogram.files.npz_json import read_json_as
from photogram.files.records import read_record, write_record
from photogram.pipeline.stage_names import StageName
from photogram.pipeline.store.run import Run
from photogram.report.record.ground import BlunderRecord, CheckPointsRecord
from photogram.results import Adjustment, AdjustmentCovariances, Decisions, Estimates, StatisticalTests
from photogram.sfm.resection import Resection
from photogram.survey import Block, PointCloud, TiePoints

COVARIANCES, RESECTIONS, VERDICT = "covariances.npz", "resections.npz", "verdict.json"

OBSERVATIONS = "observations.npz"
"""File with all that the last step of the adjustment had, which the results hold too."""

FIXED = "held.json"
"""File with, by camera and parameter, why it did not come from the photographs."""

CLOUDS: dict[str, StageName] = {
    "linear_2view": "intersection",
    "linear_3view": "intersection",
    "adjusted": "adjustment",
}
"""The clouds of tie points, and the stage that makes each."""


# ---- the adjustment --------------------------------------------------------------------------------------------------


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
    known_surface: SurfaceControl | None
    """Its tie points on a known surface, None where none takes part."""

    @staticmethod
    def of(block: Block) -> AdjustedBlock:
        """Return it of a block that was adjusted."""
        return AdjustedBlock(
            calibrations(block.cameras),
            tuple(camera.field for camera in block.cameras),
            block.poses,
            tuple(rig.given for rig in block.rigs),
            np.array([rig.value for rig in block.rigs]).reshape(-1, 6),
            block.known_surface,
        )

    def applied_to(self, block: Block, tie_points: TiePoints, decisions: Decisions) -> Block:
        """Return a measured block as it was adjusted, GNSS positions with the sigmas that were estimated, and with an
        unknown difference of heights where they were not found to be of one system."""
        if decisions.heights is None or not decisions.heights.same:
            block = with_heights_open(block)
        cameras = zip(block.cameras, self.fields, self.parameters, strict=True)
        rigs = zip(block.rigs, self.relative_poses, self.relative_change, strict=True)
        adjusted = replace(
            block,
            cameras=tuple(replace(camera, field=lens).with_parameters(q) for camera, lens, q in cameras),
            poses=self.poses,
            tie_points=tie_points,
            common_errors=tuple(estimate.error for estimate in decisions.common_errors),
            rigs=tuple(replace(rig, given=given, value=value) for rig, given, value in rigs),
            known_surface=self.known_surface,
        )
        return with_assumed_sigmas(adjusted, decisions.sigmas)


_BLOCK, _TIE_POINTS, _DECISIONS, _REST = "block.npz", "tie_points.npz", "decisions.npz", "adjustment.npz"
_PARTS: dict[str, tuple[str, type[object]]] = {
    "estimates": ("estimates.npz", Estimates),
    "covariances": (COVARIANCES, AdjustmentCovariances),
    "tests": ("tests.npz", StatisticalTests),
    "decisions": (_DECISIONS, Decisions),
}
"""File and type of the parts of an Adjustment that are not its block."""


def write_adjustment(folder: Path, result: Adjustment) -> None:
    """Write an adjustment, each part in a file of its own."""
    write_record(folder / _BLOCK, AdjustedBlock.of(result.block))
    write_record(folder / _TIE_POINTS, result.block.tie_points)
    for name, (file, _) in _PARTS.items():
        write_record(folder / file, getattr(result, name))
    write_record(folder / _REST, result, ("block", *_PARTS))


def read_adjusted_block(block: Block, file: Callable[[str], Path], rejected: Sequence[Hypothesis] = ()) -> Block:
    """Return a measured block as it was adjusted, without covariances; what was ``rejected`` took no part. ``file``
    gives the paths of what ``write_adjustment`` wrote by name."""
    stored, tie_points = read_record(file(_BLOCK), AdjustedBlock), read_record(file(_TIE_POINTS), TiePoints)
    adjusted = stored.applied_to(block, tie_points, read_record(file(_DECISIONS), Decisions))
    return without(adjusted, [a for a in rejected if a.kind != "focal length"])


def read_adjustment(adjusted: Block, file: Callable[[str], Path]) -> Adjustment:
    """Return the adjustment of which the block is ``adjusted``; ``file`` as in ``read_adjusted_block``."""
    parts = {name: read_record(file(stored), kind) for name, (stored, kind) in _PARTS.items()}
    return read_record(file(_REST), Adjustment, {"block": adjusted, **parts})


def block_as_adjusted(run: Run) -> Block:
    """Return the block that was adjusted: cameras, poses and tie points as they came out, without what was left out.
    Needs the stage `adjustment`, of which no covariance is read."""
    verdict = stored_verdict(run)
    rejected = [
        replace(unmeasured(kind, name, photograph), axes=axes) for kind, name, photograph, axes in verdict["accused"]
    ]
    measured = with_control_assumed(run.block()) if verdict.get("contradicted", 1.0) > 1.0 else run.block()
    return read_adjusted_block(measured, partial(run.workspace.file, "adjustment"), rejected)


def stored_adjustment(run: Run) -> Adjustment:
    """Return the joint adjustment with all covariances; ``block_as_adjusted`` is its block alone. Needs the stage
    `adjustment`."""
    return read_adjustment(block_as_adjusted(run), partial(run.workspace.file, "adjustment"))


# ---- verdict, resections and clouds ----------------------------------------------------------------------------------


class StoredVerdict(TypedDict):
    """What the data snooping decided, as ``verdict.json`` holds it."""

    accused: list[tuple[Suspected, str, str | None, tuple[int, ...]]]
    """Rejected measurements: kind, name, photograph of a mark, and axes, as in Hypothesis."""
    blunders: list[BlunderRecord]
    """Blunders by their names."""
    contradicted: NotRequired[float]
    """Factor by which most control points deny their stated standard deviations, 1 where they do not."""
    focal_lengths: dict[str, str]
    """Sentences on focal lengths whose source the photographs contradict, by camera."""
    check_points: CheckPointsRecord
    """Accuracy at the check points with all measurements; null where the block cannot be adjusted with them."""
    check_points_without: CheckPointsRecord
    """Accuracy at the check points of the result."""


def verdict_to(verdict: Verdict, blunders: Sequence[Blunder]) -> dict[str, object]:
    """Return a verdict as JSON; ``blunders`` are its own and those that were left out before."""
    return {
        "accused": [(a.kind, a.name, a.photograph, list(a.axes)) for a in verdict.rejected],
        "blunders": list(blunders),
        "contradicted": verdict.contradicted,
        "focal_lengths": {name: decision.sentence for name, decision in verdict.focal_lengths.items()},
        "check_points": verdict.check_before,
        "check_points_without": verdict.check_after,
    }


def stored_verdict(run: Run) -> StoredVerdict:
    """Return the blunders, what was left out for them, and the accuracy of the check points with them and without.
    Needs the stage `adjustment`. Raises WorkspaceError where it is something else."""
    return read_json_as(run.workspace.file("adjustment", VERDICT), StoredVerdict)


@dataclass(frozen=True, eq=False)
class StoredResections:
    """Resections of the photographs from the control points, None where there is none."""

    resections: tuple[Resection | None, ...]


def stored_resections(run: Run) -> tuple[Resection | None, ...]:
    """Return the resections from the control points as they are in the adjustment. Needs the stage `adjustment`."""
    return read_record(run.workspace.file("adjustment", RESECTIONS), StoredResections).resections


def stored_cloud(run: Run, name: str) -> PointCloud:
    """Return one of CLOUDS. Needs its stage."""
    return read_record(run.workspace.file(CLOUDS[name], f"{name}.npz"), PointCloud)
