"""The frame of a block that nothing places: which way is up, and the scale by distances."""

from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.close_range import CloseRange, simulate_close_range
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.constraints.between_points import Distance
from photogram.errors import OrientationError
from photogram.sfm.local_frame import local_similarity
from photogram.survey import Block

UP = np.array([0.0, 0.0, 1.0])
ANYHOW = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()


def placed(survey: CloseRange, block: Block, known: int = 8) -> FloatArray:
    """The marked points in the local frame of a structure that is the truth in another unit, turned and shifted."""
    registered = np.arange(len(survey.centre_m)) < known

    def elsewhere(points: FloatArray) -> FloatArray:
        return np.asarray(0.3 * points @ ANYHOW.T + 5.0)

    fit = local_similarity(
        block, ANYHOW @ survey.rotation, elsewhere(survey.centre_m), registered, elsewhere(survey.point_m),
        elsewhere(survey.marked_m), "level",
    )  # fmt: skip
    centres = fit.points(elsewhere(survey.centre_m))[registered]
    np.testing.assert_allclose(np.median(fit.points(elsewhere(survey.point_m)), axis=0), 0.0, atol=0.6)
    if not block.constraints:
        apart = np.linalg.norm(centres[:, None] - centres, axis=2) + 1e9 * np.eye(len(centres))
        assert apart.min(axis=1).mean() == pytest.approx(1.0)
    return np.asarray(fit.points(elsewhere(survey.marked_m)))


def test_the_scale_is_that_of_the_distances_or_one_by_the_spacing_of_photographs() -> None:
    survey = simulate_close_range(1)
    true_m = np.linalg.norm(survey.marked_m[1:] - survey.marked_m[0], axis=1)
    placed(survey, survey.block)
    placed(survey, survey.block, known=5)
    bars = (Distance(ends=("A", "B"), length_m=float(true_m[0]), sigma_m=0.001),)
    base_m = float(np.linalg.norm(survey.centre_m[1] - survey.centre_m[0]))
    rig = (Distance(ends=("photograph1", "photograph2"), of_photographs=True, length_m=base_m, sigma_m=0.001),)
    for distances in (bars, rig):
        marked = placed(survey, replace(survey.block, constraints=distances))
        np.testing.assert_allclose(np.linalg.norm(marked[1:] - marked[0], axis=1), true_m, rtol=1e-9)


def test_distances_that_the_photographs_do_not_show_are_an_error() -> None:
    survey = simulate_close_range(1)
    missing = Distance(ends=("photograph7", "photograph8"), of_photographs=True, length_m=1.0, sigma_m=0.001)
    lost = replace(survey.block, constraints=(missing,))
    with pytest.raises(OrientationError, match="the scale is not known"):
        placed(survey, lost, known=5)


def test_measured_attitudes_give_vertical_and_north() -> None:
    survey = simulate_close_range(1)
    level = tuple(
        replace(p, attitude_world_from_camera=R, attitude_sigma_rad=0.03)
        for p, R in zip(survey.block.photographs, survey.rotation, strict=True)
    )
    block = replace(survey.block, photographs=level)
    fit = local_similarity(
        block, ANYHOW @ survey.rotation, survey.centre_m @ ANYHOW.T, np.ones(8, dtype=bool),
        survey.point_m @ ANYHOW.T, survey.marked_m @ ANYHOW.T,
    )  # fmt: skip
    np.testing.assert_allclose(fit.rotation @ ANYHOW, np.eye(3), atol=1e-9)
