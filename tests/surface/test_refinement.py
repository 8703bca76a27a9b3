"""Heights to a fraction of a hypothesis on a tilted plane that is known, with noise that is stated."""

from typing import Any

import numpy as np
import pytest
from patch_windows import same_windows

from photogram.surface.dense.refinement import InitialHeights, Refined, own_side_mean, refine_heights

GSD_M = 0.1
WINDOW = 3, 1.5, 0.5


def refined(plane: Any, pictures: Any, start: Any, views: Any = None) -> tuple[Any, Any, Any, Any]:
    """Return heights, standard deviations, correlations and numbers of photographs from a surface to start from."""
    shape = start.shape
    height, sigma, correlation = (np.empty(shape, np.float32) for _ in range(3))
    rays, ground = np.empty(shape, np.uint8), plane.ground()
    if views is not None:
        ground = ground._replace(views=views)
    surface = start.astype(np.float32)
    smooth = np.empty_like(surface)
    own_side_mean(surface, plane.tilt, 0.3, 2, smooth)
    smooth = np.where(np.isfinite(smooth), smooth, plane.height_m).astype(np.float32)
    from_here = InitialHeights(surface, smooth, plane.tilt, 0.08, 0.3, 1.0, 0.15)
    windows = same_windows(ground, *WINDOW)
    refine_heights(plane.crops(pictures), ground, windows, from_here, Refined(height, sigma, correlation, rays))
    return height, sigma, correlation, rays


def noisy(plane: Any, noise_dn: float, seed: int = 3) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [p + noise_dn * rng.standard_normal(p.shape) for p in plane.pictures]


def uneven(plane: Any) -> Any:
    """Return the plane, off by up to 5 cm, as a regularised volume gives it."""
    row, column = np.mgrid[: plane.grid.rows, : plane.grid.columns]
    return plane.height_m + 0.05 * np.sin(column / 20.0) * np.cos(row / 15.0)


@pytest.mark.parametrize("noise_dn", [0.0, 1.0, 2.0, 4.0])
def test_heights_are_unbiased(photographed_plane: Any, noise_dn: float) -> None:
    height, _, _, rays = refined(photographed_plane, noisy(photographed_plane, noise_dn), uneven(photographed_plane))
    error = height - photographed_plane.height_m
    assert np.isfinite(error).mean() > 0.95
    assert abs(np.nanmedian(error)) < 0.05 * GSD_M
    assert 1.4826 * np.nanmedian(np.abs(error)) < 0.6 * GSD_M
    assert np.median(rays) == 5


@pytest.mark.parametrize("seen_by", [(0, 1, 2, 3, 4), (0, 2, 4), (0, 4)])
@pytest.mark.parametrize("noise_dn", [0.5, 1.0, 2.0, 4.0])
def test_sigma_is_that_of_the_errors(photographed_plane: Any, noise_dn: float, seen_by: tuple[int, ...]) -> None:
    """6400 cells, white noise: the setting noise_dn, 1.5, is no more than a guess of it."""
    views = np.full_like(photographed_plane.ground().views, -1)
    views[..., : len(seen_by)] = seen_by
    pictures = noisy(photographed_plane, noise_dn)
    height, sigma, _, _ = refined(photographed_plane, pictures, uneven(photographed_plane), views)
    z = (height - photographed_plane.height_m) / sigma
    assert 0.8 < 1.4826 * np.nanmedian(np.abs(z)) < 1.25
    assert np.nanmean(np.abs(z) > 4.0) < 0.03


def test_sigma_grows_with_noise(photographed_plane: Any) -> None:
    medians = [
        np.nanmedian(refined(photographed_plane, noisy(photographed_plane, n), photographed_plane.height_m)[1])
        for n in (0.0, 1.0, 2.0, 4.0)
    ]
    assert medians == sorted(medians)
    assert medians[3] > 1.5 * medians[0]


def test_what_fewer_than_two_photographs_see_has_no_height(photographed_plane: Any) -> None:
    views = photographed_plane.ground().views.copy()
    views[:2, :, 1:], views[2:3, :, :] = -1, -1
    height, sigma, correlation, rays = refined(photographed_plane, None, photographed_plane.height_m, views)
    patch = photographed_plane.patch
    for values in (height, sigma):
        assert np.isnan(values[: 3 * patch]).all()
        assert np.isfinite(values[3 * patch :]).mean() > 0.998
    assert not correlation[: 3 * patch].any()
    assert not rays[: 3 * patch].any()


def test_where_nothing_is_known_nothing_is_refined(photographed_plane: Any) -> None:
    start = photographed_plane.height_m.copy()
    start[10:20, 30:40] = np.nan
    height = refined(photographed_plane, None, start)[0]
    assert np.isnan(height[np.isnan(start)]).all()
    assert np.isfinite(height[np.isfinite(start)]).mean() > 0.998


def test_a_photograph_of_something_else_is_no_ray(photographed_plane: Any) -> None:
    pictures = list(photographed_plane.pictures)
    pictures[2] = np.ascontiguousarray(pictures[2][::-1, ::-1])
    height, _, _, rays = refined(photographed_plane, pictures, uneven(photographed_plane))
    assert np.median(rays) == 4
    assert np.mean(rays == 5) < 0.05
    assert np.nanmedian(np.abs(height - photographed_plane.height_m)) < 0.2 * GSD_M


def test_gain_and_offset_of_a_photograph_change_nothing(photographed_plane: Any) -> None:
    pictures = noisy(photographed_plane, 1.0)
    brighter = [pictures[0], 1.25 * pictures[1] + 10.0, *pictures[2:]]
    start = uneven(photographed_plane)
    plain, changed = refined(photographed_plane, pictures, start)[0], refined(photographed_plane, brighter, start)[0]
    assert np.nanmedian(np.abs(plain - changed)) < 0.01 * GSD_M
