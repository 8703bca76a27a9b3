"""The frame of a block that nothing places: which way is up, and the scale by distances."""

from dataclasses import replace

import numpy as np
import pytest
from lib.simulated.close_range import CloseRange, simulate_close_range
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.constraints.between_points import Distance
from photogram.errors import OrientationError
from photogram.sfm.local_frame import Vertical, local_similarity, vertical_by_view
from photogram.survey import Block

UP = np.array([0.0, 0.0, 1.0])
ANYHOW = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()


def photographs(yaw_deg: FloatArray, pitch_deg: float) -> FloatArray:
    """Rotations (N, 3, 3) of a gimbal, up to two degrees off, in a frame turned anyhow."""
    off = 2.0 * np.random.default_rng(1).standard_normal((len(yaw_deg), 3))
    each = [
        rotation_from_gimbal(yaw + a, pitch_deg + b, c) for yaw, (a, b, c) in zip(yaw_deg.tolist(), off, strict=True)
    ]
    return np.asarray(ANYHOW @ np.array(each))


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.rad2deg(np.arccos(np.clip(a @ b, -1.0, 1.0))))


@pytest.mark.parametrize(
    ("yaw_deg", "pitch_deg", "wanted", "by", "sure"),
    [
        (np.repeat([10.0, 190.0], 8), -90.0, "auto", "down", True),  # a flight to and fro
        (np.repeat([10.0, 190.0], 8), -75.0, "auto", "down", True),
        (np.linspace(-70.0, 70.0, 8), 0.0, "auto", "level", True),  # around an object
        (np.linspace(0.0, 315.0, 8), -30.0, "auto", "level", True),  # all around it, from above
        (np.full(8, 40.0), 0.0, "auto", "level", False),  # a facade
        (np.full(8, 40.0), 0.0, "level", "level", True),
        (np.full(8, 40.0), -90.0, "down", "down", True),  # one strip
    ],
)
def test_up_is_where_photographs_show_it(
    yaw_deg: FloatArray, pitch_deg: float, wanted: Vertical, by: str, sure: bool
) -> None:
    found = vertical_by_view(photographs(yaw_deg, pitch_deg), wanted)
    assert (found.by, found.sure) == (by, sure)
    # the mean of oblique optical axes of opposite strips is vertical as well
    assert angle_deg(found.up_world, ANYHOW @ UP) < 3.0


def test_one_strip_of_vertical_photographs_passes_for_a_facade_and_says_so() -> None:
    found = vertical_by_view(photographs(np.full(8, 40.0), -90.0))
    assert (found.by, found.sure) == ("level", False)


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
