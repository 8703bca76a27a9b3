"""Comparison of clouds: exact cases, and brute force as the referee."""

from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import SharedData
from scipy.interpolate import LinearNDInterpolator
from threadpoolctl import threadpool_info, threadpool_limits

from photogram.arrays import BoolArray, FloatArray
from photogram.errors import PhotogramError
from photogram.quality import cloud_comparison as comparison
from photogram.quality.cloud_comparison import (
    cloud_to_cloud,
    cloud_to_surface,
    compare_to_reference,
    sor_filter,
    statistics,
    triangulate,
)
from photogram.survey import PointCloud, Raster

SITE = np.array([719_900.0, 6_191_900.0, 70.0])


def random_points(count: int, seed: int = 0) -> FloatArray:
    return SITE + np.random.default_rng(seed).uniform(0, [40.0, 25.0, 3.0], (count, 3))


def raster_of(values: FloatArray, cell_m: float = 0.5) -> Raster:
    return Raster(values.astype(np.float32), SITE[0], SITE[1] + 25.0, cell_m)


def plane_raster() -> Raster:
    x, y = np.meshgrid((np.arange(80) + 0.5) * 0.5, 25 - (np.arange(50) + 0.5) * 0.5)
    return raster_of(0.25 * x - 0.5 * y + 70)


def sor_by_brute_force(points: FloatArray, neighbours: int, sigma: float) -> BoolArray:
    """CloudCompare's rule in loops: the point is one of its neighbours, and left out of the mean."""
    means = []
    for i, point in enumerate(points):
        nearest = sorted(range(len(points)), key=lambda j: (float(np.linalg.norm(points[j] - point)), j != i))[
            :neighbours
        ]
        means.append(np.mean([np.linalg.norm(points[j] - point) for j in nearest if j != i]))
    mean = sum(means) / len(means)
    spread = np.sqrt(abs(sum(m * m for m in means) / len(means) - mean * mean))
    return np.array([m <= mean + sigma * spread for m in means])


@pytest.mark.parametrize(("neighbours", "sigma"), [(6, 1.0), (2, 0.5), (11, 2.0)])
def test_sor_agrees_with_brute_force(neighbours: int, sigma: float) -> None:
    points = random_points(150, seed=neighbours)
    expected = sor_by_brute_force(points - SITE, neighbours, sigma)
    assert 0 < np.sum(~expected) < 60
    np.testing.assert_array_equal(sor_filter(points, neighbours, sigma), expected)


def test_sor_removes_a_lone_point_and_keeps_tiny_clouds() -> None:
    cloud = np.vstack([random_points(300), SITE + np.array([20, 12, 500])])
    assert not sor_filter(cloud)[-1]
    assert sor_filter(cloud[:1]).tolist() == [True]
    assert sor_filter(cloud[:2]).tolist() == [True, True]
    assert sor_filter(cloud[:0]).tolist() == []
    with pytest.raises(PhotogramError, match="at least 2"):
        sor_filter(cloud, neighbours=1)


def test_nearest_distances_agree_with_brute_force() -> None:
    cloud, reference = random_points(80, 1), random_points(130, 2)
    expected = np.linalg.norm(cloud[:, None] - reference[None], axis=2).min(axis=1)
    np.testing.assert_allclose(cloud_to_cloud(PointCloud(cloud), PointCloud(reference)), expected, rtol=0, atol=1e-8)
    with pytest.raises(PhotogramError, match="no points"):
        cloud_to_cloud(PointCloud(cloud), PointCloud(reference[:0]))


def test_height_over_a_plane_is_exact_and_signed_for_raster_and_cloud() -> None:
    random = np.random.default_rng(4)
    x, y = random.uniform(1, 39, 500), random.uniform(1, 24, 500)
    offset = random.normal(0, 0.3, 500)
    cloud = PointCloud(SITE * [1, 1, 0] + np.column_stack([x, y, 70 + 0.25 * x - 0.5 * y + offset]))
    np.testing.assert_allclose(cloud_to_surface(cloud, plane_raster()), offset, rtol=0, atol=1e-5)
    rx, ry = random.uniform(0, 40, 4000), random.uniform(0, 25, 4000)
    corner = np.array([[0, 0], [40, 0], [0, 25], [40, 25]], dtype=np.float64)
    rx, ry = np.append(rx, corner[:, 0]), np.append(ry, corner[:, 1])
    reference = PointCloud(SITE * [1, 1, 0] + np.column_stack([rx, ry, 70 + 0.25 * rx - 0.5 * ry]))
    np.testing.assert_allclose(cloud_to_surface(cloud, reference), offset, rtol=0, atol=1e-7)


def test_bilinear_sample_by_hand() -> None:
    raster = Raster(np.array([[1, 2, 3], [5, 8, 13]], dtype=np.float32), 100.0, 200.0, 2.0)
    # a quarter of a cell east and three quarters south of the first centre
    cloud = PointCloud(np.array([[101.5, 197.5, 10.0], [105.0, 197.0, 10.0]]))
    by_hand = 0.75 * 0.25 * 1 + 0.25 * 0.25 * 2 + 0.75 * 0.75 * 5 + 0.25 * 0.75 * 8
    np.testing.assert_allclose(cloud_to_surface(cloud, raster), [10 - by_hand, 10 - 13], rtol=0, atol=1e-12)


def test_a_sample_needs_all_four_cells() -> None:
    values = np.full((50, 80), 70.0)
    values[20, 30] = np.nan
    raster = raster_of(values)
    centre = SITE[:2] + np.array([(30 + 0.5) * 0.5, 25 - (20 + 0.5) * 0.5])
    steps = np.array([[0.2, 0.2], [-0.2, 0.3], [0.499, 0.0], [0.51, 0.0], [0.0, -0.51], [0.0, 0.0]])
    heights = cloud_to_surface(PointCloud(np.column_stack([centre + steps, np.full(6, 71.0)])), raster)
    np.testing.assert_array_equal(np.isnan(heights), [True, True, True, False, False, True])
    outer = SITE + np.array([[0.2, 10, 0], [39.8, 10, 0], [10, 0.2, 0], [10, 24.8, 0], [-5, 10, 0], [10, 40, 0]])
    assert np.isnan(cloud_to_surface(PointCloud(outer), raster)).all()
    rim = SITE + np.array([[0.25, 10, 0], [39.75, 10, 0], [10, 0.25, 0], [10, 24.75, 0]])
    np.testing.assert_allclose(cloud_to_surface(PointCloud(rim), raster), 0.0, atol=1e-9)


def test_a_reference_cloud_is_not_stretched_over_its_hull_or_its_gaps() -> None:
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 30, 0.5), np.arange(0, 20, 0.5)))
    hole = np.hypot(x - 15, y - 10) < 6
    reference = PointCloud(SITE + np.column_stack([x, y, 0 * x])[~hole])
    cloud = PointCloud(SITE + np.array([[15, 10, 1.0], [3.3, 4.4, 1.0], [-1, 5, 1.0], [31, 5, 1.0]]))
    np.testing.assert_allclose(cloud_to_surface(cloud, reference), [np.nan, 1.0, np.nan, np.nan], atol=1e-9)
    np.testing.assert_allclose(
        cloud_to_surface(cloud, triangulate(reference, 20.0)), [1.0, 1.0, np.nan, np.nan], atol=1e-9
    )
    with pytest.raises(PhotogramError, match="at least 3"):
        cloud_to_surface(cloud, PointCloud(reference.position_map_m[:2]))
    with pytest.raises(PhotogramError, match="on one line"):
        cloud_to_surface(cloud, PointCloud(SITE + np.outer(np.arange(5.0), [1, 2, 0])))


def test_statistics_by_hand() -> None:
    figures = statistics(np.array([1.0, 2.0, np.nan, 4.0, 13.0]))
    # median 3, deviations 2 1 1 10, their median 1.5
    expected = (5, 4, 5.0, np.sqrt((16 + 9 + 1 + 64) / 3), 3.0, 1.4826 * 1.5, np.sqrt((1 + 4 + 16 + 169) / 4))
    np.testing.assert_allclose(astuple(figures), expected, rtol=1e-14)
    assert np.isnan(statistics(np.array([2.0])).std_m)
    with pytest.raises(PhotogramError, match="none of the 2 points"):
        statistics(np.full(2, np.nan))


@settings(max_examples=20, deadline=None)
@given(shift=st.floats(-100, 100), scale=st.floats(0.01, 100), seed=st.integers(0, 1000))
def test_nmad_estimates_sigma_and_shrugs_off_outliers(shift: float, scale: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    sample = shift + scale * random.normal(size=20_000)
    sample[:200] += 1e4 * scale
    figures = statistics(sample)
    assert figures.nmad_m == pytest.approx(scale, rel=0.06)
    assert figures.std_m > 100 * scale


def test_compare_finds_the_stated_offset_and_noise() -> None:
    random = np.random.default_rng(9)
    x, y = random.uniform(2, 38, 4000), random.uniform(2, 23, 4000)
    heights = 70 + 0.25 * x - 0.5 * y + 0.2 + random.normal(0, 0.05, 4000)
    heights[:5] += 60
    cloud = PointCloud(SITE * [1, 1, 0] + np.column_stack([x, y, heights]))
    comparison = compare_to_reference(cloud, plane_raster())
    surface = comparison.cloud_to_surface
    assert comparison.removed + len(comparison.position_map_m) == 4000
    assert surface.points == surface.compared == len(comparison.surface_difference_m)
    assert surface.mean_m == pytest.approx(0.2, abs=0.004)
    assert surface.nmad_m == pytest.approx(0.05, abs=0.003)
    assert surface.std_m == pytest.approx(0.05, abs=0.003)
    unfiltered = compare_to_reference(cloud, plane_raster(), sor=False)
    assert unfiltered.removed == 0
    assert unfiltered.cloud_to_surface.std_m > 1
    assert comparison.cloud_to_cloud.rmse_m < unfiltered.cloud_to_cloud.rmse_m


@pytest.mark.parametrize("lift_m", [0.1, 9.0])
def test_distance_to_a_raster_is_exact_whatever_the_margin(lift_m: float) -> None:
    raster = plane_raster()
    cloud = PointCloud(SITE + np.random.default_rng(3).uniform(0, [4.0, 3.0, 1.0], (30, 3)) + [30, 1, lift_m])
    x, y = np.meshgrid((np.arange(80) + 0.5) * 0.5, 25 - (np.arange(50) + 0.5) * 0.5)
    cells = SITE * [1, 1, 0] + np.column_stack([x.ravel(), y.ravel(), raster.values.ravel()])
    expected = np.linalg.norm(cloud.position_map_m[:, None] - cells[None], axis=2).min(axis=1)
    np.testing.assert_allclose(
        compare_to_reference(cloud, raster, sor=False).cloud_distance_m, expected, rtol=0, atol=1e-8
    )


def test_clouds_that_do_not_meet_are_refused() -> None:
    cloud = PointCloud(random_points(20) + np.array([5000, 0, 0]))
    for reference in (plane_raster(), PointCloud(random_points(50))):
        with pytest.raises(
            PhotogramError, match=r"does not overlap the cloud; it lies \d+ m west of the survey: check its CRS"
        ):
            compare_to_reference(cloud, reference)
    with pytest.raises(PhotogramError, match="no points"):
        compare_to_reference(PointCloud(np.zeros((0, 3))), plane_raster())


def test_a_real_reference_cloud_agrees_with_the_surface_made_from_it(shared_data: SharedData) -> None:
    import rasterio

    with rasterio.open(shared_data("dtu_phantom4/surface_truth.tif")) as source:
        raster = Raster(source.read(1), source.transform.c, source.transform.f, source.transform.a)
    points = np.loadtxt(shared_data("dtu_phantom4/points_agisoft.txt"), usecols=(0, 1, 2))
    inside = np.all(np.abs(points[:, :2] - [719_945, 6_191_975]) < 40, axis=1)
    surface = compare_to_reference(PointCloud(points[inside]), raster).cloud_to_surface
    assert surface.compared > 5000
    assert abs(surface.median_m) < 0.02
    assert surface.nmad_m < 0.05


def test_a_reference_triangulated_once_serves_many_clouds_with_the_same_figures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reference = PointCloud(random_points(400, 1))
    surface = triangulate(reference)
    clouds = [PointCloud(random_points(200, seed)) for seed in (2, 3)]
    each_alone = [compare_to_reference(cloud, reference) for cloud in clouds]
    monkeypatch.setattr(comparison, "Delaunay", None)  # nothing is triangulated again
    for cloud, alone in zip(clouds, each_alone, strict=True):
        found = compare_to_reference(cloud, surface)
        np.testing.assert_array_equal(found.surface_difference_m, alone.surface_difference_m)
        np.testing.assert_array_equal(found.cloud_distance_m, alone.cloud_distance_m)


def test_the_triangles_are_solved_by_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []

    class Counting(LinearNDInterpolator):
        def __call__(self, *place: Any) -> Any:
            threads.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
            return super().__call__(*place)

    monkeypatch.setattr(comparison, "LinearNDInterpolator", Counting)
    with threadpool_limits(2, "blas"):
        cloud_to_surface(PointCloud(random_points(50, 2)), PointCloud(random_points(400, 1)))
    assert threads
    assert set(threads) == {1}
