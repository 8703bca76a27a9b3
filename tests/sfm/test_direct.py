"""Blocks started from measured poses: taken where the measurements are good, refused where they are not."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from makers import true_centres
from scipy.spatial.transform import Rotation

from photogram.sfm import direct
from photogram.sfm.direct import direct_structures, measured
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.similarity import fit_similarity, robust_similarity
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import Block, Photograph

SETTINGS = StructureSettings()
PLAN = replace(whole_survey_plan(800), control_points=0, check_points=0, gnss_offset_sigma_m=(0.0, 0.0, 0.0))
GSD_M = PLAN.gsd_m
Change = Callable[[int, Photograph], Photograph]


@cache
def simulated(seed: int = 1, plan: SurveyPlan = PLAN) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=800, mismatches=0.1)


def changed(block: SimulatedBlock, change: Change) -> Block:
    photographs = tuple(change(i, p) for i, p in enumerate(block.block.photographs))
    return replace(block.block, photographs=photographs, poses=(None,) * len(photographs))


def turned(degrees: float, axis: str, *, each: bool = False) -> Change:
    """Turn every measured attitude about an axis of the camera, or each about one of its own."""

    def change(i: int, p: Photograph) -> Photograph:
        rng = np.random.default_rng(i)
        own = Rotation.from_rotvec(np.deg2rad(degrees) * rng.standard_normal(3))
        turn = own if each else Rotation.from_euler(axis, degrees, degrees=True)
        assert p.attitude_world_from_camera is not None
        return replace(p, attitude_world_from_camera=p.attitude_world_from_camera @ turn.as_matrix())

    return change


def shuffled(block: SimulatedBlock, seed: int, share: float = 1.0) -> Change:
    """Give some photographs each other's positions."""
    rng = np.random.default_rng(seed)
    count = len(block.block.photographs)
    some = rng.permutation(count)[: round(share * count)]
    source = np.arange(count)
    source[some] = np.roll(some, 1)
    return lambda i, p: replace(p, gnss_world_m=block.block.photographs[source[i]].gnss_world_m)


def whole(block: Block, settings: StructureSettings) -> Structure | None:
    """The one component that measured poses lead to, None where they are refused."""
    structures = direct_structures(block, settings)
    assert len(structures) <= 1
    return structures[0] if structures else None


def shape_error_m(structure: Structure, block: SimulatedBlock) -> np.ndarray:
    """Errors of the centres of the registered photographs after the best similarity."""
    r = structure.registered
    fit = robust_similarity(structure.position[r], true_centres(block)[r], np.full(int(r.sum()), 0.5))[0]
    return np.asarray(np.linalg.norm(fit.points(structure.position[r]) - true_centres(block)[r], axis=1))


@pytest.mark.parametrize("seed", range(5))
def test_consumer_positions_and_attitudes_are_confirmed(seed: int) -> None:
    """Positions good to 2 m, attitudes to 1 degree, and a camera of which only the EXIF focal length is known."""
    block = simulated(seed)
    structure = whole(changed(block, lambda _, p: p), SETTINGS)
    assert structure is not None
    assert structure.registered.all()
    assert shape_error_m(structure, block).max() < 12.0 * GSD_M
    tie, good = structure.tie_points, structure.good
    rays = np.bincount(tie.point[good], minlength=len(tie))[tie.point]
    assert good[~block.mismatch].mean() > 0.95
    assert np.count_nonzero(good & block.mismatch & (rays >= 3)) <= 0.01 * block.mismatch.sum()
    # the frame stays the world frame: what is left are the 2 m of the positions, averaged
    shift = structure.position - true_centres(block)
    assert np.linalg.norm(shift.mean(axis=0)) < 1.5
    assert structure.parameters[0, 3] == pytest.approx(block.truth.camera.radial[0], abs=0.02)


def test_it_works_without_a_flying_height() -> None:
    block = simulated(2)
    structure = whole(changed(block, lambda _, p: replace(p, height_above_ground_m=None)), SETTINGS)
    assert structure is not None
    assert structure.registered.all()
    assert shape_error_m(structure, block).max() < 12.0 * GSD_M


def test_oblique_photographs_beside_nadir_ones() -> None:
    plan = replace(PLAN, strips=3, photographs_per_strip=5, oblique_strip=True, oblique_angle_deg=35.0)
    block = simulated(1, plan)
    structure = whole(changed(block, lambda _, p: p), SETTINGS)
    assert structure is not None
    assert structure.registered.all()
    assert shape_error_m(structure, block).max() < 12.0 * GSD_M


def test_a_strip_is_confirmed() -> None:
    block = simulated(1, replace(PLAN, strips=1, photographs_per_strip=8))
    structure = whole(changed(block, lambda _, p: p), SETTINGS)
    assert structure is not None
    assert structure.registered.all()
    truth = np.array([pose.rotation_world_from_camera for pose in block.truth.poses])
    turn = Rotation.from_matrix(np.swapaxes(structure.rotation, 1, 2) @ truth).magnitude()
    assert np.rad2deg(turn).max() < 4.0


def test_measured_positions_hold_the_frame_of_a_block_of_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shift changes no image point, so that the held positions must come out where they were measured on average."""
    block = changed(simulated(1), lambda _, p: p)
    given = np.array([p.gnss_world_m for p in block.photographs])
    off_m = []
    for held in (direct.START_SHARE, np.inf):
        monkeypatch.setattr(direct, "START_SHARE", held)
        structure = whole(block, SETTINGS)
        assert structure is not None
        assert structure.registered.all()
        off_m.append(float(np.linalg.norm((structure.position - given).mean(axis=0))))
    assert off_m[0] < 0.2 * off_m[1]


def test_a_common_turn_of_all_attitudes_does_no_harm() -> None:
    """A compass that is off by 8 degrees: the tie points and the positions say so."""
    block = simulated(1)
    structure = whole(changed(block, turned(8.0, "z")), SETTINGS)
    assert structure is not None
    assert structure.registered.all()
    assert shape_error_m(structure, block).max() < 12.0 * GSD_M


def refused(block: SimulatedBlock, change: Change) -> bool:
    return whole(changed(block, change), SETTINGS) is None


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_attitudes_off_by_a_right_angle_are_refused(axis: str) -> None:
    for seed in (0, 2):
        assert refused(simulated(seed), turned(90.0, axis))


def test_attitudes_of_nobody_are_refused() -> None:
    assert refused(simulated(1), turned(120.0, "x", each=True))


@pytest.mark.parametrize("seed", range(4))
def test_shuffled_positions_are_refused(seed: int) -> None:
    """Image points can agree with a block that is folded; measured positions show it."""
    block = simulated(seed)
    assert refused(block, shuffled(block, seed))


@pytest.mark.parametrize("seed", range(3))
def test_a_few_wrong_positions_are_survived_or_refused_but_never_believed(seed: int) -> None:
    block = simulated(seed)
    structure = whole(changed(block, shuffled(block, seed, 0.2)), SETTINGS)
    if structure is not None:
        assert structure.registered.sum() >= 15
        assert shape_error_m(structure, block).max() < 25.0 * GSD_M


@pytest.mark.parametrize(
    ("seed", "rows", "columns", "foreign"), [(1, 4, 6, [3, 11, 20]), (14, 3, 5, [2, 13]), (21, 3, 5, [2, 13])]
)
def test_photographs_of_another_site_are_not_in_it_and_bend_nothing(
    seed: int, rows: int, columns: int, foreign: list[int]
) -> None:
    """Before they are known for what they are, they pull at the others, and at the calibration."""
    block = simulated(seed, replace(PLAN, strips=rows, photographs_per_strip=columns))
    tie = block.block.tie_points
    pixel = tie.pixel.copy()
    for i in foreign:
        mine = np.flatnonzero(tie.photograph == i)
        pixel[mine] = np.random.default_rng(i).permutation(pixel[mine])
    spoilt = replace(changed(block, lambda _, p: p), tie_points=replace(tie, pixel=pixel))
    structure = whole(spoilt, SETTINGS)
    assert structure is not None
    np.testing.assert_array_equal(np.flatnonzero(~structure.registered), foreign)
    assert shape_error_m(structure, block).max() < 25.0 * GSD_M
    assert structure.parameters[0, 0] == pytest.approx(block.truth.camera.focal_px, rel=0.05)


def test_photographs_without_measurements_are_not_in_it() -> None:
    block = simulated(1)

    def strip(i: int, p: Photograph) -> Photograph:
        if i == 4:
            return replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None)
        return replace(p, gnss_world_m=None, gnss_sigma_m=None) if i == 7 else p

    some = changed(block, strip)
    assert np.flatnonzero(~measured(some)).tolist() == [4, 7]
    structure = whole(some, SETTINGS)
    assert structure is not None
    assert np.flatnonzero(~structure.registered).tolist() == [4, 7]


def test_two_measured_photographs_are_too_few() -> None:
    block = simulated(1)
    bare = changed(block, lambda i, p: p if i < 2 else replace(p, gnss_world_m=None, gnss_sigma_m=None))
    assert whole(bare, SETTINGS) is None


def test_no_tie_points_confirm_nothing() -> None:
    block = changed(simulated(1), lambda _, p: p)
    none = block.tie_points.select(np.zeros(len(block.tie_points), dtype=bool))
    assert whole(replace(block, tie_points=none), SETTINGS) is None


def test_the_same_block_starts_the_same_bit_for_bit() -> None:
    one, other = (whole(changed(simulated(3), lambda _, p: p), SETTINGS) for _ in range(2))
    assert one is not None
    assert other is not None
    for name in ("rotation", "position", "parameters", "point", "good"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_better_measurements_end_nearer_to_the_truth() -> None:
    exact = replace(PLAN, gnss_sigma_m=(0.02, 0.02, 0.03), attitude_sigma_deg=0.1)
    errors = []
    for plan in (PLAN, exact):
        block = simulated(1, plan)
        structure = whole(changed(block, lambda _, p: p), SETTINGS)
        assert structure is not None
        errors.append(np.linalg.norm(structure.position - true_centres(block), axis=1).max())
        assert fit_similarity(structure.position, true_centres(block)).scale == pytest.approx(1.0, abs=0.06)
    assert errors[1] < errors[0]
