"""Blocks of a few metres whose positions scatter by metres: upright, and as wrong as they are said to be."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated
from scipy.spatial.transform import Rotation
from seeds import seeds

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.camera import Similarity
from photogram.constraints.between_points import Distance
from photogram.measures.rough_place import rough_place
from photogram.results import Adjustment
from photogram.sfm.georeference import georeference
from photogram.sfm.orientation import OrientationSettings
from photogram.sfm.reconstruction import Structure
from photogram.sfm.similarity import fit_similarity
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

OFFSET_M = np.array([2.0, 2.0, 3.0])


def plan_of(width_m: float, noise_m: float) -> SurveyPlan:
    height_m = 1.33 * width_m
    return SurveyPlan(
        strips=4, photographs_per_strip=5, flying_height_m=height_m, position_noise_m=0.04 * height_m,
        relief_m=0.15 * height_m, control_points=0, check_points=0, buildings=0, trees=0, cell_m=height_m / 200,
        attitude_noise_deg=4.0, gnss_offset_sigma_m=(0.0, 0.0, 0.0), gnss_sigma_m=(noise_m,) * 3,
    )  # fmt: skip


def small_survey(width_m: float, noise_m: float, seed: int) -> tuple[Block, FloatArray, Structure]:
    """A block without attitudes or ground points, its true projection centres, and its structure in another frame."""
    made = simulated(plan_of(width_m, noise_m), tie_points=150, seed=seed)
    photographs = tuple(
        replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None, velocity_world_m_s=None, time=None)
        for p in made.block.photographs
    )
    block = replace(made.block, photographs=photographs)
    own = Similarity(0.3, Rotation.random(random_state=seed).as_matrix(), np.array([1.0, -4.0, 2.0]))
    structure = Structure.oriented(
        block.tie_points, (made.truth.camera,), block.camera_of, OrientationSettings(),
        [own.pose(pose) for pose in made.truth.poses],
    )  # fmt: skip
    return block, np.array([pose.position_world_m for pose in made.truth.poses]), structure


def adjusted(block: Block, structure: Structure) -> Adjustment:
    fit = georeference(structure, block)
    tie_points = replace(block.tie_points, position_world_m=fit.points(structure.point))
    poses = tuple(None if pose is None else fit.pose(pose) for pose in structure.poses())
    return adjust(replace(block, poses=poses, tie_points=tie_points), AdjustmentSettings())


def of_unknown_sigmas(block: Block, seed: int) -> Block:
    """The same with the sigmas that `photogram init` assumes, and an offset of the flight."""
    offset = OFFSET_M * np.random.default_rng([seed, 9]).standard_normal(3)
    photographs = tuple(
        replace(
            p,
            gnss_world_m=None if p.gnss_world_m is None else p.gnss_world_m + offset,
            gnss_sigma_m=np.array([2.0, 2.0, 3.0]),
            gnss_sigma_assumed=True,
        )
        for p in block.photographs
    )
    return replace(block, photographs=photographs, gnss_offset_sigma_m=OFFSET_M)


@pytest.mark.parametrize(("width_m", "noise_m", "assumed"), [(2.0, 5.0, False), (5.0, 5.0, True), (10.0, 2.0, False)])
@pytest.mark.parametrize("measured", [False, True])
def test_errors_are_what_is_said_where_positions_scatter_by_more_than_the_block_is_wide(
    width_m: float, noise_m: float, assumed: bool, measured: bool
) -> None:
    squares, shape = [], []
    for seed in seeds(20):
        block, truth, structure = small_survey(width_m, noise_m, seed)
        if assumed:
            block = of_unknown_sigmas(block, seed)
        if measured:
            length_m = float(np.linalg.norm(truth[0] - truth[-1]))
            ends = block.photographs[0].name, block.photographs[-1].name
            distance = Distance(ends=ends, length_m=length_m, sigma_m=0.001 * length_m, of_photographs=True)
            block = replace(block, constraints=(distance,))
        result = adjusted(block, structure)
        found = np.array([p.position_world_m for p in result.block.poses if p is not None])
        error = found - truth
        normal = np.linalg.inv(result.covariances.position_m2)
        squares.append(float(np.mean(np.einsum("ni,nij,nj->n", error, normal, error)) / 3.0))
        fit = fit_similarity(truth, found)
        shape.append(float(np.sqrt(np.mean((fit.points(truth) - found) ** 2)) / fit.scale))
        assert fit.rotation[2, 2] > np.cos(np.deg2rad(25.0))  # upright, whatever the positions say
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.35
    assert np.mean(shape) < 0.005 * width_m  # as of the rays alone


def test_an_open_heading_is_off_by_its_sigma() -> None:
    """An adjusted one: the positions turn the block by what they scatter by, and their sigma is that of its size."""
    squares = []
    for seed in seeds(20, few=20):
        block, truth, structure = small_survey(2.0, 5.0, seed)
        result = adjusted(block, structure)
        rough = rough_place(result.block)
        assert rough is not None
        if not rough.open_heading:
            continue
        found = fit_similarity(truth, np.array([p.position_world_m for p in result.block.poses if p is not None]))
        off_rad = np.arctan2(found.rotation[1, 0] - found.rotation[0, 1], found.rotation[0, 0] + found.rotation[1, 1])
        turn = rough.rotation @ result.covariances.rotation_rad2[rough.photograph] @ rough.rotation.T
        squares.append(float(off_rad**2 / turn[2, 2]))
    assert len(squares) > 10
    assert 0.6 < np.sqrt(np.mean(squares)) < 1.6


def test_what_is_not_determined_is_said_and_what_is_known_with_its_sigma() -> None:
    block, _, structure = small_survey(2.0, 5.0, 1)
    lost = next(w for w in adjusted(block, structure).warnings if w.startswith("The block is placed roughly"))
    assert "its GNSS positions being known to 5 m while the photographs stand within" in lost
    assert "its scale" in lost
    assert "not determined; its shape is known better" in lost
    block, _, structure = small_survey(10.0, 5.0, 0)
    known = next(w for w in adjusted(block, structure).warnings if w.startswith("The block is placed roughly"))
    assert "not determined" not in known
    assert "heading to " in known
    assert "scale to " in known


def test_good_positions_control_points_or_attitudes_place_a_block_as_before() -> None:
    block, _, structure = small_survey(10.0, 0.05, 0)
    fit = georeference(structure, block)
    oriented = replace(block, poses=tuple(None if p is None else fit.pose(p) for p in structure.poses()))
    assert rough_place(oriented) is None
    noisy = replace(oriented, photographs=tuple(replace(p, gnss_sigma_m=np.full(3, 9.0)) for p in oriented.photographs))
    rough = rough_place(noisy)
    assert rough is not None
    assert rough.sigma_m == pytest.approx(9.0)
    levelled = tuple(
        replace(p, attitude_world_from_camera=np.eye(3), attitude_sigma_rad=0.02) for p in noisy.photographs
    )
    assert rough_place(replace(noisy, photographs=levelled)) is None


@pytest.mark.parametrize("width_m", [2.0, 5.0])
def test_no_block_with_attitudes_shrinks_to_a_point(width_m: float) -> None:
    squares = []
    for seed in seeds(20, few=20):
        block, truth, structure = small_survey(width_m, 5.0, seed)
        made = simulated(plan_of(width_m, 5.0), tie_points=150, seed=seed).block.photographs
        levelled = tuple(
            replace(p, attitude_world_from_camera=m.attitude_world_from_camera, attitude_sigma_rad=m.attitude_sigma_rad)
            for p, m in zip(block.photographs, made, strict=True)
        )
        result = adjusted(replace(block, photographs=levelled), structure)
        found = np.array([p.position_world_m for p in result.block.poses if p is not None])
        assert fit_similarity(truth, found).scale > 0.3
        normal = np.linalg.inv(result.covariances.position_m2)
        squares.append(float(np.mean(np.einsum("ni,nij,nj->n", found - truth, normal, found - truth)) / 3.0))
    assert 0.7 < np.sqrt(np.mean(squares)) < 1.35
