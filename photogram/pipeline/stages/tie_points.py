"""The stages `features`, `pairs`, `matches` and `tie_points`: from photographs to points that several of them show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import ImageError
from photogram.files.npz_json import read_arrays, write_arrays, write_json
from photogram.files.records import read_record, write_record
from photogram.pipeline.store.dependence import starts_from_tie_points
from photogram.pipeline.store.pieces import Kind, StageWork, each, stage_work
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.project.project import Project
from photogram.project.schema import REDUCTIONS
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.tie_points.features import SMALLEST_PX, coarseness, find_features, photographs_at_once, picture_scale
from photogram.sfm.tie_points.ground_depth import Pairs, with_ground_depth
from photogram.sfm.tie_points.guided_matching import TransferSettings
from photogram.sfm.tie_points.matching import match_pair
from photogram.sfm.tie_points.pairs import SelectedPairs, select_pairs
from photogram.sfm.tie_points.retrieval import most_similar
from photogram.sfm.tie_points.tracks import Joined, coloured, join_matches, key_point_sigmas_px, without_conflicts
from photogram.survey import Features, Matches, TiePoints
from photogram.wording import Progress


def _coarseness(project: Project, photograph: int) -> float:
    """Return how much coarser than with ``quality: high`` the picture is in which key points of a photograph are
    found."""
    camera = project.cameras[project.photographs[photograph].camera]
    return coarseness(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])


NOT_NEEDED = "the tie points are those of the solution that the project starts from"
"""Why such a project has neither key points nor matches of its own."""

MASKED = "masked.json"
"""File of the stage `features` with the share that masks leave out of each photograph; not there without masks."""

MOST_SEARCHED = 2.0
"""Times that transferred tie points are searched for farther away than with full quality, at most: beyond it windows
are found in the wrong place, and the time grows with the square."""


def _coarsest(project: Project) -> float:
    return max(_coarseness(project, i) for i in range(len(project.photographs)))


def orientation_thresholds(project: Project) -> OrientationSettings:
    """Return the settings of the orientation, their threshold as coarse as key points are."""
    return replace(project.orientation, threshold_px=_coarsest(project) * project.orientation.threshold_px)


def transfer_thresholds(project: Project) -> TransferSettings:
    """Return the settings of the transfer: places are searched for around poses as coarse as key points are."""
    farther = min(_coarsest(project), MOST_SEARCHED)
    return replace(project.transfer, search_px=round(farther * project.transfer.search_px))


def detect_features(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Find key points, one file per photograph; photographs that an interrupted run has finished are kept. None are
    needed where the project starts from tie points.

    As many photographs at once as there are workers and as the memory holds.
    """
    masked = masked_shares(run, folder)
    given = starts_from_tie_points(run.project)
    largest = max(camera.width_px * camera.height_px for camera in run.project.cameras)
    at_once = photographs_at_once(largest // REDUCTIONS[run.project.quality] ** 2)
    counts = []
    photographs = range(0 if given else len(run.names))
    for index, count in enumerate(each(run, folder, _DETECTED, photographs, at_once=at_once)):
        counts.append(count)
        progress(index + 1, len(photographs), run.names[index])
    summary: StageSummary = {"not_needed": NOT_NEEDED} if given else {"key_points": counts}
    if masked is not None:
        write_json(folder / MASKED, masked)
        summary["masks"], summary["masked_share"] = len(masked), sum(masked.values()) / max(len(masked), 1)
    return summary


def _masked_share(work: StageWork, index: int) -> float | str:
    """Return the share of a photograph that its masks leave out, or what is wrong with them."""
    try:
        used = work[0].given_mask(index)
    except ImageError as fault:
        return str(fault)
    return 0.0 if used is None else 1.0 - float(used.mean())


_MASKED = Kind(stage_work, _masked_share)


def masked_shares(run: Run, folder: Path) -> dict[str, float] | None:
    """Decode all masks that are given, before anything is looked for, and return the share that they leave out of each
    photograph that has one; None where none has. Raises ImageError that names every mask that cannot be used."""
    masked = [i for i in range(len(run.names)) if run.project.masks.of(i)]
    if not masked:
        return None
    found = list(each(run, folder, _MASKED, masked))
    faults = [share for share in found if isinstance(share, str)]
    if faults:
        raise ImageError("\n".join(dict.fromkeys(faults)))
    return {run.names[i]: share for i, share in zip(masked, found, strict=True) if not isinstance(share, str)}


def _detect(work: StageWork, index: int) -> int:
    """Find the key points of a photograph, unless that is done; returns their number."""
    run, folder = work
    path = folder / f"{index:05d}.npz"
    if not path.is_file():
        settings, reduction = run.project.features, REDUCTIONS[run.project.quality]
        pixels, used = run.pixels(index), run.given_mask(index)
        write_record(path, find_features(run.names[index], pixels, settings, reduction, used))
    return len(read_record(path, Features))


_DETECTED = Kind(stage_work, _detect)


def select_photograph_pairs(run: Run, folder: Path) -> SelectedPairs:
    """Select the pairs of photographs to match; where positions are missing, by what the photographs show, and where
    flying heights are too small, as some pairs show that are matched to find out. ``folder`` is the stage's."""
    block, settings = run.block(), run.project.pairs
    used = [i for i, note in enumerate(run.notes()) if note.get("copy_of") is None]
    photographs = [block.photographs[i] for i in used]
    similar = None
    if any(photograph.gnss_world_m is None for photograph in photographs):
        similar = most_similar(lambda i: run.features(used[i]), len(used), 3 * settings.retrieved)
    selected = select_pairs(photographs, block.cameras, settings, similar=similar)

    def verified(pairs: Pairs) -> list[bool]:
        with threadpool_limits(1, "blas"):
            return list(each(run, folder, _VERIFIED, [(used[i], used[j]) for i, j in pairs]))

    selected = with_ground_depth(photographs, block.cameras, settings, selected, verified)
    return replace(selected, pairs=tuple((used[i], used[j]) for i, j in selected.pairs))


def choose_pairs(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Select the pairs of photographs to match; none where the project starts from tie points."""
    if starts_from_tie_points(run.project):
        write_json(folder / "pairs.json", [])
        return {"not_needed": NOT_NEEDED}
    selected = select_photograph_pairs(run, folder)
    write_json(folder / "pairs.json", [list(pair) for pair in selected.pairs])
    progress(1, 1, f"{len(selected)} pairs")
    return {
        "pairs": len(selected),
        "selected_by": {reason: selected.reasons.count(reason) for reason in sorted(set(selected.reasons))},
    }


def _matched(run: Run, pair: tuple[int, int]) -> tuple[Matches, BoolArray]:
    """Return the candidate matches of two photographs, and which of them are verified, as match_pair."""
    project, (i, j) = run.project, pair
    cameras = (project.cameras[project.photographs[i].camera], project.cameras[project.photographs[j].camera])
    coarser = max(_coarseness(project, i), _coarseness(project, j))
    return match_pair(pair, cameras, (run.features(i), run.features(j)), project.matching, coarser)


def _verified(work: StageWork, pair: tuple[int, int]) -> bool:
    """Return whether any match of a pair of photographs is verified."""
    return bool(_matched(work[0], pair)[1].any())


_VERIFIED = Kind(stage_work, _verified)


def _match(work: StageWork, pair: tuple[int, int]) -> bool:
    """Match and verify a pair of photographs, unless that is done; returns whether any match is verified."""
    run, folder = work
    path = folder / f"{pair[0]:05d}-{pair[1]:05d}.npz"
    if not path.is_file():
        matches, good = _matched(run, pair)
        write_arrays(path, {"index": matches.index, "verified": good})
    return bool(read_arrays(path)["verified"].any())


_MATCHED = Kind(stage_work, _match)


def match_photographs(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Match and verify all selected pairs, one file per pair; pairs that an interrupted run has finished are kept."""
    pairs, verified = run.selected_pairs(), 0
    with threadpool_limits(1, "blas"):  # the pairs keep the cores busy already
        for done, ((i, j), found) in enumerate(zip(pairs, each(run, folder, _MATCHED, pairs), strict=True)):
            verified += found
            progress(done + 1, len(pairs), f"{run.names[i]} – {run.names[j]}")
    write_json(folder / "pairs.json", pairs)
    if starts_from_tie_points(run.project):
        return {"not_needed": NOT_NEEDED}
    return {"pairs": len(pairs), "verified_pairs": verified}


def _key_point_sigmas_px(project: Project, photograph: int, features: Features) -> FloatArray:
    """Return the standard deviations (N,) of the key points of a photograph."""
    camera = project.cameras[project.photographs[photograph].camera]
    scale = picture_scale(camera.width_px * camera.height_px, project.features, REDUCTIONS[project.quality])
    best_px = project.adjustment.tie_point_sigma_px * _coarseness(project, photograph)
    return key_point_sigmas_px(features.size_px, SMALLEST_PX * scale, best_px)


def _given_tie_points(run: Run, given: TiePoints, progress: Progress) -> Joined:
    """Return tie points that the project starts from as if they were its own: as precise as key points of the best
    size, in the colours of its photographs."""
    best_px = run.project.adjustment.tie_point_sigma_px
    sigma_px = np.array([best_px * _coarseness(run.project, i) for i in range(len(run.names))])
    joined = without_conflicts(replace(given, sigma_px=sigma_px[given.photograph]))
    tie_points = joined.tie_points
    for done, photograph in enumerate(np.unique(tie_points.photograph[tie_points.first_observation[:-1]]).tolist(), 1):
        tie_points = coloured(tie_points, photograph, run.pixels(photograph))
        progress(done, len(run.names), run.names[photograph])
    return replace(joined, tie_points=tie_points)


def _joined_matches(run: Run) -> Joined:
    """Return verified matches joined to tie points over all photographs. Raises ImageError where none are."""
    features = [run.features(i) for i in range(len(run.names))]
    matches = [Matches(m.first, m.second, m.index[good]) for m, good in run.matches()]
    sigmas_px = [_key_point_sigmas_px(run.project, i, f) for i, f in enumerate(features)]
    joined = join_matches(features, matches, sigmas_px)
    if not len(joined.tie_points):
        raise ImageError(
            f"no two of the {len(features)} photographs have {run.project.matching.minimum_inliers} verified matches "
            "in common: give photographs of one site that overlap by 60 % or more"
        )
    return joined


def join_tie_points(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Join verified matches to tie points over all photographs, or take those that the project starts from."""
    given = run.start.tie_points if starts_from_tie_points(run.project) and run.start is not None else None
    joined = _joined_matches(run) if given is None else _given_tie_points(run, given, progress)
    write_record(folder / "tie_points.npz", joined.tie_points)
    progress(1, 1, f"{len(joined.tie_points)} tie points")
    return {"tie_points": len(joined.tie_points), "conflicts": joined.conflicts}
