"""Starting poses of whole blocks against true ones: by control points, from measured poses, from tie points alone."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from makers import PHANTOM
from scipy.spatial.transform import Rotation

from photogram.camera import Camera, Pose, image_plane, project_points, rotation_from_gimbal
from photogram.errors import OrientationError
from photogram.geodesy.frames import LocalFrame
from photogram.measures.mark_covariances import isotropic_px2
from photogram.sfm.orientation import Orientation, OrientationSettings, orient, resections_of
from photogram.sfm.resection import Resection
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

AUTO, GROWTH = OrientationSettings(), OrientationSettings(method="growth")
BY_CONTROL, BY_ATTITUDE = OrientationSettings(method="control"), OrientationSettings(method="attitude")

# ---- by control points ----------------------------------------------------------------------------------------------

CAMERA = PHANTOM
POSE = Pose(rotation_from_gimbal(38.0, -84.0, 3.0), np.array([13.0, -21.0, 58.0]))


def ground(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on rolling ground and their exact marks, spread over the photograph from its corners inwards."""
    rng = np.random.default_rng(seed)
    corners = np.array([[0.1, 0.12], [0.9, 0.2], [0.15, 0.85], [0.8, 0.9]])
    share = np.vstack([corners, rng.uniform(0.1, 0.9, (max(0, count - 4), 2))])[:count]
    pixel = share * [CAMERA.width_px - 1, CAMERA.height_px - 1]
    ray = np.column_stack([image_plane(CAMERA, pixel), np.ones(count)]) * rng.uniform(50.0, 64.0, (count, 1))
    points = POSE.world_from_camera(ray)
    return points, project_points(CAMERA, POSE, points)


def marked(marks: list[int], *, gnss: bool, role: str = "control", camera: Camera = CAMERA) -> Block:
    """Photographs of one place without any tie points, the i-th with ``marks[i]`` control points."""
    points, pixel = ground(8, 12)
    count = len(marks)
    none = np.zeros(0, np.int64)
    photographs = tuple(
        Photograph(
            f"photo_{i}.jpg", 0,
            gnss_world_m=POSE.position_world_m + 0.1 if gnss else None,
            gnss_sigma_m=np.full(3, 0.1) if gnss else None,
        )
        for i in range(count)
    )  # fmt: skip
    seen = np.concatenate([np.arange(n) for n in marks]).astype(np.int64)
    return Block(
        LocalFrame("EPSG:25832", (0.0, 0.0, 0.0), "grid"), (camera,), photographs, (None,) * count,
        TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8)),
        ControlPoints(
            tuple("ABCDEFGH"), (("check" if role == "check" else "control"),) * 8, points, np.full((8, 3), 0.01),
            np.repeat(np.arange(count), marks).astype(np.int64), seen, pixel[seen],
            isotropic_px2(np.full(len(seen), 0.5)),
        ),
    )  # fmt: skip


def swapped(block: Block, photograph: int) -> Block:
    """The same block with the marks of one photograph at each other's places."""
    control = block.control_points
    pixel = control.mark_pixel.copy()
    mine = np.flatnonzero(control.mark_photograph == photograph)
    pixel[mine] = pixel[mine][[3, 0, 5, 1, 7, 2, 4, 6]]
    return replace(block, control_points=replace(control, mark_pixel=pixel))


@pytest.mark.parametrize("settings", [AUTO, BY_CONTROL])
def test_photographs_that_all_show_control_are_resected(settings: OrientationSettings) -> None:
    oriented = orient(marked([8, 3, 4], gnss=True), settings)
    assert oriented.method == "control"
    assert oriented.component.tolist() == [0, 0, 0]
    assert oriented.reason == ("", "", "")
    assert oriented.registered.all()
    for pose, resection in zip(oriented.poses, oriented.resections, strict=True):
        assert pose is not None
        assert isinstance(resection, Resection)
        assert resection.refined is pose
        np.testing.assert_allclose(pose.position_world_m, POSE.position_world_m, rtol=0, atol=1e-6)
        np.testing.assert_allclose(pose.rotation_world_from_camera, POSE.rotation_world_from_camera, atol=1e-7)


def test_three_points_need_a_position() -> None:
    assert [r is not None for r in resections_of(marked([3, 4, 2], gnss=False))[0]] == [False, True, False]
    assert [r is not None for r in resections_of(marked([3, 4, 2], gnss=True))[0]] == [True, True, False]


def test_contradicting_control_names_every_photograph_on_a_line() -> None:
    block = swapped(swapped(marked([8, 8, 8], gnss=False), 0), 2)
    for settings in (AUTO, BY_CONTROL):
        with pytest.raises(OrientationError) as fault:
            orient(block, settings)
        lines = str(fault.value).splitlines()
        assert [line.split(":")[0] for line in lines] == ["photograph photo_0.jpg", "photograph photo_2.jpg"]
        assert all("agree with any pose" in line for line in lines)


def test_control_in_one_line_resects_nothing() -> None:
    block = marked([5], gnss=False)
    line = block.control_points.position_world_m[0] + np.outer(np.arange(8.0), [3.0, 2.0, 0.0])
    points = replace(block.control_points, position_world_m=line, mark_pixel=project_points(CAMERA, POSE, line[:5]))
    assert resections_of(replace(block, control_points=points)) == ((None,), ())


def test_check_points_resect_nothing() -> None:
    assert resections_of(marked([8], gnss=True, role="check")) == ((None,), ())


@pytest.mark.parametrize(
    ("sigmas", "expected"),
    [
        ((0.0,) * 12, True),
        ((2.0, 1.0, 1.0, 0.001, *(0.0,) * 8), True),
        ((np.inf,) * 12, True),
        ((110.0, 20.0, 20.0, *(0.0,) * 9), True),
        ((0.0, 0.0, 0.0, 0.1, *(0.0,) * 8), False),
    ],
)
def test_a_camera_that_is_hardly_known_is_not_resected_by_control(sigmas: tuple[float, ...], expected: bool) -> None:
    block = marked([8], gnss=False, camera=replace(CAMERA, sigmas=np.array(sigmas)))
    assert (resections_of(block)[0][0] is not None) == expected
    assert resections_of(block, any_camera=True)[0][0] is not None


def test_control_that_is_wanted_and_missing_is_told() -> None:
    with pytest.raises(OrientationError, match=r"4 marked control points .*; 2 have fewer, the first photo_1\.jpg"):
        orient(marked([8, 2, 1], gnss=False), BY_CONTROL)


# ---- whole blocks ----------------------------------------------------------------------------------------------------

PLAN = replace(
    whole_survey_plan(800), strips=3, photographs_per_strip=5, gnss_offset_sigma_m=(0.0, 0.0, 0.0), check_points=0
)
COUNT = 15
STRIP = replace(PLAN, strips=1, photographs_per_strip=10, control_points=0)
Change = Callable[[int, Photograph], Photograph]


@cache
def simulated(seed: int = 1, plan: SurveyPlan = PLAN) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=500, mismatches=0.1)


def bare(block: SimulatedBlock, change: Change = lambda _, p: p, *, control: bool = True) -> Block:
    """The block before anything is oriented."""
    photographs = tuple(change(i, p) for i, p in enumerate(block.block.photographs))
    points = block.block.control_points
    points = points if control else points.with_roles(["check"] * len(points))
    return replace(block.block, photographs=photographs, poses=(None,) * len(photographs), control_points=points)


def no_attitude(_: int, p: Photograph) -> Photograph:
    return replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None)


def no_tags(_: int, p: Photograph) -> Photograph:
    return replace(no_attitude(_, p), gnss_world_m=None, gnss_sigma_m=None)


def turned(i: int, p: Photograph) -> Photograph:
    turn = Rotation.random(random_state=i).as_matrix()
    assert p.attitude_world_from_camera is not None
    return replace(p, attitude_world_from_camera=p.attitude_world_from_camera @ turn)


def errors(oriented: Orientation, block: SimulatedBlock) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N, 3) of position in m and (N,) of attitude in degrees, NaN where not registered."""
    position, attitude = np.full((len(oriented.poses), 3), np.nan), np.full(len(oriented.poses), np.nan)
    for i, (pose, truth) in enumerate(zip(oriented.poses, block.truth.poses, strict=True)):
        if pose is not None:
            position[i] = pose.position_world_m - truth.position_world_m
            turn = pose.rotation_world_from_camera.T @ truth.rotation_world_from_camera
            attitude[i] = np.rad2deg(Rotation.from_matrix(turn).magnitude())
    return position, attitude


def assert_true(oriented: Orientation, block: SimulatedBlock, plan_m: float, attitude_deg: float) -> None:
    """Plan and attitude; the height, which an unknown focal length leaves open, to a tenth of itself."""
    position, attitude = errors(oriented, block)
    assert np.nanmax(np.linalg.norm(position[:, :2], axis=1)) < plan_m
    assert np.nanmax(np.abs(position[:, 2])) < 0.1 * block.plan.flying_height_m
    assert np.nanmax(attitude) < attitude_deg


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_good_tags_start_the_block_and_control_places_it(seed: int) -> None:
    oriented = orient(bare(simulated(seed)), AUTO)
    assert oriented.method == "attitude"
    assert oriented.registered.all()
    assert_true(oriented, simulated(seed), 1.5, 1.0)
    # a camera of which only the EXIF focal length was known
    assert oriented.parameters[0][3] == pytest.approx(simulated(seed).truth.camera.radial[0], abs=0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_without_attitudes_it_is_grown(seed: int) -> None:
    oriented = orient(bare(simulated(seed), no_attitude), AUTO)
    assert oriented.method == "growth"
    assert oriented.registered.all()
    assert_true(oriented, simulated(seed), 1.5, 1.0)


def test_control_alone_places_a_block_without_tags() -> None:
    oriented = orient(bare(simulated(1), no_tags), AUTO)
    assert oriented.method == "growth"
    assert_true(oriented, simulated(1), 1.5, 1.0)


def test_positions_alone_place_a_block_without_control() -> None:
    for change in (lambda _, p: p, no_attitude):
        oriented = orient(bare(simulated(1), change, control=False), AUTO)
        assert_true(oriented, simulated(1), 4.0, 4.0)


def test_wrong_attitudes_fall_back_to_growth() -> None:
    oriented = orient(bare(simulated(1), turned), AUTO)
    assert oriented.method == "growth"
    assert oriented.registered.all()
    assert_true(oriented, simulated(1), 1.5, 1.0)
    with pytest.raises(OrientationError, match="do not confirm the measured positions and attitudes"):
        orient(bare(simulated(1), turned), BY_ATTITUDE)


def test_the_method_can_be_set() -> None:
    assert orient(bare(simulated(1)), GROWTH).method == "growth"
    assert orient(bare(simulated(1)), BY_ATTITUDE).method == "attitude"
    with pytest.raises(OrientationError, match="needs three photographs with GNSS position and attitude"):
        orient(bare(simulated(1), no_attitude), BY_ATTITUDE)


def test_a_hardly_known_camera_with_control_everywhere_is_not_taken_for_contradiction() -> None:
    """Four marks in every photograph, but a distortion of 28 px that nobody stated."""
    plan = replace(PLAN, control_points=16, control_marks_per_photograph=4)
    for seed in (1, 2):
        block = simulated(seed, plan)
        oriented = orient(bare(block), AUTO)
        assert oriented.method == "attitude"
        assert oriented.registered.all()
        assert_true(oriented, block, 1.5, 1.0)


def test_known_control_everywhere_is_used_and_is_exact() -> None:
    plan = SurveyPlan(
        strips=2, photographs_per_strip=4, control_points=14, check_points=0, control_marks_per_photograph=4,
        calibration_sigmas=(0.0,) * 11,
    )  # fmt: skip
    block = simulated(1, plan)
    oriented = orient(bare(block), AUTO)
    assert oriented.method == "control"
    assert_true(oriented, block, 3.0, 2.0)


def test_one_photograph_with_contradicting_control_does_not_stop_a_block_that_needs_none() -> None:
    plan = replace(PLAN, calibration_sigmas=(0.0,) * 11, calibration_source="laboratory", control_points=10)
    block = simulated(1, plan)
    control = block.block.control_points
    marks = np.bincount(control.mark_photograph, minlength=COUNT)
    assert marks.min() < 3, "some photographs need their tie points"
    most = int(np.argmax(marks))
    mine = np.flatnonzero(control.mark_photograph == most)
    pixel = control.mark_pixel.copy()
    pixel[mine] = np.roll(pixel[mine], 1, axis=0)
    spoilt = replace(bare(block, no_attitude), control_points=replace(control, mark_pixel=pixel))
    assert len(resections_of(spoilt)[1]) == 1
    oriented = orient(spoilt, AUTO)
    assert oriented.registered.all()
    assert oriented.resections[most] is None
    assert_true(oriented, block, 1.5, 1.0)


def test_control_that_contradicts_in_every_photograph_does_not_stop_a_block_with_tie_points() -> None:
    """All marks of every photograph stand at each other's places: GNSS places what the tie points orient."""
    plan = SurveyPlan(
        strips=2, photographs_per_strip=4, control_points=14, check_points=0, control_marks_per_photograph=4,
        calibration_sigmas=(0.0,) * 11,
    )  # fmt: skip
    block = simulated(1, plan)
    control = block.block.control_points
    pixel = control.mark_pixel.copy()
    for photograph in range(8):
        mine = np.flatnonzero(control.mark_photograph == photograph)
        pixel[mine] = np.roll(pixel[mine], 1, axis=0)
    wrong = replace(bare(block, no_attitude), control_points=replace(control, mark_pixel=pixel))
    assert len(resections_of(wrong)[1]) == 8
    with pytest.raises(OrientationError, match="agree with any pose"):
        orient(wrong, BY_CONTROL)
    oriented = orient(wrong, AUTO)
    assert oriented.method == "growth"
    assert oriented.registered.all()
    assert_true(oriented, block, 4.0, 4.0)


def test_a_resection_far_away_is_not_believed() -> None:
    """Three marks and a position allow a pose 40 m off, of which only the tie points show that it is wrong."""
    plan = replace(PLAN, calibration_sigmas=(0.0,) * 11, calibration_source="laboratory", control_points=14)
    block = simulated(1, plan)
    resections, faults = resections_of(bare(block))
    assert faults == ()
    pairs = zip(resections, block.truth.poses, strict=True)
    error = [np.linalg.norm(r.refined.position_world_m - t.position_world_m) for r, t in pairs if r is not None]
    assert [i for i, e in enumerate(error) if e > 5.0] == [11]
    assert error[11] > 30.0
    oriented = orient(bare(block, no_attitude), AUTO)
    assert oriented.method == "growth"
    assert oriented.registered.all()
    assert [i for i, r in enumerate(oriented.resections) if r is None] == [11]
    assert_true(oriented, block, 1.5, 1.5)


# ---- what is left out ------------------------------------------------------------------------------------------------


def spoilt(block: SimulatedBlock, foreign: list[int]) -> TiePoints:
    """The tie points with the observations of some photographs at each other's places."""
    tie = block.block.tie_points
    pixel = tie.pixel.copy()
    for i in foreign:
        mine = np.flatnonzero(tie.photograph == i)
        pixel[mine] = np.random.default_rng(i).permutation(pixel[mine])
    return replace(tie, pixel=pixel)


@pytest.mark.parametrize("change", [lambda _, p: p, no_attitude])
def test_photographs_of_another_site_and_empty_ones_are_left_out_and_told(change: Change) -> None:
    block = simulated(1)
    tie = spoilt(block, [3, 11])
    tie = tie.select(np.ones(len(tie), dtype=bool), (tie.photograph != 8) | (np.arange(len(tie.photograph)) % 90 == 0))
    rays = np.bincount(tie.photograph, minlength=COUNT)
    assert 0 < rays[8] < 10
    oriented = orient(replace(bare(block, change), tie_points=tie), AUTO)
    out = [3, 8, 11]
    assert np.flatnonzero(~oriented.registered).tolist() == out
    assert np.flatnonzero(oriented.component == -1).tolist() == out
    assert oriented.reason[8] == f"{rays[8]} tie points with other photographs, 20 are needed"
    for i in (3, 11):
        assert oriented.reason[i] == f"its {rays[i]} tie points do not agree with the block"
    assert all(not reason for i, reason in enumerate(oriented.reason) if i not in out)
    assert_true(oriented, block, 1.5, 1.5)


def test_a_photograph_without_tie_points_stays_by_its_control() -> None:
    plan = replace(PLAN, calibration_sigmas=(0.0,) * 11, calibration_source="laboratory", control_points=14)
    block = simulated(1, plan)
    marks = np.bincount(block.block.control_points.mark_photograph, minlength=COUNT)
    alone = int(np.argmax(marks))
    assert marks[alone] >= 4
    tie = block.block.tie_points
    tie = tie.select(np.ones(len(tie), dtype=bool), tie.photograph != alone)
    oriented = orient(replace(bare(block, no_attitude), tie_points=tie), AUTO)
    assert oriented.registered.all()
    assert oriented.component[alone] == 0
    assert oriented.reason[alone] == ""
    assert_true(oriented, block, 1.5, 1.5)


def two_sites(first: SimulatedBlock, second: SimulatedBlock) -> Block:
    """Two blocks in one list of photographs, the second 500 m east; without control."""
    a, b = bare(first, no_attitude, control=False), bare(second, no_attitude, control=False)
    n, p = len(a.photographs), len(a.tie_points)
    east = np.array([500.0, 0.0, 0.0])
    moved = tuple(replace(q, gnss_world_m=q.gnss_world_m + east) for q in b.photographs)
    ties = (a.tie_points, b.tie_points)
    names = ("feature", "pixel", "sigma_px", "position_world_m", "colour")
    return replace(
        a,
        photographs=a.photographs + moved,
        poses=(None,) * (n + len(moved)),
        tie_points=TiePoints(
            np.concatenate([ties[0].photograph, ties[1].photograph + n]),
            np.concatenate([ties[0].point, ties[1].point + p]),
            *(np.concatenate([getattr(tie, name) for tie in ties]) for name in names),
        ),
    )


def test_two_sites_are_two_components_of_one_system() -> None:
    small = simulated(2, replace(PLAN, strips=2, photographs_per_strip=4))
    oriented = orient(two_sites(small, simulated(1)), AUTO)
    assert oriented.component.tolist() == [1] * 8 + [0] * COUNT
    assert oriented.ties == ("GNSS positions", "GNSS positions")
    assert set(oriented.reason) == {""}
    truth = [p.position_world_m for p in small.truth.poses]
    truth += [p.position_world_m + np.array([500.0, 0.0, 0.0]) for p in simulated(1).truth.poses]
    pairs = zip(oriented.poses, truth, strict=True)
    assert max(np.linalg.norm(p.position_world_m - t) for p, t in pairs if p is not None) < 6.0


def test_no_two_photographs_that_fit_are_told() -> None:
    block = bare(simulated(1), no_attitude)
    tie = block.tie_points
    for nothing in (tie.select(np.zeros(len(tie), dtype=bool)), spoilt(simulated(1), list(range(COUNT)))):
        with pytest.raises(OrientationError, match=r"no two of the 15 photographs .* 20 tie points in common"):
            orient(replace(block, tie_points=nothing), AUTO)


# ---- the way into the world ------------------------------------------------------------------------------------------


def test_control_counts_for_more_than_positions() -> None:
    """Tags of another height system: 40 m too high, all of them."""
    high = np.array([0.0, 0.0, 40.0])
    oriented = orient(bare(simulated(1), lambda _, p: replace(p, gnss_world_m=p.gnss_world_m + high)), AUTO)
    assert_true(oriented, simulated(1), 1.5, 1.0)


def test_one_wrong_control_point_of_six_does_not_matter() -> None:
    block = bare(simulated(1), no_tags)
    position = block.control_points.position_world_m.copy()
    position[2] += [30.0, -20.0, 5.0]
    oriented = orient(replace(block, control_points=replace(block.control_points, position_world_m=position)), AUTO)
    assert_true(oriented, simulated(1), 1.5, 1.0)


def test_control_that_fits_nothing_leaves_the_positions_or_is_told() -> None:
    block = simulated(1)
    points = block.block.control_points
    position = np.random.default_rng(0).permutation(points.position_world_m)
    wrong = replace(points, position_world_m=position * [3.0, 1.0, 1.0] + [0.0, 0.0, 1.0])
    oriented = orient(replace(bare(block, no_attitude), control_points=wrong), AUTO)
    assert_true(oriented, block, 4.0, 4.0)
    with pytest.raises(OrientationError, match="the control points do not fit the block"):
        orient(replace(bare(block, no_tags), control_points=wrong), AUTO)


def test_positions_of_other_photographs_are_told() -> None:
    block = simulated(1)
    order = np.random.default_rng(0).permutation(COUNT)
    mixed = bare(
        block, lambda i, p: replace(p, gnss_world_m=block.block.photographs[order[i]].gnss_world_m), control=False
    )
    for settings in (AUTO, GROWTH):
        with pytest.raises(OrientationError, match="check that they belong to these photographs"):
            orient(mixed, settings)


@pytest.mark.parametrize("wobble_m", [0.05, 1.0])
@pytest.mark.parametrize("settings", [AUTO, GROWTH])
def test_attitudes_hold_the_turn_of_one_strip(settings: OrientationSettings, wobble_m: float) -> None:
    """Positions good to 2 m, along one line: across it there is more noise than flight."""
    for seed in (1, 2):
        block = simulated(seed, replace(STRIP, position_noise_m=wobble_m))
        oriented = orient(bare(block), settings)
        assert oriented.registered.all()
        assert_true(oriented, block, 6.0, 3.0)


@pytest.mark.parametrize("settings", [AUTO, GROWTH])
def test_attitudes_hold_the_tilt_of_a_small_block(settings: OrientationSettings) -> None:
    """Six photographs within 30 m: positions good to 2 m alone would tilt it by up to 15 degrees."""
    for seed in (1, 2, 3):
        block = simulated(seed, replace(PLAN, strips=2, photographs_per_strip=3))
        assert_true(orient(bare(block, control=False), settings), block, 4.0, 3.0)


def test_what_is_missing_is_told() -> None:
    block = simulated(1)
    expected = (
        r"the block of 15 photographs cannot be georeferenced in EPSG:25832: 0 control points are marked in two of "
        r"them, 0 have a GNSS position; give at least three of either, not collinear"
    )
    with pytest.raises(OrientationError, match=expected):
        orient(bare(block, no_tags, control=False), AUTO)
    points = block.block.control_points
    two = points.with_roles(["control", "control", "check", "check", "check", "check"])
    with pytest.raises(OrientationError, match="2 control points are marked in two of them, 1 have a GNSS position"):
        orient(replace(bare(block, lambda i, p: no_tags(i, p) if i else no_attitude(i, p)), control_points=two), AUTO)
    straight = simulated(1, replace(STRIP, position_noise_m=0.05, gnss_sigma_m=(0.02, 0.02, 0.02)))
    with pytest.raises(OrientationError, match="10 have a GNSS position; give at least three of either, not collinear"):
        orient(bare(straight, no_attitude), AUTO)


# ---- running ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [lambda _, p: p, no_attitude])
def test_the_same_block_is_oriented_the_same_bit_for_bit(change: Change) -> None:
    one, other = (orient(bare(simulated(2), change), AUTO) for _ in range(2))
    for a, b in zip(one.poses, other.poses, strict=True):
        assert a is not None
        assert b is not None
        np.testing.assert_array_equal(a.rotation_world_from_camera, b.rotation_world_from_camera)
        np.testing.assert_array_equal(a.position_world_m, b.position_world_m)
    np.testing.assert_array_equal(one.parameters[0], other.parameters[0])


def test_progress_is_told_in_photographs() -> None:
    said: list[tuple[int, int, str]] = []
    orient(bare(simulated(1), no_attitude), AUTO, lambda *step: said.append(step))
    assert said[-1][:2] == (COUNT, COUNT)
    assert all(0 <= done <= total == COUNT for done, total, _ in said)


def test_points_of_a_hand_held_receiver_place_a_block_that_has_nothing_else() -> None:
    """Their list names no accuracy: centimetres are assumed where they scatter by metres."""
    made = simulate_block(
        SurveyPlan(strips=4, photographs_per_strip=6, gnss_tags=False, control_points=9, control_sigma_m=(2.0,) * 3),
        3, tie_points=600,
    )  # fmt: skip
    points = made.block.control_points
    assumed = np.ones(len(points), dtype=bool)
    stated = replace(points, sigma_m=np.tile([0.03, 0.03, 0.05], (len(points), 1)), sigma_assumed=assumed)
    block = replace(made.block, control_points=stated, poses=(None,) * len(made.block.poses))
    oriented = orient(block, AUTO)
    true = np.array([pose.position_world_m for pose in made.truth.poses])
    found = np.array([pose.position_world_m for pose in oriented.poses if pose is not None])
    assert len(found) == len(true)
    assert np.abs(found - true).max() < 8.0
