"""Which way is up: as photographs show it, and as well as positions tell it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.measures.vertical import Vertical, structure_up, turn_sigmas_rad, vertical_by_view, vertical_near
from photogram.sfm.similarity import fit_similarity

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


@pytest.mark.parametrize(("pitch_deg", "tilted"), [(-90.0, 0.3), (0.0, -0.3)])
def test_the_nearer_way_is_taken_where_photographs_prove_none(pitch_deg: float, tilted: float) -> None:
    strip = photographs(np.full(8, 40.0), pitch_deg)
    by_positions = ANYHOW @ Rotation.from_rotvec([tilted, 0.0, 0.0]).as_matrix() @ UP
    for up in (vertical_near(strip, by_positions), structure_up(strip, "auto", by_positions)):
        assert angle_deg(up, ANYHOW @ UP) < 3.0


def test_turns_are_as_large_as_fits_to_noisy_positions_scatter() -> None:
    rng = np.random.default_rng(4)
    position = rng.uniform(-1.0, 1.0, (20, 3)) * [10.0, 4.0, 0.0]
    sigma_m = np.array([0.05, 0.05, 0.1])
    turns = np.array([
        Rotation.from_matrix(
            fit_similarity(position, position + sigma_m * rng.standard_normal(position.shape)).rotation
        ).as_rotvec()
        for _ in range(400)
    ])  # fmt: skip
    tilt, heading = turn_sigmas_rad(position, np.tile(sigma_m, (20, 1)))
    assert np.sqrt(np.linalg.eigvalsh(np.cov(turns[:, :2].T))[-1]) == pytest.approx(tilt, rel=0.1)
    assert np.std(turns[:, 2]) == pytest.approx(heading, rel=0.1)
    assert turn_sigmas_rad(np.zeros((3, 3)), np.ones((3, 3)))[0] > 1e6
