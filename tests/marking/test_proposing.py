"""Targets in photographs of a simulated block that shows them at their true places, and in the words of a search."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, ExceptHookArgs

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from makers import simulated, without_marks
from PIL import Image

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import project_points
from photogram.errors import AdjustmentError, ImageError, PhotogramError
from photogram.files.tables.surveyed_points import MarkKey, Proposal
from photogram.marking.page.patches import LARGEST_SIDE, PatchReader
from photogram.marking.page.proposing import (
    AROUND_PX,
    Box,
    SearchResult,
    SearchState,
    TargetSearch,
    merged,
    proposed_marks,
)
from photogram.marking.page.snapping import LENS_PX
from photogram.marking.predictions import predicted_places
from photogram.marking.targets.acceptance import Judgement
from photogram.measures.mark_covariances import isotropic_px2
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan
from photogram.survey import Block
from photogram.wording import Progress

PLAN = SurveyPlan(
    width_px=600,
    height_px=450,
    focal_px=900.0,
    strips=2,
    photographs_per_strip=2,
    control_points=4,
    check_points=2,
    mark_sigma_px=0.1,
    gnss_offset_sigma_m=(0.02, 0.02, 0.02),
    calibration_sigmas=(1.0, 0.5, 0.5, *(0.0,) * 8),
)
RADIUS_PX, FINER = 11.0, 8
"""Of a target; points along the side of a pixel."""
FAINT = 0.1
"""Of the contrast, in photographs whose targets are not sure."""
DISPLACED_PX = (24.0, -18.0)
"""Where a decoy is beside the place of a target that is missing."""


@dataclass(frozen=True, eq=False)
class Shown:
    """Photographs of a block, held together by tie points, without marks."""

    made: SimulatedBlock
    block: Block
    patches: PatchReader
    places: dict[MarkKey, FloatArray]
    """Where targets are, by point and photograph: true places."""
    missing: MarkKey
    """Where there is none, but a decoy beside it."""


def target(grey: FloatArray, centre: FloatArray, turn: float) -> None:
    """Draw a checker disc into grey values, as far as they reach."""
    low = np.floor(centre).astype(int) - round(RADIUS_PX) - 2
    side = 2 * round(RADIUS_PX) + 6
    step = (np.arange(side * FINER) + 0.5) / FINER - 0.5
    x, y = np.meshgrid(step + low[0] - centre[0], step + low[1] - centre[1])
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    inside = (np.hypot(x, y) < RADIUS_PX).astype(np.float64)
    value = np.where(along * across > 0, 215.0, 35.0)
    share, drawn = (v.reshape(side, FINER, side, FINER).mean(axis=(1, 3)) for v in (inside, inside * value))
    for row in range(side):
        for column in range(side):
            v, u = low[1] + row, low[0] + column
            if 0 <= v < grey.shape[0] and 0 <= u < grey.shape[1]:
                grey[v, u] = (1.0 - share[row, column]) * grey[v, u] + drawn[row, column]


def finished(grey: FloatArray, rng: np.random.Generator) -> ByteArray:
    """Grey values as a photograph has them: blurred, with noise of 2 DN."""
    blurred = cv2.GaussianBlur(grey, (0, 0), 0.6)
    return np.asarray(np.clip(np.rint(blurred + rng.normal(0.0, 2.0, grey.shape)), 0, 255), np.uint8)


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shown]:
    folder, rng = tmp_path_factory.mktemp("photographs"), np.random.default_rng(6)
    made = simulated(PLAN, tie_points=150)
    truth, names = made.truth, made.block.control_points.name
    places: dict[MarkKey, FloatArray] = {}
    missing: MarkKey | None = None
    paths = []
    for i, (pose, photograph) in enumerate(zip(truth.poses, made.block.photographs, strict=True)):
        grey = 110.0 + 25.0 * cv2.GaussianBlur(rng.normal(size=(PLAN.height_px, PLAN.width_px)), (0, 0), 3.0)
        pixel = project_points(truth.camera, pose, truth.control_position_world_m)
        well_inside = np.all((pixel > RADIUS_PX + 20) & (pixel < [PLAN.width_px - 31, PLAN.height_px - 31]), axis=1)
        own = {names[g]: pixel[g] for g in np.flatnonzero(well_inside).tolist()}
        for name, place in own.items():
            if missing is None and i == 1:
                missing = (name, photograph.name)
                target(grey, place + DISPLACED_PX, 0.4)
                continue
            places[name, photograph.name] = place
            target(grey, place, rng.uniform(0.0, np.pi))
        for place in np.mgrid[40 : PLAN.width_px : 90, 40 : PLAN.height_px : 90].reshape(2, -1).T.astype(float):
            if np.linalg.norm(pixel - place, axis=1).min() > 2 * AROUND_PX:
                target(grey, place, rng.uniform(0.0, np.pi))
        paths.append(folder / f"{i}.png")
        Image.fromarray(finished(grey, rng)).convert("RGB").save(paths[-1])
    assert missing is not None
    patches = PatchReader(paths, [(PLAN.width_px, PLAN.height_px)] * len(paths))
    yield Shown(made, without_marks(made.block), patches, places, missing)
    patches.close()


@pytest.fixture(scope="module")
def proposals(shown: Shown) -> tuple[Proposal, ...]:
    return proposed_marks(shown.block, shown.patches).proposals


def with_mark(shown: Shown, *places: MarkKey) -> Block:
    """The block with marks at true places."""
    points, names = shown.block.control_points, [p.name for p in shown.block.photographs]
    pairs = sorted(
        (points.name.index(point), names.index(photograph), (point, photograph)) for point, photograph in places
    )
    marked = replace(
        points,
        mark_point=np.array([g for g, _, _ in pairs], dtype=np.int64),
        mark_photograph=np.array([i for _, i, _ in pairs], dtype=np.int64),
        mark_pixel=np.array([shown.places[place] for _, _, place in pairs]),
        mark_covariance_px2=isotropic_px2(np.full(len(pairs), 0.1)),
    )
    return replace(shown.block, control_points=marked)


# ---- proposals -----------------------------------------------------------------------------------------------------


def test_all_targets_are_proposed_at_their_places_and_no_decoy_is(
    shown: Shown, proposals: tuple[Proposal, ...]
) -> None:
    """A third of the targets are of the points; one decoy lies beside the ellipse of a place, within the patch."""
    assert np.hypot(*DISPLACED_PX) > 2.0 * float(predicted_places(shown.block).radius_px.max())
    found = {proposal.mark.key: proposal for proposal in proposals}
    assert len(found) == len(proposals)
    assert set(found) == set(shown.places)
    assert len(found) > 8
    for place, proposal in found.items():
        mark = proposal.mark
        assert np.hypot(*(mark.pixel - shown.places[place])) < 0.15
        assert mark.kind == "checker"
        assert mark.raw_pixel is None
        assert mark.sigma_px is not None
        assert LENS_PX <= min(mark.sigma_px) <= max(mark.sigma_px) < 0.2
        assert 0.5 < proposal.score <= 1.0


def test_nothing_is_proposed_where_a_point_is_marked_or_hidden(shown: Shown) -> None:
    marked, hidden, *_ = sorted(shown.places)
    reported: list[tuple[int, int]] = []
    unknown = {("?", hidden[1]), (hidden[0], "?.jpg")}
    found = proposed_marks(
        with_mark(shown, marked),
        shown.patches,
        frozenset({hidden, *unknown}),
        lambda done, total, _: reported.append((done, total)),
    )
    assert {proposal.mark.key for proposal in found.proposals} == set(shown.places) - {marked, hidden}
    total = reported[-1][1]
    assert reported == [(n + 1, total) for n in range(total)]
    assert total <= len(predicted_places(shown.block).point) - 2


def test_where_nothing_is_painted_nothing_is_proposed(shown: Shown, tmp_path: Path) -> None:
    path = tmp_path / "bare.png"
    Image.new("RGB", (PLAN.width_px, PLAN.height_px), (128, 128, 128)).save(path)
    count = len(shown.block.photographs)
    found = proposed_marks(shown.block, PatchReader([path] * count, [(PLAN.width_px, PLAN.height_px)] * count))
    assert (found.proposals, found.targets, found.candidates) == ((), 0, ())
    assert found.photographs == count
    assert str(found).startswith(
        f"nothing resembles a target in the {count} photographs where points may be (their places"
    )


def test_a_faint_target_is_a_candidate_and_its_score_stands_beside_the_limit(shown: Shown, tmp_path: Path) -> None:
    faint = []
    for number, path in enumerate(shown.patches._paths):
        with Image.open(path) as picture:
            grey = np.asarray(picture.convert("L"), np.float64)
        faint.append(tmp_path / f"{number}.png")
        dimmed = np.asarray(np.rint(110.0 + FAINT * (grey - 110.0)), np.uint8)
        Image.fromarray(dimmed).convert("RGB").save(faint[-1])
    patches = PatchReader(faint, [(PLAN.width_px, PLAN.height_px)] * len(faint))
    found = proposed_marks(shown.block, patches)
    patches.close()
    assert (found.proposals, found.targets) == ((), 0)
    best = found.candidates[0]
    assert not any(one.is_target for one in found.candidates)
    assert f"scores {best.score:.1f}, and {best.limit:.1f} is the limit" in str(found)
    assert f"the best of {len(found.candidates)} candidates" in str(found)


def test_what_a_search_came_to_is_said() -> None:
    unsure = SearchResult((), 12, 30, (), 510.0)
    assert str(unsure) == (
        "30 targets found in the 12 photographs where points may be, but none can be assigned to a point (their places "
        "are known to ± 510 px, and 160 px around each were looked at): mark two points in two photographs each, and "
        "search again"
    )
    odd = SearchResult((), 3, 0, (Judgement(25.0, 24.0, False),), 20.0)
    assert "scores 25.0, and 24.0 is the limit, but its size, contrast or sharpness is not that" in str(odd)
    assert "no search was needed: no point without a mark" in str(SearchResult((), 0))


def test_what_cannot_be_looked_at_is_said(shown: Shown, tmp_path: Path) -> None:
    count = len(shown.block.photographs)
    gone = PatchReader([tmp_path / "gone.jpg"] * count, [(PLAN.width_px, PLAN.height_px)] * count)
    with pytest.raises(ImageError, match=r"gone\.jpg"):
        proposed_marks(shown.block, gone)
    with pytest.raises(AdjustmentError, match="no photograph"):
        proposed_marks(replace(shown.block, poses=(None,) * count), shown.patches)


# ---- parts of photographs ------------------------------------------------------------------------------------------


BOX = st.builds(
    lambda x, y, width, height: (x, y, x + width, y + height),
    st.integers(-200, 2000),
    st.integers(-200, 2000),
    st.integers(1, 400),
    st.integers(1, 400),
)


def area(box: Box) -> int:
    return (box[2] - box[0]) * (box[3] - box[1])


def holds(outer: Box, inner: Box) -> bool:
    return outer[0] <= inner[0] and outer[1] <= inner[1] and inner[2] <= outer[2] and inner[3] <= outer[3]


@given(st.lists(BOX, max_size=12))
def test_merged_boxes_cover_all_and_are_no_larger_than_their_sum(boxes: list[Box]) -> None:
    made = merged(boxes)
    assert all(any(holds(outer, inner) for outer in made) for inner in boxes)
    assert all(any(holds(outer, inner) for inner in boxes) for outer in made)
    assert sum(map(area, made)) <= sum(map(area, boxes))
    assert len(made) <= len(set(boxes))
    assert merged(made) == made
    assert merged(boxes[::-1]) == made


def test_boxes_that_are_nearly_one_are_merged_and_others_stay() -> None:
    assert merged([(0, 0, 100, 100), (10, 0, 110, 100), (10, 0, 110, 100)]) == [(0, 0, 110, 100)]
    assert merged([(0, 0, 100, 100), (20, 20, 60, 60)]) == [(0, 0, 100, 100)]
    apart: list[Box] = [(0, 0, 100, 100), (90, 90, 190, 190)]
    assert merged(apart) == apart
    assert merged([]) == []


def test_no_merged_box_is_larger_than_a_patch_may_be() -> None:
    row: list[Box] = [(x, 0, x + 320, 320) for x in range(0, 3 * LARGEST_SIDE, 300)]
    made = merged(row)
    assert max(box[2] - box[0] for box in made) <= LARGEST_SIDE
    assert 3 <= len(made) < 10
    assert all(any(holds(outer, inner) for outer in made) for inner in row)


# ---- searches ------------------------------------------------------------------------------------------------------


def awaited(is_so: Callable[[], bool]) -> None:
    limit = time.monotonic() + 20.0
    while not is_so():
        assert time.monotonic() < limit
        time.sleep(0.005)


def ended(search: TargetSearch) -> SearchState:
    awaited(lambda: not search.state.is_running)
    return search.state


def test_one_search_at_a_time_says_how_far_it_is_and_how_it_ended() -> None:
    going, told = Event(), list[SearchState]()
    entered = Event()

    def looking(progress: Progress) -> str:
        progress(1, 3, "a.jpg")
        entered.set()
        assert going.wait(20.0)
        return "2 targets found"

    search = TargetSearch(lambda: told.append(search.state))
    assert search.state == SearchState(False, "")
    assert search.begin(looking)
    assert entered.wait(20.0)
    assert search.state == SearchState(True, "looking for targets: 1 of 3 parts")
    assert not search.begin(lambda _: "never run")
    going.set()
    assert ended(search) == SearchState(False, "2 targets found")
    assert search.begin(lambda _: "no target found")
    assert ended(search) == SearchState(False, "no target found")
    awaited(lambda: told[-1] == search.state)
    assert SearchState(True, "looking for targets: 1 of 3 parts") in told


def test_what_went_wrong_is_said() -> None:
    def refused(_: Progress) -> str:
        raise PhotogramError("a.jpg is no photograph")

    search = TargetSearch()
    assert search.begin(refused)
    assert ended(search) == SearchState(False, "a.jpg is no photograph")


def test_after_a_defect_another_search_can_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    reported = list[ExceptHookArgs]()
    monkeypatch.setattr("threading.excepthook", reported.append)

    def broken(_: Progress) -> str:
        raise ZeroDivisionError

    search = TargetSearch()
    assert search.begin(broken)
    assert ended(search) == SearchState(False, "the search for targets failed")
    assert search.begin(lambda _: "1 target found")
    assert ended(search).words == "1 target found"
    awaited(lambda: bool(reported))
    assert reported[0].exc_type is ZeroDivisionError
