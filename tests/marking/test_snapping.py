"""What clicks mean: targets of known centre, and a textured plane seen from known poses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
from lib.target_pictures import bare, render
from makers import simulated
from PIL import Image

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.errors import ImageError
from photogram.marking.page import snapping
from photogram.marking.page.patches import PatchReader
from photogram.marking.page.snapping import LENS_PX, REACH_PX, Click, OtherMark, Snapped, Snapper, ground_scale
from photogram.marking.targets.kinds import Kind, MeasuredCentre
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

CAMERA = Camera("c", 480, 360, 400.0, np.array([241.0, 178.0]))
TARGETS, FLAT, MISSING = 3, 4, 5
"""Photographs after those of the plane: of targets, of nothing, and one that is not there."""
CELL_M, EXTENT_M, FINER = 0.05, 36.0, 3
"""Of the plane's texture, half the side of a photograph's pixel on it; half its side; points along a pixel's side."""
SIGMA_PX = 0.08
"""Of the marks in the other photographs."""
PLACES_M = [(0.0, 0.0), (3.0, -2.0), (-4.0, 3.5), (1.5, 5.0)]
SHAPES = ("checker disc", "checker square", "circle")


def pose(east: float, north: float, up: float, heading_deg: float, tilt_deg: float) -> Pose:
    """A camera that looks down, its upper edge turned clockwise from north, and tilted to it."""
    h, t = np.radians([-heading_deg, tilt_deg])
    turn = np.array([[np.cos(h), -np.sin(h), 0.0], [np.sin(h), np.cos(h), 0.0], [0.0, 0.0, 1.0]])
    lean = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(t), -np.sin(t)], [0.0, np.sin(t), np.cos(t)]])
    return Pose(turn @ lean @ np.diag([1.0, -1.0, -1.0]), np.array([east, north, up]))


POSES = (pose(0.0, 0.0, 40.0, 0.0, 0.0), pose(4.0, -3.0, 44.0, 35.0, 3.0), pose(-5.0, 2.0, 34.0, 180.0, -5.0))


def plane(ground: FloatArray, seen_from: Pose, rng: np.random.Generator) -> ByteArray:
    """The plane at height 0 in a photograph: each pixel the mean of many points, with noise of 2 DN."""
    K = np.array(
        [
            [CAMERA.focal_px, 0.0, CAMERA.principal_point_px[0]],
            [0.0, CAMERA.focal_px, CAMERA.principal_point_px[1]],
            [0.0, 0.0, 1.0],
        ]
    )
    R, C = seen_from.rotation_world_from_camera, seen_from.position_world_m
    from_ground = K @ R.T @ np.column_stack([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], -C])
    to_ground = np.array([[CELL_M, 0.0, -EXTENT_M], [0.0, -CELL_M, EXTENT_M], [0.0, 0.0, 1.0]])
    first = 0.5 * (FINER - 1)
    fine = np.array([[FINER, 0.0, first], [0.0, FINER, first], [0.0, 0.0, 1.0]])
    size = CAMERA.width_px * FINER, CAMERA.height_px * FINER
    shown = cv2.warpPerspective(ground.astype(np.float32), fine @ from_ground @ to_ground, size, flags=cv2.INTER_CUBIC)
    grey = shown.reshape(CAMERA.height_px, FINER, CAMERA.width_px, FINER).mean(axis=(1, 3))
    return np.asarray(np.clip(np.rint(grey + rng.normal(0.0, 2.0, grey.shape)), 0, 255), np.uint8)


@pytest.fixture(scope="module")
def block() -> Block:
    """Photographs of the plane with their true poses, and others without any."""
    made = simulated(SurveyPlan(strips=1, photographs_per_strip=6), tie_points=20).block
    return replace(made, cameras=(CAMERA,), poses=(*POSES, None, None, None))


@dataclass(frozen=True, eq=False)
class Photographed:
    """The photographs, and the centres (2,) of the targets in that of targets by their shape, px."""

    patches: PatchReader
    centres: dict[str, FloatArray]


@pytest.fixture(scope="module")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Photographed]:
    folder, rng = tmp_path_factory.mktemp("photographs"), np.random.default_rng(4)
    side = round(2 * EXTENT_M / CELL_M)
    ground = 130.0 + sum(
        gain * cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), scale) * scale
        for gain, scale in ((120.0, 3.0), (60.0, 12.0))
    )
    board, centres = bare(rng, "asphalt", CAMERA.width_px)[: CAMERA.height_px], {}
    for n, shape in enumerate(SHAPES):
        own = render(rng, shape, 26.0, 25.0, 0.7, "asphalt")
        corner, (rows, columns) = (20 + 150 * n, 110 + 40 * n), own.grey.shape
        board[corner[1] : corner[1] + rows, corner[0] : corner[0] + columns] = own.grey
        centres[shape] = own.centre_px + corner
    pictures = [*(plane(ground, seen_from, rng) for seen_from in POSES), board, np.full_like(board, 128)]
    paths = [folder / f"{n}.png" for n in range(6)]
    for path, grey in zip(paths, pictures, strict=False):
        Image.fromarray(grey).convert("RGB").save(path)
    patches = PatchReader(paths, [(CAMERA.width_px, CAMERA.height_px)] * 6)
    yield Photographed(patches, centres)
    patches.close()


@pytest.fixture(scope="module")
def snapper(photographed: Photographed) -> Snapper:
    return Snapper(photographed.patches)


@pytest.fixture(scope="module")
def centres(photographed: Photographed) -> dict[str, FloatArray]:
    return photographed.centres


def shown_at(photograph: int, place_m: tuple[float, float]) -> tuple[float, float]:
    """Where a photograph shows a place of the plane."""
    u, v = project_points(CAMERA, POSES[photograph], np.array([[*place_m, 0.0]]))[0]
    return float(u), float(v)


def click(
    block: Block,
    photograph: int,
    pixel: tuple[float, float],
    *others: OtherMark,
    reach_px: float = 10.0,
    position: tuple[float, float] | None = None,
) -> Click:
    """A click of a point that is known to a third of a metre, where it is known."""
    X = np.full(3, np.nan) if position is None else np.array([position[0] + 0.3, position[1] - 0.2, 0.1])
    return Click(block, photograph, pixel, reach_px, others, X)


def of_plane(block: Block, place_m: tuple[float, float], off: tuple[float, float], *seen: int) -> Click:
    """A click beside a place of the plane in the first photograph, with true marks in others."""
    u, v = shown_at(0, place_m)
    others = [OtherMark(i, shown_at(i, place_m), SIGMA_PX) for i in seen]
    return click(block, 0, (u + off[0], v + off[1]), *others, position=place_m)


def off_px(found: Snapped | None, true: FloatArray | tuple[float, float]) -> float:
    assert found is not None
    return float(np.hypot(*np.subtract(found.pixel, true)))


# ---- targets -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("off", [(3.0, 0.0), (-2.0, 2.2)])
def test_a_click_beside_a_target_means_its_centre(
    snapper: Snapper, block: Block, centres: dict[str, FloatArray], shape: str, off: tuple[float, float]
) -> None:
    u, v = centres[shape]
    found = snapper.centre(click(block, TARGETS, (float(u + off[0]), float(v + off[1]))))
    assert off_px(found, centres[shape]) < 0.15
    assert found is not None
    assert found.kind == shape.split()[0]
    sigma = np.sqrt(np.linalg.eigvalsh(found.covariance_px2))
    assert LENS_PX < sigma[0] <= sigma[1] < 0.2
    np.testing.assert_array_equal(found.covariance_px2, found.covariance_px2.T)


def test_a_target_is_preferred_to_what_other_marks_look_like(
    snapper: Snapper, block: Block, centres: dict[str, FloatArray]
) -> None:
    u, v = centres[SHAPES[0]]
    posed = replace(block, poses=(*POSES, POSES[0], None, None))
    other = OtherMark(1, shown_at(1, (0.0, 0.0)), SIGMA_PX)
    found = snapper.centre(click(posed, TARGETS, (float(u) + 2.0, float(v)), other, position=(0.0, 0.0)))
    assert off_px(found, (float(u), float(v))) < 0.15


def test_the_reach_is_kept_within_bounds(snapper: Snapper, block: Block, centres: dict[str, FloatArray]) -> None:
    u, v = (float(value) for value in centres[SHAPES[0]])
    assert snapper.centre(click(block, TARGETS, (u + 8.0, v), reach_px=5.0)) is None
    assert off_px(snapper.centre(click(block, TARGETS, (u + 8.0, v), reach_px=12.0)), (u, v)) < 0.15
    near, far = REACH_PX
    assert off_px(snapper.centre(click(block, TARGETS, (u + near - 1.0, v), reach_px=0.1)), (u, v)) < 0.15
    assert snapper.centre(click(block, TARGETS, (u, v + far + 20.0), reach_px=1e6)) is None


def test_nothing_is_found_where_nothing_is(snapper: Snapper, block: Block) -> None:
    assert snapper.centre(click(block, FLAT, (200.0, 150.0))) is None
    assert snapper.centre(click(block, FLAT, (0.0, 359.0))) is None, "at the edge of a photograph too"


def test_a_photograph_that_is_gone_is_said(snapper: Snapper, block: Block) -> None:
    with pytest.raises(ImageError, match=r"5\.png"):
        snapper.centre(click(block, MISSING, (200.0, 150.0)))


def test_preparation_needs_no_photograph() -> None:
    Snapper(PatchReader([], [])).prepare()


# ---- what looks like the other marks -------------------------------------------------------------------------------


@pytest.mark.parametrize("place_m", PLACES_M)
def test_without_a_target_a_click_means_what_looks_like_the_other_marks(
    snapper: Snapper, block: Block, place_m: tuple[float, float]
) -> None:
    """Of photographs that are turned by 35° and 180°, tilted, and taken from other heights."""
    for seen in ((1,), (2,), (1, 2)):
        found = snapper.centre(of_plane(block, place_m, (2.5, -1.7), *seen))
        assert off_px(found, shown_at(0, place_m)) < 0.3, seen
        assert found is not None
        assert found.kind == "matched"
        sigma = np.sqrt(np.linalg.eigvalsh(found.covariance_px2))
        assert np.hypot(LENS_PX, 0.7 * SIGMA_PX) < sigma[0] <= sigma[1] < 0.3


@pytest.mark.parametrize(("beside_px", "kind"), [(6.5, "matched"), (3.0, "corner")])
def test_a_target_away_from_the_click_gives_way_to_what_the_other_marks_look_like(
    snapper: Snapper, block: Block, monkeypatch: pytest.MonkeyPatch, beside_px: float, kind: str
) -> None:
    """Lines on the ground have corners, too; where target and marks mean the same, the target is sharper."""
    whole = of_plane(block, PLACES_M[1], (1.0, 1.0), 1, 2)

    def corner_beside(_grey: ByteArray, near: FloatArray, _reach_px: float, _focal_px: float) -> MeasuredCentre:
        return MeasuredCentre(Kind.CORNER, near + np.array([beside_px, 0.0]), 0.01 * np.eye(2), 0.9, 10.0, 90.0)

    monkeypatch.setattr(snapping, "snap", corner_beside)
    found = snapper.centre(whole)
    assert found is not None
    assert found.kind == kind
    alone = snapper.centre(replace(whole, others=()))
    assert alone is not None
    assert alone.kind == "corner"


def test_the_standard_deviation_of_the_other_marks_is_passed_on(snapper: Snapper, block: Block) -> None:
    """From the lower of two photographs to the higher one it shrinks with the scale."""
    u, v = shown_at(0, PLACES_M[0])
    covariance = []
    for sigma_px in (0.05, 1.0):
        other = OtherMark(2, shown_at(2, PLACES_M[0]), sigma_px)
        found = snapper.centre(click(block, 0, (u + 1.0, v), other, position=PLACES_M[0]))
        assert found is not None
        covariance.append(found.covariance_px2)
    added = covariance[1] - covariance[0]
    scale = POSES[2].position_world_m[2] / POSES[0].position_world_m[2]
    np.testing.assert_allclose(added, (1.0 - 0.05**2) * scale**2 * np.eye(2), atol=0.08)


def test_marks_that_disagree_say_nothing(snapper: Snapper, block: Block) -> None:
    place_m = PLACES_M[1]
    u, v = shown_at(0, place_m)
    right, (wrong_u, wrong_v) = OtherMark(1, shown_at(1, place_m), SIGMA_PX), shown_at(2, place_m)
    wrong = OtherMark(2, (wrong_u + 5.0, wrong_v - 3.0), SIGMA_PX)
    assert snapper.centre(click(block, 0, (u, v), right, position=place_m)) is not None
    assert snapper.centre(click(block, 0, (u, v), right, wrong, position=place_m)) is None


def test_marks_that_cannot_be_compared_say_nothing(snapper: Snapper, block: Block) -> None:
    place_m = PLACES_M[1]
    whole = of_plane(block, place_m, (1.0, 1.0), 1, 2)
    assert snapper.centre(whole) is not None
    assert snapper.centre(replace(whole, others=())) is None
    assert snapper.centre(replace(whole, others=(OtherMark(0, shown_at(0, place_m), SIGMA_PX),))) is None, "its own"
    assert snapper.centre(replace(whole, position_world_m=np.full(3, np.nan))) is None
    for lost in ((None, *POSES[1:]), (POSES[0], None, None)):
        assert snapper.centre(replace(whole, block=replace(block, poses=(*lost, None, None, None)))) is None
    u, v = whole.pixel
    assert snapper.centre(replace(whole, pixel=(u + 40.0, v))) is None, "beyond the reach"


def test_the_scale_of_level_ground() -> None:
    for heading_deg, expected in ((0.0, [[10.0, 0.0], [0.0, -10.0]]), (90.0, [[0.0, -10.0], [-10.0, 0.0]])):
        found = ground_scale(CAMERA, pose(0.0, 0.0, 40.0, heading_deg, 0.0), np.zeros(3))
        assert found is not None
        np.testing.assert_allclose(found, np.array(expected), atol=1e-4)
    assert ground_scale(CAMERA, None, np.zeros(3)) is None
    assert ground_scale(CAMERA, POSES[0], np.array([0.0, 0.0, 80.0])) is None, "behind the camera"
