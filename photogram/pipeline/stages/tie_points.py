"""The stage `tie_points`: verified matches joined to points that several photographs show, or those that are given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.errors import ImageError
from photogram.files.npz_json import file_fingerprint
from photogram.files.records import read_record, write_record
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import TIE_POINT_BYTES, Costs, Memory, Rate
from photogram.pipeline.stages.features import coarseness_of, starts_from_tie_points, stored_features
from photogram.pipeline.stages.matches import stored_matches
from photogram.pipeline.store.run import Run
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.sfm.tie_points.detector import detector_named
from photogram.sfm.tie_points.tracks import (
    Joined,
    coloured,
    join_matches,
    key_point_sigmas_px,
    without_conflicts,
)
from photogram.survey import Features, Matches, TiePoints
from photogram.wording import Progress, some, things


class TiePointsSummary(TypedDict):
    """What the stage says of itself."""

    tie_points: int
    """Number of tie points."""
    conflicts: int
    """Number of contradictory tie points rejected."""


def _key_point_sigmas_px(project: Project, photograph: int, features: Features) -> FloatArray:
    """Return the standard deviations (N,) of the key points of a photograph."""
    camera = project.cameras[project.photographs[photograph].camera]
    detector = detector_named(project.features.detector)
    scale = detector.scale(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])
    best_px = project.adjustment.tie_point_sigma_px * coarseness_of(project, photograph)
    traits = detector.traits
    return key_point_sigmas_px(features.size_px, traits.smallest_px * scale, traits.size_exponent, best_px)


def _given_tie_points(run: Run, given: TiePoints, progress: Progress) -> Joined:
    """Return tie points that the project starts from as if they were its own: as precise as key points of the best
    size, in the colours of its photographs. Raises ImageError where none of them joins two photographs."""
    best_px = run.project.adjustment.tie_point_sigma_px
    sigma_px = np.array([best_px * coarseness_of(run.project, i) for i in range(len(run.names))])
    joined = without_conflicts(replace(given, sigma_px=sigma_px[given.photograph]))
    if not len(joined.tie_points):
        raise ImageError(
            "no tie point of the solution that the project starts from was observed in two of its photographs: write "
            "start: {tie_points: own}, and photogram matches them"
        )
    tie_points = joined.tie_points
    for done, photograph in enumerate(np.unique(tie_points.photograph[tie_points.first_observation[:-1]]).tolist(), 1):
        tie_points = coloured(tie_points, photograph, run.pixels(photograph))
        progress(done, len(run.names), run.names[photograph])
    return replace(joined, tie_points=tie_points)


def _joined_matches(run: Run) -> Joined:
    """Return verified matches joined to tie points over all photographs. Raises ImageError where none are."""
    features = [stored_features(run, i) for i in range(len(run.names))]
    matches = [Matches(m.first, m.second, m.index[good]) for m, good in stored_matches(run)]
    sigmas_px = [_key_point_sigmas_px(run.project, i, f) for i, f in enumerate(features)]
    joined = join_matches(features, matches, sigmas_px)
    if not len(joined.tie_points):
        without = [name for name, own in zip(run.names, features, strict=True) if not len(own)]
        bare = f"no features were detected in {len(without)} of {things(len(features), 'photograph')} ({some(without)})"
        if len(features) - len(without) < 2:
            raise ImageError(
                f"{bare}: give photographs of textured ground, sharp and neither dark nor overexposed, and check that "
                "no mask covers them whole"
            )
        raise ImageError(
            f"{bare}; "
            * bool(without)
            + f"no two of the {len(features)} photographs have {run.project.matching.minimum_inliers} verified matches "
            "in common: give photographs of one site that overlap by 60 % or more"
        )
    return joined


def join_tie_points(run: Run, folder: Path, progress: Progress) -> TiePointsSummary:
    """Join verified matches to tie points over all photographs, or take those that the project starts from."""
    given = run.start.tie_points if starts_from_tie_points(run.project) and run.start is not None else None
    joined = _joined_matches(run) if given is None else _given_tie_points(run, given, progress)
    write_record(folder / "tie_points.npz", joined.tie_points)
    progress(1, 1, f"{len(joined.tie_points)} tie points")
    return {"tie_points": len(joined.tie_points), "conflicts": joined.conflicts}


def stored_tie_points(run: Run) -> TiePoints:
    """Return the tie points of the whole block, without positions. Needs the stage `tie_points`."""
    return read_record(run.workspace.file("tie_points", "tie_points.npz"), TiePoints)


def _settings(run: Run) -> object:
    start, sigma_px = run.project.start, run.project.adjustment.tie_point_sigma_px
    return sigma_px if start is None or start.tie_points == "own" else [sigma_px, file_fingerprint(start.solution)]


def _words(summary: TiePointsSummary) -> str:
    rejected = summary["conflicts"]
    return things(summary["tie_points"], "tie point") + (f", {rejected} contradictory rejected" if rejected else "")


TIE_POINTS: Stage = Stage(
    "tie_points",
    "Tie points",
    ("features", "matches"),
    _settings,
    join_tie_points,
    line_of(TiePointsSummary, _words),
    Costs(
        0.02,
        (Rate("key_points", 5e-7, pieces=False),),
        disk_bytes=lambda extent: TIE_POINT_BYTES * extent.key_points,
        memory=lambda extent: Memory(extent.block_bytes),
    ),
)
