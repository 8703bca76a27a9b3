"""Standard deviations of an orthophoto in plan: what errors of heights and of the block do to it."""

import numpy as np
import pytest

from photogram.grid import MapGrid, Window
from photogram.surface.dsm import SharedError, shared_plan_variance
from photogram.surface.ortho.plan_sigma import RaysAt, plan_sigma_m

GRID = MapGrid(500.0, 900.0, 0.5, 30, 40)
WINDOW = Window(4, 6, 12, 20)
WIDE = MapGrid(490.0, 910.0, 5.0, 8, 9)


def shared(east_m2: float, north_m2: float) -> SharedError:
    covariance = np.zeros((WIDE.rows, WIDE.columns, 6))
    covariance[..., 0], covariance[..., 1], covariance[..., 2] = east_m2, north_m2, 1.0
    return SharedError(WIDE, covariance)


def test_sigma_is_that_of_simulated_errors() -> None:
    """What is shown moves by the block's shift, and along the ray by the height's own error."""
    rng = np.random.default_rng(4)
    t = np.array([0.4, -0.3])
    shift = rng.normal(0.0, [0.02, 0.03], (200_000, 2))
    off = shift + t * rng.normal(0.0, 0.1, (200_000, 1))
    sideways = np.broadcast_to(t[:, None, None], (2, *WINDOW.shape)).astype(np.float32)
    rays = RaysAt(WINDOW, sideways, np.ones(WINDOW.shape, np.uint8))
    found = plan_sigma_m(rays, np.full(WINDOW.shape, 0.1, np.float32), shared(0.02**2, 0.03**2), GRID)
    assert found == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.01)


def test_nothing_shown_has_no_sigma() -> None:
    sideways = np.zeros((2, *WINDOW.shape), np.float32)
    sideways[:, 0] = np.nan
    rays = RaysAt(WINDOW, sideways, np.ones(WINDOW.shape, np.uint8))
    found = plan_sigma_m(rays, np.ones(WINDOW.shape, np.float32), shared(0.04, 0.0), GRID)
    assert np.isnan(found[0]).all()
    assert found[1:] == pytest.approx(np.sqrt(0.02))


def test_what_is_shared_is_linear_between_nodes() -> None:
    covariance = np.zeros((WIDE.rows, WIDE.columns, 6))
    covariance[..., 0] = np.arange(WIDE.columns)
    east, _ = GRID.centres_map_m(WINDOW)
    expected = (east - WIDE.west_map_m) / WIDE.cell_m - 0.5
    found = shared_plan_variance(SharedError(WIDE, covariance), GRID, WINDOW)
    np.testing.assert_allclose(found, np.broadcast_to(expected, WINDOW.shape))
