"""The stage `adjustment`: the joint adjustment, what it leaves out, and how the block is deformed."""

import logging
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.adjustment.oriented_subset import part_of_block
from photogram.adjustment.problem import without_attitudes
from photogram.adjustment.self_calibration import held_parameters, with_priors
from photogram.amendments.gross_errors.blunder_naming import withdrawn_attitudes
from photogram.amendments.snooped_adjustment import adjust_with_snooping
from photogram.arrays import FloatArray
from photogram.files.npz_json import write_arrays, write_json
from photogram.files.records import write_record
from photogram.geodesy.frames import LocalFrame
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import ADJUSTED_BYTES, LIBRARIES_BYTES, Costs, Memory, Rate
from photogram.pipeline.stages.features import orientation_thresholds
from photogram.pipeline.stages.known_surface import known_surface, known_surface_fingerprint
from photogram.pipeline.stages.orientation import (
    control_fingerprint,
    georeferenced_by,
    stored_orientation,
    transferred_tie_points,
)
from photogram.pipeline.stages.stored_adjustment import (
    FIXED,
    OBSERVATIONS,
    RESECTIONS,
    VERDICT,
    StoredResections,
    verdict_to,
    write_adjustment,
)
from photogram.pipeline.stages.tie_points import stored_tie_points
from photogram.pipeline.store.run import Run
from photogram.quality.improvements import block_deformation
from photogram.quality.model_error import with_model_error
from photogram.report.observations import observation_arrays
from photogram.report.record.block import EffortRecord
from photogram.report.values import record_of
from photogram.sfm.marked_points import tied_by_marks, with_marks_as_tie_points
from photogram.sfm.orientation import Orientation, accepted_attitudes, confirmed_resections, georeferenced_again
from photogram.sfm.resection import Resection
from photogram.survey import Block, PointCloud
from photogram.wording import Progress, things

_LOG = logging.getLogger(__name__)


class AdjustmentSummary(TypedDict, total=False):
    """What the stage says of itself."""

    sigma0: float | None
    """A-posteriori standard deviation of unit weight; without redundancy NaN, as stored None."""
    converged: bool
    """Whether the adjustment converged."""
    blunders: int
    """Number of blunders rejected."""
    iterations: int
    """Number of iterations over all rays, for all decisions together; of the last solution where these are absent."""
    effort: list[EffortRecord]
    """The work for each decision."""
    rejected_headings: int
    """Number of headings of the gimbal not used."""
    disbelieved_attitudes: int
    """Number of attitudes of the gimbal not used."""


def _sigma_map_m(frame: LocalFrame, covariance_m2: FloatArray) -> FloatArray:
    R = frame.rotation_world_from_map(np.zeros(3))
    return np.asarray(np.sqrt(np.einsum("ki,nkl,li->ni", R, covariance_m2, R)))


def _resections(run: Run) -> tuple[Resection | None, ...]:
    """Return the resections from the control points as they are now; of copies of a photograph none."""
    block = replace(run.block(), tie_points=stored_tie_points(run))
    original = np.array([note.get("copy_of") is None for note in run.notes()], dtype=bool)
    part, kept = part_of_block(block, original)
    confirmed = dict(zip(kept.tolist(), confirmed_resections(part, orientation_thresholds(run.project)), strict=True))
    return tuple(confirmed.get(i) for i in range(len(block.photographs)))


@dataclass(frozen=True, eq=False)
class AdjustmentInput:
    """What is adjusted: the ``block``, and the same with all attitudes as they were ``measured``; ``resections`` from
    its control points, as they are now."""

    block: Block
    measured: Block
    orientation: Orientation
    resections: tuple[Resection | None, ...]


def adjustment_input(run: Run) -> AdjustmentInput:
    """Return what the stage adjusts. Needs the stages `orientation` and `transfer`."""
    orientation = stored_orientation(run)
    as_placed = control_fingerprint(run.project) == georeferenced_by(run).control
    block = replace(run.block(), tie_points=transferred_tie_points(run), poses=orientation.poses)
    resections = orientation.resections
    if not as_placed or block.is_free:  # the scale of a free block hangs on distances that may have changed
        block = georeferenced_again(block, orientation, orientation_thresholds(run.project))
        resections = _resections(run)
    block = without_attitudes(block) if block.is_free else block
    block = with_marks_as_tie_points(block, tied_by_marks(block, orientation.component))
    measured = block
    if orientation.method != "control":
        block = replace(block, photographs=accepted_attitudes(block, block.poses))
    kinds = zip(block.cameras, run.project.calibration, strict=True)
    block = replace(block, cameras=tuple(with_priors(c) if kind == "auto" else c for c, kind in kinds))
    return AdjustmentInput(block, measured, orientation, resections)


def adjust_block(run: Run, folder: Path, progress: Progress) -> AdjustmentSummary:
    """Adjust the block jointly."""
    given = adjustment_input(run)
    block, orientation = given.block, given.orientation
    settings, start = run.project.adjustment, orientation.parameters
    known = known_surface(run.project, block)
    verdict = adjust_with_snooping(block, settings, start, progress, run.project.focal_readings_px, known)
    block, iterations = verdict.block, sum(effort.iterations_over_all_rays for effort in verdict.effort)
    for effort in verdict.effort:
        _LOG.debug("%s", effort.sentence)
    blunders = [*verdict.blunders, *withdrawn_attitudes(given.measured, block, verdict.result)]
    progress(0, 0, "deformation of the block")
    known_before = [camera.parameters for camera in block.cameras]
    deformation = block_deformation(verdict.result, run.project.adjustment, known_before, orientation.component)
    result = with_model_error(
        replace(verdict.result, covariances=replace(verdict.result.covariances, deformation=deformation))
    )
    frame, tie_points = block.frame, result.block.tie_points
    sigma = _sigma_map_m(frame, result.covariances.tie_point_m2)
    cloud = PointCloud.from_world(frame, tie_points.position_world_m, tie_points.colour, sigma)
    write_record(folder / "adjusted.npz", cloud)
    write_adjustment(folder, result)
    every = verdict.block.tie_points
    write_arrays(folder / OBSERVATIONS, observation_arrays(result, verdict.priors, every, run.project.adjustment))
    write_record(folder / RESECTIONS, StoredResections(given.resections))
    write_json(folder / FIXED, held_parameters(block.cameras, result, verdict.focal_lengths))
    write_json(folder / VERDICT, verdict_to(verdict, blunders))
    return {
        "sigma0": result.sigma0,
        "converged": result.converged,
        "blunders": len(blunders),
        "iterations": round(iterations),
        "effort": [record_of(EffortRecord, effort) for effort in verdict.effort],
        "rejected_headings": sum(not p.heading_known for p in block.photographs),
        "disbelieved_attitudes": sum(
            m.attitude_sigma_rad is not None and p.attitude_sigma_rad is None
            for m, p in zip(given.measured.photographs, block.photographs, strict=True)
        ),
    }


def _words(summary: AdjustmentSummary) -> str:
    iterations = things(summary["iterations"], "iteration")
    if "effort" in summary:
        iterations += " over all rays"
    parts = [f"converged after {iterations}" if summary["converged"] else f"NOT converged after {iterations}"]
    sigma0 = summary["sigma0"]
    parts.append(f"sigma0 {nan if sigma0 is None else sigma0:.3f}")
    if summary.get("blunders"):
        parts.append(f"{things(summary['blunders'], 'blunder')} rejected")
    headings, attitudes = summary.get("rejected_headings", 0), summary.get("disbelieved_attitudes", 0)
    parts += [f"{things(n, what)} not used" for n, what in ((headings, "heading"), (attitudes, "attitude")) if n]
    return ", ".join(parts)


ADJUSTMENT: Stage = Stage(
    "adjustment",
    "Joint adjustment",
    ("orientation", "transfer"),
    lambda run: [
        run.project.adjustment,
        run.project.common_gnss_sigma_m,
        run.project.datum_sigma_m,
        run.project.constraints,
        run.project.rigs,
        run.project.calibration,
        run.project.focal_readings_px,
        control_fingerprint(run.project),
        known_surface_fingerprint(run.project),
    ],
    adjust_block,
    line_of(AdjustmentSummary, _words),
    Costs(
        0.3,
        (Rate("observations", 1.3e-4, pieces=False), Rate("photographs", 0.03, pieces=False)),
        1.0,
        ("photogram.factors",),
        disk_bytes=lambda extent: ADJUSTED_BYTES * extent.key_points,
        memory=lambda extent: Memory(LIBRARIES_BYTES + extent.block_bytes),
    ),
)
