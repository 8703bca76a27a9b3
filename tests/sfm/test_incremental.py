"""Blocks grown from their tie points alone, against the truth of simulated flights."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from makers import true_centres

from photogram.camera import Camera, Pose, Similarity, project_points, rotation_from_gimbal
from photogram.sfm.incremental import grow, seed_pairs, shared_points
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import SimulatedBlock, SurveyPlan, simulate_block, whole_survey_plan
from photogram.survey import TiePoints

SETTINGS = StructureSettings()
KNOWN = (0.0,) * 11
PLAN = SurveyPlan(
    strips=4, photographs_per_strip=6, forward_overlap=0.75, control_points=0, check_points=0, calibration_sigmas=KNOWN
)
SMALL = replace(PLAN, strips=2, photographs_per_strip=4)


@cache
def simulated(plan: SurveyPlan, seed: int = 1, *, mismatches: float = 0.1, tie_points: int = 1000) -> SimulatedBlock:
    return simulate_block(plan, seed, tie_points=tie_points, mismatches=mismatches)


def grown(
    block: SimulatedBlock, tie: TiePoints | None = None, settings: StructureSettings = SETTINGS
) -> list[Structure]:
    camera_of = block.block.camera_of
    return grow(block.block.tie_points if tie is None else tie, block.block.cameras, camera_of, settings)


def firm_points(structure: Structure, block: SimulatedBlock) -> np.ndarray:
    """Tie points (P,) that three or more rays agree in, where there are three, none of them a mismatch."""
    tie = structure.tie_points
    wrong = np.bincount(tie.point[structure.good & block.mismatch], minlength=len(tie))
    seen = np.bincount(tie.point[structure.good], minlength=len(tie))
    return np.asarray((seen >= min(3, len(structure.registered))) & (wrong == 0))


def world(structure: Structure, block: SimulatedBlock) -> Similarity:
    """The similarity from a structure to the truth; by tie points too, since centres may stand in one line."""
    r, firm = structure.registered, firm_points(structure, block)
    source = np.vstack([structure.position[r], structure.point[firm]])
    return fit_similarity(source, np.vstack([true_centres(block)[r], block.tie_point_position_world_m[firm]]))


def centre_error_m(structure: Structure, block: SimulatedBlock) -> np.ndarray:
    """Errors (N,) of the projection centres, NaN where not registered."""
    error = np.linalg.norm(world(structure, block).points(structure.position) - true_centres(block), axis=1)
    return np.where(structure.registered, error, np.nan)


def attitude_error_deg(structure: Structure, block: SimulatedBlock) -> np.ndarray:
    truth = np.array([pose.rotation_world_from_camera for pose in block.truth.poses])
    turn = np.swapaxes(world(structure, block).rotation @ structure.rotation, 1, 2) @ truth
    return np.asarray(np.rad2deg(np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))))


def assert_whole_and_true(components: list[Structure], block: SimulatedBlock, gsd: float) -> Structure:
    """One component of all photographs, their centres within ``gsd`` ground sampling distances of the truth (RMS)."""
    assert [int(s.registered.sum()) for s in components] == [len(block.block.photographs)]
    error = centre_error_m(components[0], block) / block.plan.gsd_m
    assert np.sqrt(np.mean(error**2)) < gsd
    assert error.max() < 2.5 * gsd
    assert attitude_error_deg(components[0], block).max() < 0.5
    return components[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_twenty_four_photographs_among_mismatches(seed: int) -> None:
    block = simulated(PLAN, seed)
    structure = assert_whole_and_true(grown(block), block, 8.0)
    tie, good = structure.tie_points, structure.good
    rays = np.bincount(tie.point[good], minlength=len(tie))[tie.point]
    assert good[~block.mismatch].mean() > 0.95
    # along the epipolar line of two photographs nothing tells a mismatch
    assert good[block.mismatch].mean() < 0.12
    assert np.count_nonzero(good & block.mismatch & (rays >= 3)) <= 0.01 * block.mismatch.sum()
    error = np.linalg.norm(world(structure, block).points(structure.point) - block.tie_point_position_world_m, axis=1)
    assert np.nanmedian(error) < 3.0 * PLAN.gsd_m
    assert np.isfinite(error).mean() > 0.95
    assert structure.residual_px(good).max() < SETTINGS.threshold_px


def test_without_mismatches_nearly_nothing_is_set_aside() -> None:
    block = simulated(PLAN, mismatches=0.0)
    structure = assert_whole_and_true(grown(block), block, 8.0)
    assert structure.good.mean() > 0.995
    np.testing.assert_array_equal(structure.parameters[0], block.block.cameras[0].parameters)


@pytest.mark.parametrize("seed", [1, 2])
def test_level_ground(seed: int) -> None:
    block = simulated(replace(PLAN, relief_m=0.0), seed)
    assert_whole_and_true(grown(block), block, 8.0)


def test_nadir_and_oblique_photographs() -> None:
    block = simulated(replace(PLAN, strips=3, photographs_per_strip=5, oblique_strip=True, oblique_angle_deg=35.0))
    assert_whole_and_true(grown(block), block, 8.0)


def test_a_strip() -> None:
    block = simulated(replace(PLAN, strips=1, photographs_per_strip=10), tie_points=700)
    # a strip bends
    assert_whole_and_true(grown(block), block, 20.0)


@pytest.mark.parametrize("count", [2, 3])
def test_two_and_three_photographs(count: int) -> None:
    block = simulated(replace(PLAN, strips=1, photographs_per_strip=count), tie_points=300)
    assert_whole_and_true(grown(block), block, 10.0)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_camera_of_which_little_is_known_is_calibrated_on_the_way(seed: int) -> None:
    """A focal length from EXIF and no distortion: 30 px of it in the corners."""
    block = simulated(replace(whole_survey_plan(800), control_points=0, check_points=0), seed)
    structure = grown(block)[0]
    assert structure.registered.all()
    given, found, truth = block.block.cameras[0].parameters, structure.parameters[0], block.truth.camera.parameters
    assert given[3] == 0.0
    assert found[3] == pytest.approx(truth[3], abs=0.02)
    assert found[0] == pytest.approx(truth[0], rel=0.03)
    assert structure.good[~block.mismatch].mean() > 0.95
    # what of focal length and height cannot be separated is no error of the centres among each other
    alone = fit_similarity(structure.position, true_centres(block))
    error = np.linalg.norm(alone.points(structure.position) - true_centres(block), axis=1)
    assert error.max() < 12.0 * block.plan.gsd_m


def test_photographs_of_two_cameras() -> None:
    """Every other photograph at double size, under a camera of its own."""
    plain = simulated(SMALL)
    camera, tie = plain.block.cameras[0], plain.block.tie_points
    large = replace(
        camera, name="large", width_px=2 * camera.width_px, height_px=2 * camera.height_px,
        focal_px=2 * camera.focal_px, principal_point_px=2 * camera.principal_point_px,
    )  # fmt: skip
    photographs = tuple(replace(p, camera=i % 2) for i, p in enumerate(plain.block.photographs))
    pixel = tie.pixel * (1 + tie.photograph % 2)[:, None]
    block = replace(
        plain,
        block=replace(
            plain.block, cameras=(camera, large), photographs=photographs, tie_points=replace(tie, pixel=pixel)
        ),
    )
    assert_whole_and_true(grown(block), block, 10.0)
    wrong = replace(block, block=replace(block.block, photographs=plain.block.photographs))
    found = grown(wrong)
    assert not found or found[0].registered.sum() < 8 or found[0].good.mean() < 0.8


# ---- what does not hang together -------------------------------------------------------------------------------------


def joined(*blocks: SimulatedBlock) -> TiePoints:
    """The tie points of several blocks, their photographs numbered on."""
    ties = [block.block.tie_points for block in blocks]
    photographs = np.cumsum([0, *(len(block.block.photographs) for block in blocks)])
    points = np.cumsum([0, *(len(tie) for tie in ties)])
    return TiePoints(
        np.concatenate([tie.photograph + n for tie, n in zip(ties, photographs, strict=False)]),
        np.concatenate([tie.point + n for tie, n in zip(ties, points, strict=False)]),
        *(np.concatenate([getattr(tie, name) for tie in ties]) for name in ("feature", "pixel", "sigma_px")),
        *(np.concatenate([getattr(tie, name) for tie in ties]) for name in ("position_world_m", "colour")),
    )


def test_two_sites_are_two_components_the_larger_first() -> None:
    small, large = simulated(SMALL), simulated(replace(SMALL, strips=3), 2)
    components = grow(joined(small, large), small.block.cameras, np.zeros(20, np.int64), SETTINGS)
    assert [int(s.registered.sum()) for s in components] == [12, 8]
    np.testing.assert_array_equal(np.flatnonzero(components[0].registered), np.arange(8, 20))
    np.testing.assert_array_equal(np.flatnonzero(components[1].registered), np.arange(8))
    for structure, block, first in ((components[0], large, 8), (components[1], small, 0)):
        mine = slice(first, first + len(block.block.photographs))
        fit = fit_similarity(structure.position[mine], true_centres(block))
        error = np.linalg.norm(fit.points(structure.position[mine]) - true_centres(block), axis=1)
        assert error.max() < 8.0 * PLAN.gsd_m


def test_photographs_without_tie_points_stay_out() -> None:
    block = simulated(SMALL)
    tie = block.block.tie_points
    bare = tie.select(np.ones(len(tie), dtype=bool), ~np.isin(tie.photograph, [0, 5]))
    components = grown(block, bare)
    assert len(components) == 1
    np.testing.assert_array_equal(np.flatnonzero(~components[0].registered), [0, 5])
    assert components[0].poses()[0] is None


@pytest.mark.parametrize("seed", [1, 2])
def test_photographs_of_another_site_stay_out(seed: int) -> None:
    """Their matches are there, but at wrong places."""
    block = simulated(PLAN, seed)
    tie, foreign = block.block.tie_points, [3, 11, 20]
    pixel = tie.pixel.copy()
    for i in foreign:
        mine = np.flatnonzero(tie.photograph == i)
        pixel[mine] = np.random.default_rng(i).permutation(pixel[mine])
    components = grown(block, replace(tie, pixel=pixel))
    assert len(components) == 1
    np.testing.assert_array_equal(np.flatnonzero(~components[0].registered), foreign)
    kept = ~np.isin(np.arange(24), foreign)
    fit = fit_similarity(components[0].position[kept], true_centres(block)[kept])
    error = np.linalg.norm(fit.points(components[0].position[kept]) - true_centres(block)[kept], axis=1)
    assert error.max() < 10.0 * PLAN.gsd_m
    assert not components[0].good[np.isin(tie.photograph, foreign)].any()


def test_nothing_grows_from_nothing() -> None:
    block = simulated(SMALL)
    tie = block.block.tie_points
    none = tie.select(np.zeros(len(tie), dtype=bool))
    assert grown(block, none) == []
    shuffled = replace(tie, pixel=np.random.default_rng(0).permutation(tie.pixel))
    assert grown(block, shuffled) == []
    few = np.zeros(len(tie), dtype=bool)
    few[:15] = True
    assert grown(block, tie.select(few)) == []


def test_only_candidates_are_oriented() -> None:
    block = simulated(SMALL)
    candidates = np.arange(8) >= 3
    components = grow(
        block.block.tie_points, block.block.cameras, np.zeros(8, np.int64), SETTINGS, candidates=candidates
    )
    np.testing.assert_array_equal(components[0].registered, candidates)
    assert candidates.sum() == 5, "the mask of the caller is its own"


# ---- seeds -----------------------------------------------------------------------------------------------------------


def hovered(seed: int) -> tuple[Camera, list[Pose], TiePoints, np.ndarray]:
    """Four places, three photographs from each, turned but not moved; their tie points, and the true points."""
    rng = np.random.default_rng([seed, 11])
    camera = simulated(SMALL).block.cameras[0]
    poses = [
        Pose(rotation_from_gimbal(*rng.normal([0, -90, 0], 4)), np.array([14.0 * (i // 3), 0.0, 80.0]))
        for i in range(12)
    ]
    points = rng.uniform(-1, 1, (700, 3)) * [60.0, 25.0, 4.0] + [21.0, 0.0, 0.0]
    pixel = np.array([project_points(camera, pose, points) for pose in poses])
    seen = camera.contains(pixel.reshape(-1, 2)).reshape(12, -1)
    number = np.cumsum(seen.sum(axis=0) >= 2) - 1
    kept = seen.sum(axis=0) >= 2
    point, photograph = np.nonzero((seen & kept).T)
    measured = pixel[photograph, point] + rng.normal(0, 0.5, (len(point), 2))
    tie = TiePoints(
        photograph, number[point], np.arange(len(point)), measured,
        np.full(len(point), 0.5), np.full((int(kept.sum()), 3), np.nan), np.zeros((int(kept.sum()), 3), np.uint8),
    )  # fmt: skip
    return camera, poses, tie, points[kept]


@pytest.mark.parametrize("seed", [0, 1])
def test_no_block_starts_from_two_photographs_of_one_place(seed: int) -> None:
    camera, poses, tie, truth = hovered(seed)
    structure = Structure.empty(tie, (camera,), np.zeros(12, np.int64), SETTINGS)
    shared = shared_points(tie, 12)
    most = shared.tocoo()
    best = int(np.argmax(most.data))
    assert most.row[best] // 3 == most.col[best] // 3, "those of one place share most"
    pair = seed_pairs(structure, shared, np.ones(12, dtype=bool))[0]
    assert pair.first // 3 != pair.second // 3
    components = grow(tie, (camera,), np.zeros(12, np.int64), SETTINGS)
    assert components[0].registered.all()
    known = components[0].known
    fit = fit_similarity(
        np.vstack([components[0].position, components[0].point[known]]),
        np.vstack([[pose.position_world_m for pose in poses], truth[known]]),
    )
    error = np.linalg.norm(fit.points(components[0].position) - [pose.position_world_m for pose in poses], axis=1)
    assert error.max() < 15.0 * PLAN.gsd_m


def test_shared_points_are_counted_once_per_pair() -> None:
    block = simulated(SMALL)
    tie = block.block.tie_points
    shared = shared_points(tie, 8).toarray()
    a, b = tie.point[tie.photograph == 1], tie.point[tie.photograph == 6]
    assert shared[1, 6] == len(np.intersect1d(a, b))
    assert not np.tril(shared).any()


# ---- running ---------------------------------------------------------------------------------------------------------


def test_the_same_block_grows_the_same_bit_for_bit() -> None:
    block = simulated(PLAN, 2)
    one, other = grown(block)[0], grown(block)[0]
    for name in ("rotation", "position", "registered", "parameters", "point", "good"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_progress_counts_up_to_the_block() -> None:
    block = simulated(SMALL)
    said: list[tuple[int, int]] = []
    grow(
        block.block.tie_points, block.block.cameras, np.zeros(8, np.int64), SETTINGS,
        lambda done, total, _: said.append((done, total)),
    )  # fmt: skip
    done = [d for d, _ in said]
    assert done == sorted(done)
    assert said[-1] == (8, 8)
    assert all(total == 8 for _, total in said)
