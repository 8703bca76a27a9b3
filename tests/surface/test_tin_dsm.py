"""The surface model: exact planes, no extrapolation, spikes and holes, on map coordinates of 6 000 000 m."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError, SettingError
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.surface.tin_dsm import (
    PointPrecision,
    ShapePrecision,
    SurfaceSettings,
    TinSurface,
    spikes,
    surface_from_points,
    surface_with_sigma,
)
from photogram.survey import PointCloud, Raster

EASTING, NORTHING = 719_900.0, 6_191_900.0


def cloud_of(x: FloatArray, y: FloatArray, z: FloatArray) -> PointCloud:
    return PointCloud(np.column_stack([EASTING + x, NORTHING + y, z]))


def scattered(count: int, width_m: float, depth_m: float, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    return random.uniform(0, width_m, count), random.uniform(0, depth_m, count)


def centres(raster: Raster) -> tuple[FloatArray, FloatArray]:
    """Coordinates (rows, columns) of the cell centres, relative to the test site's corner."""
    rows, columns = raster.values.shape
    x = raster.west_map_m - EASTING + (np.arange(columns) + 0.5) * raster.cell_m
    y = raster.north_map_m - NORTHING - (np.arange(rows) + 0.5) * raster.cell_m
    grid = np.meshgrid(x, y)
    return grid[0], grid[1]


def test_a_plane_is_reproduced_exactly_over_unequal_extents() -> None:
    x, y = scattered(3000, 70.0, 20.0)
    raster = surface_from_points(cloud_of(x, y, 80 + 0.3 * x - 0.7 * y), SurfaceSettings(cell_m=0.5))
    assert raster.values.shape == (40, 140)
    assert (raster.west_map_m, raster.north_map_m, raster.cell_m) == (EASTING, NORTHING + 20.0, 0.5)
    xc, yc = centres(raster)
    known = np.isfinite(raster.values)
    assert known.mean() > 0.95
    # float32 resolves 8 µm at 80 m
    np.testing.assert_allclose(raster.values[known], (80 + 0.3 * xc - 0.7 * yc)[known], rtol=0, atol=2e-5)


@pytest.mark.parametrize("tile_cells", [1, 333, 10_000_000])
def test_tiles_do_not_show(monkeypatch: pytest.MonkeyPatch, tile_cells: int) -> None:
    x, y = scattered(2000, 30.0, 17.0)
    cloud = cloud_of(x, y, np.sin(x / 3) + np.cos(y / 2))
    expected = surface_from_points(cloud, SurfaceSettings(cell_m=0.3)).values
    monkeypatch.setattr("photogram.surface.tin_dsm.TILE_CELLS", tile_cells)
    np.testing.assert_array_equal(surface_from_points(cloud, SurfaceSettings(cell_m=0.3)).values, expected)


def test_agrees_with_scipys_interpolator_and_leaves_the_outside_of_the_hull_empty() -> None:
    random = np.random.default_rng(3)
    angle, radius = random.uniform(0, 2 * np.pi, 1500), 12 * np.sqrt(random.uniform(0, 1, 1500))
    x, y = 15 + radius * np.cos(angle), 20 + radius * np.sin(angle)
    z = 70 + np.sin(x / 2) * np.cos(y / 3)
    raster = surface_from_points(cloud_of(x, y, z), SurfaceSettings(cell_m=0.4, maximum_gap_m=1e5, spike_nmad=0))
    xc, yc = centres(raster)
    referee = LinearNDInterpolator(Delaunay(np.column_stack([x, y])), z)(xc, yc)
    outside = np.isnan(referee)
    assert 0.1 < outside.mean() < 0.4
    np.testing.assert_array_equal(np.isnan(raster.values), outside)
    np.testing.assert_allclose(raster.values[~outside], referee[~outside], rtol=0, atol=2e-5)


def test_a_spike_vanishes_and_its_surroundings_stay() -> None:
    x, y = scattered(4000, 40.0, 25.0)
    random = np.random.default_rng(5)
    smooth = 60 + 0.2 * x + 0.5 * np.sin(y / 4)
    z = smooth + random.normal(0, 0.02, len(x))
    victims = random.choice(len(x), 40, replace=False)
    z[victims] += random.choice([-1.0, 1.0], 40) * random.uniform(0.5, 300, 40)
    removed = spikes(np.column_stack([x, y, z]), SurfaceSettings())
    assert removed[victims].all()
    assert removed.sum() - 40 <= 8
    raster = surface_from_points(cloud_of(x, y, z), SurfaceSettings(cell_m=0.5))
    xc, yc = centres(raster)
    assert np.nanmax(np.abs(raster.values - (60 + 0.2 * xc + 0.5 * np.sin(yc / 4)))) < 0.12
    kept = surface_from_points(cloud_of(x, y, z), SurfaceSettings(cell_m=0.5, spike_nmad=0))
    assert np.nanmax(np.abs(kept.values - 65)) > 50


def test_spikes_that_stand_together_do_not_shield_each_other() -> None:
    x, y = scattered(4000, 40.0, 25.0, seed=6)
    random = np.random.default_rng(6)
    z = 60 + 0.2 * x + random.normal(0, 0.02, len(x))
    centre = random.uniform([2, 2], [38, 23], (12, 2))
    order = np.argsort(np.hypot(x[:, None] - centre[:, 0], y[:, None] - centre[:, 1]), axis=0)
    together = np.unique(order[:3])
    z[together] += 4.0
    removed = spikes(np.column_stack([x, y, z]), SurfaceSettings())
    assert removed[together].all()
    assert removed.sum() - len(together) <= 8


def test_a_vertical_wall_is_no_spike() -> None:
    x, y = scattered(5000, 40.0, 25.0, seed=8)
    roof = (np.abs(x - 20) < 8) & (np.abs(y - 12) < 6)
    noise = np.random.default_rng(8).normal(0, 0.02, len(x))
    removed = spikes(np.column_stack([x, y, 70 + 6.0 * roof + noise]), SurfaceSettings())
    assert removed.mean() < 0.02
    assert removed[roof].mean() < 0.06


def test_a_hole_stays_a_hole() -> None:
    x, y = scattered(8000, 40.0, 30.0, seed=2)
    water = np.hypot(x - 18, y - 14) < 6
    raster = surface_from_points(cloud_of(x[~water], y[~water], 50 + 0.1 * x[~water]), SurfaceSettings(cell_m=0.5))
    xc, yc = centres(raster)
    distance = np.hypot(xc - 18, yc - 14)
    # triangles along the shore reach in by less than the gap of ten median edges
    assert np.isnan(raster.values[distance < 3]).all()
    assert np.isfinite(raster.values[(distance > 7) & (np.abs(xc - 20) < 18) & (np.abs(yc - 15) < 13)]).all()
    bridged = surface_from_points(
        cloud_of(x[~water], y[~water], 50 + 0.1 * x[~water]), SurfaceSettings(cell_m=0.5, maximum_gap_m=13)
    )
    assert np.isfinite(bridged.values[distance < 3]).all()


def test_a_bilinear_surface_to_its_known_interpolation_error() -> None:
    spacing_m, twist = 2.0, 0.01
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 41, spacing_m), np.arange(0, 31, spacing_m)))
    raster = surface_from_points(cloud_of(x, y, 10 + twist * x * y), SurfaceSettings(cell_m=0.25))
    xc, yc = centres(raster)
    error = np.abs(raster.values - (10 + twist * xc * yc))
    # along the diagonal of a square of side h, linear interpolation of c x y is off by at most c h² / 4
    bound_m = twist * spacing_m**2 / 4
    assert error.max() <= bound_m + 1e-5
    assert error.max() > 0.8 * bound_m


def test_cell_and_gap_are_chosen_from_the_points() -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 60, 0.21), np.arange(0, 30, 0.21)))
    raster = surface_from_points(cloud_of(x, y, 0 * x + 33), SurfaceSettings())
    assert raster.cell_m == 0.2
    # one point thrown far out in plan must neither stretch the grid nor change the cell
    thrown = surface_from_points(cloud_of(np.append(x, 4e4), np.append(y, -9e4), np.append(0 * x + 33, 40)))
    assert thrown.cell_m == 0.2
    assert thrown.values.shape == raster.values.shape


@settings(max_examples=25, deadline=None)
@given(cell_m=st.sampled_from([0.05, 0.1, 0.3, 1.0, 2.5]), east=st.floats(-50, 50), north=st.floats(-50, 50))
def test_grid_corners_are_multiples_of_the_cell_and_cover_the_points(cell_m: float, east: float, north: float) -> None:
    x, y = scattered(200, 9.0, 4.0, seed=4)
    raster = surface_from_points(cloud_of(x + east, y + north, x), SurfaceSettings(cell_m=cell_m, maximum_gap_m=100))
    for corner in (raster.west_map_m, raster.north_map_m):
        assert abs(corner / cell_m - round(corner / cell_m)) < 1e-6
    rows, columns = raster.values.shape
    west_m = EASTING + east + x.min() - raster.west_map_m
    north_m = raster.north_map_m - (NORTHING + north + y.max())
    assert -1e-5 * cell_m <= west_m <= cell_m * (1 + 1e-5)
    assert -1e-5 * cell_m <= north_m <= cell_m * (1 + 1e-5)
    assert columns * cell_m >= np.ptp(x) - 1e-5
    assert rows * cell_m >= np.ptp(y) - 1e-5


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.zeros((2, 3)), {}, "2 of 2 points have finite coordinates"),
        (np.array([[0, 0, 0], [1, 0, 0], [0, 1, np.nan], [0, np.inf, 1]]), {}, "2 of 4 points have finite"),
        (np.array([[0.0, 0, 0], [1, 1, 0], [2, 2, 0], [3, 3, 5]]), {}, "collinear in plan"),
        (np.array([[0.0, 0, 0], [9, 0, 0], [0, 9, 0]]), {"maximum_gap_m": 1.0}, "larger gap"),
        (np.array([[0.0, 0, 0], [90, 0, 0], [0, 90, 0]]), {"cell_m": 1e-3}, "larger cell_m"),
        (np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]), {"cell_m": 50.0}, "smaller cell_m"),
    ],
)
def test_points_that_make_no_surface_are_told_apart(points: FloatArray, options: dict[str, Any], message: str) -> None:
    with pytest.raises(PhotogramError, match=message):
        surface_from_points(PointCloud(points + np.array([EASTING, NORTHING, 0])), SurfaceSettings(**options))


@pytest.mark.parametrize(
    "options",
    [{"cell_m": 0.0}, {"cell_m": float("nan")}, {"maximum_gap_m": -1.0}, {"spike_nmad": -1.0}, {"spike_neighbours": 3}],
)
def test_settings_that_cannot_be_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(SettingError, match=rf"^{next(iter(options))}: must be .*, found"):
        SurfaceSettings(**options)


# ---- standard deviations ---------------------------------------------------------------------------------------------


def precision_of(own_m: FloatArray, shared_m: FloatArray) -> PointPrecision:
    """Points whose coordinates are independent, with standard deviations (N, 3)."""
    return PointPrecision(np.einsum("ni,ij->nij", own_m**2, np.eye(3)), np.einsum("ni,ij->nij", shared_m**2, np.eye(3)))


def sigma_at(raster: Raster, x: float, y: float) -> float:
    column = int((EASTING + x - raster.west_map_m) / raster.cell_m)
    return float(raster.values[int((raster.north_map_m - NORTHING - y) / raster.cell_m), column])


def both(surface: TinSurface) -> tuple[Raster, Raster]:
    return surface.heights, surface.sigma


def one_triangle(own_m: list[float], shared_m: list[float], slope: float) -> tuple[Raster, Raster]:
    """A triangle with corners at (0.5, 0.5), (8.5, 0.5) and (0.5, 8.5): the centres of cells of 1 m."""
    x, y = np.array([0.5, 8.5, 0.5]), np.array([0.5, 0.5, 8.5])
    precision = precision_of(np.tile(own_m, (3, 1)), np.tile(shared_m, (3, 1)))
    cloud, settings = cloud_of(x, y, 40 + slope * x), SurfaceSettings(cell_m=1.0, spike_nmad=0)
    return both(surface_with_sigma(cloud, precision, settings))


def test_relative_standard_deviations_have_the_shape_in_place_of_the_cameras() -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0.5, 12.0), np.arange(0.5, 12.0)))
    cloud, settings = cloud_of(x, y, 40 + 0.2 * x), SurfaceSettings(cell_m=1.0, spike_nmad=0)
    own, datum = np.tile([0.01, 0.01, 0.02], (len(x), 1)), np.tile([3.0, 3.0, 10.0], (len(x), 1))
    shape_m = np.tile([0.01, 0.02, 0.04], (len(x), 1))
    of_shape = precision_of(own, shape_m)
    shape = ShapePrecision(cloud.position_map_m, of_shape.cameras_m2, np.diag([9.0, 9.0, 100.0]))
    surface = surface_with_sigma(cloud, precision_of(own, datum), settings, shape)
    alone = surface_with_sigma(cloud, of_shape, settings)
    assert surface.relative is not None
    assert alone.relative is None
    np.testing.assert_allclose(surface.relative.values, alone.sigma.values, rtol=1e-6)
    nothing_shared = surface_with_sigma(cloud, precision_of(own, np.zeros_like(own)), settings)
    np.testing.assert_allclose(surface.own.values, nothing_shared.sigma.values, rtol=1e-6)
    assert np.nanmin(surface.sigma.values) > 10.0


def test_the_shape_between_places_is_the_mean_of_the_nearest() -> None:
    place = np.array([[0.0, 0.0, 5.0], [10.0, 0.0, 5.0], [0.0, 10.0, 5.0], [10.0, 10.0, 5.0], [90.0, 90.0, 5.0]])
    covariance = np.arange(1.0, 6.0)[:, None, None] * np.eye(3)
    found = ShapePrecision(place, covariance, np.eye(3)).at(np.array([[5.0, 5.0], [6.0, 4.0]]))
    np.testing.assert_allclose(found, np.tile(2.5 * np.eye(3), (2, 1, 1)))


def test_standard_deviations_known_by_hand() -> None:
    heights, sigma = one_triangle([0.0, 0.0, 0.03], [0.0, 0.0, 0.0], 0.0)
    assert (heights.values.shape, heights.west_map_m, heights.north_map_m) == (
        sigma.values.shape, sigma.west_map_m, sigma.north_map_m,
    )  # fmt: skip
    np.testing.assert_array_equal(np.isnan(heights.values), np.isnan(sigma.values))
    assert sigma_at(sigma, 0.5, 0.5) == pytest.approx(0.03)  # the corner itself
    assert sigma_at(sigma, 4.5, 0.5) == pytest.approx(0.03 * np.sqrt(0.5))  # half way: two errors average out
    assert sigma_at(sigma, 2.5, 2.5) == pytest.approx(0.03 * np.sqrt(0.5**2 + 0.25**2 + 0.25**2))
    _, sigma = one_triangle([0.0, 0.0, 0.03], [0.0, 0.0, 0.04], 0.0)  # what is shared does not average out
    assert sigma_at(sigma, 0.5, 0.5) == pytest.approx(0.05)
    assert sigma_at(sigma, 4.5, 0.5) == pytest.approx(np.hypot(0.03 * np.sqrt(0.5), 0.04))
    _, sigma = one_triangle([0.02, 0.01, 0.0], [0.0, 0.0, 0.0], 0.5)  # on a slope, errors in plan raise the surface
    assert sigma_at(sigma, 8.5, 0.5) == pytest.approx(0.01)


@pytest.mark.parametrize("slope", [0.0, 0.6])
def test_errors_of_the_surface_follow_its_standard_deviations(slope: float) -> None:
    """Points of a known plane, each with its own errors and one that all share: at their corners and in between."""
    x, y = scattered(300, 40.0, 25.0, seed=4)
    random = np.random.default_rng(4)
    own_m = random.uniform(0.3, 1.0, (300, 3)) * [0.02, 0.02, 0.04]
    shared_m = np.tile([0.01, 0.01, 0.02], (300, 1))
    settings, z = SurfaceSettings(cell_m=0.5, spike_nmad=0), []
    for _ in range(60):
        error = own_m * random.standard_normal((300, 3)) + shared_m * random.standard_normal(3)
        cloud = cloud_of(x + error[:, 0], y + error[:, 1], 50 + slope * x + error[:, 2])
        heights, sigma = both(surface_with_sigma(cloud, precision_of(own_m, shared_m), settings))
        xc, _ = centres(heights)
        z.append(((heights.values - (50 + slope * xc)) / sigma.values).ravel())
    scores = np.concatenate(z)
    scores = scores[np.isfinite(scores)]
    assert np.sqrt(np.mean(scores**2)) == pytest.approx(1.0, abs=0.08)
    assert np.mean(np.abs(scores) < 1) == pytest.approx(0.683, abs=0.03)


def test_surfaces_of_adjusted_surveys_err_as_they_say() -> None:
    """Simulated surveys over level ground: what the DSM is off by, at tie points and in between, in its own sigmas."""
    plan = SurveyPlan(strips=2, photographs_per_strip=4, relief_m=0.0, control_points=5, check_points=0)
    z, points = [], []
    for seed in range(20):
        made = simulate_block(
            plan, seed, tie_points=150, start_position_sigma_m=0.05, start_attitude_sigma_deg=0.05,
            start_point_sigma_m=0.05,
        )  # fmt: skip
        result = adjust(made.block, AdjustmentSettings(robust_loss="none", outlier_threshold=100.0))
        place, rays = result.block.tie_points.position_world_m, result.covariances.tie_point_ray_m2
        precision = PointPrecision(rays, result.covariances.tie_point_m2 - rays)
        settings = SurfaceSettings(cell_m=2.0, spike_nmad=0)
        heights, sigma = both(surface_with_sigma(PointCloud(place), precision, settings))
        score = heights.values / sigma.values
        z.append(score[np.isfinite(score)])
        points.append(place[:, 2] / np.sqrt(result.covariances.tie_point_m2[:, 2, 2]))
    for scores in (np.concatenate(z), np.concatenate(points)):
        assert np.sqrt(np.mean(scores**2)) == pytest.approx(1.0, abs=0.15)
        assert np.mean(np.abs(scores) < 1) == pytest.approx(0.683, abs=0.06)


def test_points_left_out_as_spikes_take_their_standard_deviations_with_them() -> None:
    x, y = scattered(2000, 40.0, 25.0, seed=9)
    z = 60 + 0.1 * x
    z[::100] += 30.0
    own_m = np.tile([0.0, 0.0, 0.02], (2000, 1))
    own_m[::100] = 5.0
    cloud, nothing = cloud_of(x, y, z), np.zeros((2000, 3))
    heights, sigma = both(surface_with_sigma(cloud, precision_of(own_m, nothing), SurfaceSettings(cell_m=0.5)))
    assert np.nanmax(sigma.values) <= 0.02 + 1e-6
    np.testing.assert_array_equal(heights.values, surface_from_points(cloud, SurfaceSettings(cell_m=0.5)).values)


@pytest.mark.parametrize("spacing_m", [1.0, 3.0])
def test_points_held_out_tell_how_far_the_surface_is_off_between_the_points(spacing_m: float) -> None:
    """Without noise, on rolling ground: what is left is what the surface does between the points."""
    count = int(120.0 * 80.0 / spacing_m**2)
    x, y = scattered(count, 120.0, 80.0, seed=5)

    def ground(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(50 + 1.5 * np.sin(x / 2.5) * np.cos(y / 3.0) + 0.3 * np.sin(x) * np.sin(y))

    nothing = precision_of(np.zeros((count, 3)), np.zeros((count, 3)))
    surface = surface_with_sigma(cloud_of(x, y, ground(x, y)), nothing, SurfaceSettings(cell_m=0.5, spike_nmad=0))
    xc, yc = centres(surface.heights)
    off = surface.heights.values - ground(xc, yc)
    error = float(np.sqrt(np.nanmean(off**2)))
    assert np.nanmax(surface.sigma.values) == 0.0
    assert len(surface.held_out_m) > 0.08 * count
    # nine tenths of the points are a little farther apart
    assert np.sqrt(np.mean(surface.held_out_m**2)) == pytest.approx(1.08 * error, rel=0.2)


def test_three_points_hold_none_out() -> None:
    nothing = precision_of(np.zeros((3, 3)), np.zeros((3, 3)))
    cloud = cloud_of(np.array([0.0, 8.0, 0.0]), np.array([0.0, 0.0, 8.0]), np.zeros(3))
    assert len(surface_with_sigma(cloud, nothing, SurfaceSettings(cell_m=1.0)).held_out_m) == 0


def test_a_surface_is_made_on_the_map_or_on_a_plane() -> None:
    with pytest.raises(SettingError, match=r"plane: .*in_plan: always.*remove one"):
        SurfaceSettings(plane="auto", in_plan="always")
