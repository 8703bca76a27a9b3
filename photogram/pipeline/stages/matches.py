"""The stages `pairs` and `matches`: which photographs are compared, and what they show alike."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from threadpoolctl import threadpool_limits
from typing_extensions import TypedDict

from photogram.arrays import BoolArray
from photogram.files.npz_json import read_arrays, read_json, write_arrays, write_json
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import Costs, Extent, Memory, Rate
from photogram.pipeline.stages.features import NOT_NEEDED, coarseness_of, starts_from_tie_points, stored_features
from photogram.pipeline.store.pieces import PieceType, StageWork, run_pieces, stage_work
from photogram.pipeline.store.run import Run
from photogram.sfm.tie_points.ground_depth import Pairs, with_ground_depth
from photogram.sfm.tie_points.matching import MATCHERS, match_pair
from photogram.sfm.tie_points.pairs import SelectedPairs, select_pairs
from photogram.sfm.tie_points.retrieval import most_similar
from photogram.survey import Matches
from photogram.wording import Progress, things


class PairsSummary(TypedDict, total=False):
    """What the stage `pairs` says of itself."""

    pairs: int
    """Number of pairs selected."""
    selected_by: dict[str, int]
    """Number of pairs by the reason for which they were selected."""
    not_needed: str
    """Why there are none."""


class MatchesSummary(TypedDict, total=False):
    """What the stage `matches` says of itself."""

    pairs: int
    """Number of pairs matched."""
    verified_pairs: int
    """Number of pairs with verified matches."""
    not_needed: str
    """Why there are none."""


def select_photograph_pairs(run: Run, folder: Path) -> SelectedPairs:
    """Select the pairs of photographs to match; where positions are missing, by what the photographs show, and where
    flying heights are too small, as some pairs show that are matched to find out. ``folder`` is the stage's."""
    block, settings = run.block(), run.project.pairs
    used = [i for i, note in enumerate(run.notes()) if note.get("copy_of") is None]
    photographs = [block.photographs[i] for i in used]
    similar = None
    if any(photograph.gnss_world_m is None for photograph in photographs):
        similar = most_similar(lambda i: stored_features(run, used[i]), len(used), 3 * settings.retrieved)
    selected = select_pairs(photographs, block.cameras, settings, similar=similar)

    def verified(pairs: Pairs) -> list[bool]:
        with threadpool_limits(1, "blas"):
            return list(run_pieces(run, folder, _VERIFIED, [(used[i], used[j]) for i, j in pairs]))

    selected = with_ground_depth(photographs, block.cameras, settings, selected, verified)
    return replace(selected, pairs=tuple((used[i], used[j]) for i, j in selected.pairs))


def choose_pairs(run: Run, folder: Path, progress: Progress) -> PairsSummary:
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


def selected_pairs(run: Run) -> list[tuple[int, int]]:
    """Return the pairs of photographs to be matched. Needs the stage `pairs`."""
    return [(int(i), int(j)) for i, j in read_json(run.workspace.file("pairs", "pairs.json"))]


PAIRS: Stage = Stage(
    "pairs",
    "Pairs",
    ("photographs", "features"),
    lambda run: [run.project.pairs, run.project.matching, run.project.cameras],
    choose_pairs,
    line_of(PairsSummary, lambda summary: f"{things(summary['pairs'], 'pair')} selected"),
    Costs(
        0.02,
        (Rate("comparisons", 0.18, "matches"), Rate("photographs", 0.002, pieces=False)),
        0.6,
        ("photogram.sfm.tie_points.pairs", "photogram.sfm.tie_points.matching"),
    ),
)


def _matched(run: Run, pair: tuple[int, int]) -> tuple[Matches, BoolArray]:
    """Return the candidate matches of two photographs, and which of them are verified, as match_pair."""
    project, (i, j) = run.project, pair
    cameras = (project.cameras[project.photographs[i].camera], project.cameras[project.photographs[j].camera])
    coarser = max(coarseness_of(project, i), coarseness_of(project, j))
    return match_pair(pair, cameras, (stored_features(run, i), stored_features(run, j)), project.matching, coarser)


def _verified(work: StageWork, pair: tuple[int, int]) -> bool:
    """Return whether any match of a pair of photographs is verified."""
    return bool(_matched(work[0], pair)[1].any())


_VERIFIED = PieceType(stage_work, _verified)


def _match(work: StageWork, pair: tuple[int, int]) -> bool:
    """Match and verify a pair of photographs, unless that is done; returns whether any match is verified."""
    run, folder = work
    path = folder / f"{pair[0]:05d}-{pair[1]:05d}.npz"
    if not path.is_file():
        matches, good = _matched(run, pair)
        write_arrays(path, {"index": matches.index, "verified": good})
    return bool(read_arrays(path)["verified"].any())


_MATCHED = PieceType(stage_work, _match)


def match_photographs(run: Run, folder: Path, progress: Progress) -> MatchesSummary:
    """Match and verify all selected pairs, one file per pair; pairs that an interrupted run has finished are kept."""
    pairs, verified = selected_pairs(run), 0
    with threadpool_limits(1, "blas"):  # the pairs keep the cores busy already
        matched = zip(pairs, run_pieces(run, folder, _MATCHED, pairs), strict=True)
        for done, ((i, j), is_verified) in enumerate(matched, 1):
            verified += is_verified
            progress(done, len(pairs), f"{run.names[i]} – {run.names[j]}")
    write_json(folder / "pairs.json", pairs)
    if starts_from_tie_points(run.project):
        return {"not_needed": NOT_NEEDED}
    return {"pairs": len(pairs), "verified_pairs": verified}


def stored_matches(run: Run) -> Iterator[tuple[Matches, BoolArray]]:
    """Yield candidate matches of every pair, and which are verified, one pair after the other. Needs the stage
    `matches`."""
    for first, second in read_json(run.workspace.file("matches", "pairs.json")):
        arrays = read_arrays(run.workspace.file("matches", f"{first:05d}-{second:05d}.npz"))
        yield Matches(first, second, arrays["index"]), arrays["verified"]


MATCH_BYTES = 10.0
"""On disk for a key point; measured at half of it over a beach, and at twice over ground with texture everywhere and
much overlap."""


def _memory(extent: Extent) -> Memory:
    compared = MATCHERS[extent.detector.metric].bytes_per_key_point
    return Memory(compared * extent.workers * extent.project.features.maximum)


MATCHES: Stage = Stage(
    "matches",
    "Matching",
    ("features",),
    lambda run: [selected_pairs(run), run.project.matching, run.project.cameras],
    match_photographs,
    line_of(MatchesSummary, lambda made: f"{made['verified_pairs']} of {things(made['pairs'], 'pair')} verified"),
    Costs(
        0.02,
        (Rate("comparisons", 1.0, "matches"), Rate("pairs", 0.02)),
        is_tested=True,
        disk_bytes=lambda extent: MATCH_BYTES * extent.key_points,
        memory=_memory,
    ),
)
