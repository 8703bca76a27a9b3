"""Co-registration of simulated clouds on stable ground, with a motion and with none."""

import numpy as np
import pytest
import shapely
from lib.simulated_changes import CORNER, Errors, epoch, grid_at

from photogram.change.cloud_registration import NAMES, PARAMETERS, register_clouds
from photogram.errors import PhotogramError
from photogram.survey import PointCloud
from photogram.volumes.stable_ground import Motion

OWN = Errors(own_m=(0.02, 0.02), shift_m=(0.0, 0.0, 0.0), tilt_m=0.0, dome_m=0.0)
STABLE = [shapely.box(CORNER[0] - 10, CORNER[1] - 10, CORNER[0] + 10, CORNER[1] + 10)]


def hilly(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(40.0 + 0.1 * x + 1.5 * np.sin(x / 4.0) * np.cos(y / 5.0))


def even(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(40.0 + 0.0 * x * y)


def cloud(rng: np.random.Generator, ground: object = hilly) -> np.ndarray:
    grid = grid_at(0.0, 0.0, 24.0, 0.125)
    survey = epoch(ground, grid, OWN, rng)  # type: ignore[arg-type]
    east, north = np.meshgrid(*grid.centres_map_m(grid.whole))
    height = survey.heights.read(grid.whole).astype(np.float64)
    return np.column_stack([east.ravel(), north.ravel(), height.ravel()])


def moved(points: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return points turned by small angles about their middle and shifted; to second order in the angles."""
    centre = points.mean(axis=0)
    off = points - centre
    turn = np.cross(motion[3:], off)
    return np.asarray(points + motion[:3] + turn + 0.5 * np.cross(motion[3:], turn))


@pytest.mark.parametrize("motion", ["offset", "tilt", "rigid"])
def test_a_motion_is_found_within_its_standard_deviations(motion: Motion) -> None:
    rng = np.random.default_rng(11)
    true = np.zeros(6)
    used = list(PARAMETERS[motion])
    true[used] = np.array([0.06, -0.04, 0.05, 1e-3, -2e-3, 1.5e-3])[used]
    z = []
    for _ in range(25):
        earlier, later = cloud(rng), moved(cloud(rng), true)
        found, back = register_clouds(PointCloud(earlier), PointCloud(later), STABLE, motion, 0.625)
        z.append((found.value - true[used]) / found.sigma)
        assert found.names == tuple(NAMES[k] for k in used)
        off = np.abs(np.mean(back.apply(later) - moved(later, -true), axis=0))
        assert off.max() < 0.02
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.8)
    assert np.all(np.std(z, axis=0) < 1.6)
    assert np.all(np.std(z, axis=0) > 0.55)


def test_clouds_that_lie_right_are_left_where_they_are() -> None:
    rng = np.random.default_rng(12)
    found, back = register_clouds(PointCloud(cloud(rng)), PointCloud(cloud(rng)), STABLE, "rigid", 0.625)
    assert np.all(np.abs(found.value) < 4.0 * found.sigma)
    sigma = back.sigma_m(
        np.array([[*CORNER, 40.0], [CORNER[0] + 60.0, CORNER[1], 40.0]]), np.tile([0.0, 0.0, 1.0], (2, 1))
    )
    assert 0.0 < sigma[0] < sigma[1]  # what is far from the stable ground turns about it


def test_even_ground_tells_no_shift_in_plan() -> None:
    rng = np.random.default_rng(13)
    earlier, later = PointCloud(cloud(rng, even)), PointCloud(cloud(rng, even))
    with pytest.raises(PhotogramError, match="too flat to determine a rigid transformation"):
        register_clouds(earlier, later, STABLE, "rigid", 0.625)
    assert register_clouds(earlier, later, STABLE, "tilt", 0.625)[0].sigma[0] < 0.005


def test_a_car_is_left_out() -> None:
    rng = np.random.default_rng(14)
    earlier, later = cloud(rng), cloud(rng)
    car = (np.abs(later[:, 0] - CORNER[0]) < 1.5) & (np.abs(later[:, 1] - CORNER[1]) < 2.5)
    later[car, 2] += 1.5
    found, _ = register_clouds(PointCloud(earlier), PointCloud(later), STABLE, "offset", 0.625)
    assert found.rejected > 20
    assert abs(found.value[0]) < 0.01


def test_ground_without_points_is_refused() -> None:
    points = PointCloud(cloud(np.random.default_rng(15)))
    far = [shapely.box(0.0, 0.0, 5.0, 5.0)]
    with pytest.raises(PhotogramError, match=r"stable ground: 0 cells of 0\.625 m have points"):
        register_clouds(points, points, far, "offset", 0.625)
