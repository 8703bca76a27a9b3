"""How much texture and noise photographs have in common, on a plane whose contrast and noise are stated."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from photogram.arrays import Float32Array, FloatArray
from photogram.grid import verticals
from photogram.surface.dense.texture import (
    AROUND_PATCHES,
    ENOUGH,
    GROUND_PATCHES,
    LARGEST,
    LEAST_EXPECTED,
    LEAST_PATCHES,
    LEAST_TEXTURE,
    MOST_NOISE,
    MOST_VIEWS,
    WEAK_KEPT,
    Texture,
    as_around,
    effort_for,
    noise_over_texture,
    texture_of,
    weak_patches,
    windows_for,
)
from photogram.surface.views import places_in_view


def shown(plane: Any, contrast: float, noise_dn: float, seed: int = 4) -> list[Float32Array]:
    """Return the plane's photographs with so much of their contrast under so much noise."""
    rng = np.random.default_rng(seed)
    return [
        (90.0 + contrast * (p - p.mean()) + noise_dn * rng.standard_normal(p.shape)).astype(np.float32)
        for p in plane.pictures
    ]


def texture(plane: Any, contrast: float, noise_dn: float, off_m: float = 0.0) -> Texture:
    surface = (plane.height_m + off_m).astype(np.float32)
    return texture_of(plane.crops(shown(plane, contrast, noise_dn)), plane.ground(), surface)


def differences(plane: Any, view: int) -> FloatArray:
    """Return the squared differences (rows, columns) of a photograph between places half a cell apart, each through the
    camera: its mean over patches is what texture has without noise."""
    foot = verticals(plane.frame, plane.grid, plane.grid.whole).foot_world_m
    place = foot + plane.height_m[..., None] * np.array([0.0, 0.0, 1.0])
    half = 0.5 * (place[:, 1:] - place[:, :-1])
    grey = []
    for at in (place[:, :-1], place[:, :-1] + half):
        pixel = places_in_view(plane.views, view, at.reshape(-1, 3))
        grey.append(map_coordinates(plane.pictures[view], pixel.T[::-1], order=1).reshape(at.shape[:2]))
    return np.asarray((grey[1] - grey[0]) ** 2)


def test_texture_is_what_photographs_have_in_common(photographed_plane: Any) -> None:
    clean = texture(photographed_plane, 1.0, 0.0)
    expected = np.median([differences(photographed_plane, view).mean() for view in range(5)])
    assert np.median(clean.energy) == pytest.approx(expected, rel=0.35)  # a patch tells its lower quartile
    assert np.median(clean.common / clean.energy) > 0.9


def test_patches_of_a_single_row_or_column_have_their_texture(photographed_plane: Any) -> None:
    """A block with its margin may be one cell longer than its patches."""
    grid = replace(photographed_plane.grid, rows=65, columns=49)
    found = texture(replace(photographed_plane, grid=grid), 1.0, 0.0)
    assert found.energy.shape == (5, 4)
    assert found.common.min() > 0.0
    assert np.median(found.common[-1] / found.energy[-1]) > 0.9


def test_noise_is_what_they_have_not(photographed_plane: Any) -> None:
    """It grows with its square, as interpolation between pixels leaves it."""
    for noise_dn in (1.0, 4.0):
        noise = texture(photographed_plane, 0.0, noise_dn)
        assert 0.1 < np.median(noise.energy) / (2.0 * noise_dn**2) < 0.7
        assert abs(np.median(noise.common)) < 0.1 * np.median(noise.energy)
    one, four = (np.median(texture(photographed_plane, 0.0, n).energy) for n in (1.0, 4.0))
    assert four / one == pytest.approx(16.0, rel=0.01)


@pytest.mark.parametrize(("contrast", "noise_dn"), [(0.3, 3.0), (0.5, 1.5), (1.0, 4.0)])
def test_both_are_told_apart(photographed_plane: Any, contrast: float, noise_dn: float) -> None:
    clean, noise = texture(photographed_plane, 1.0, 0.0), texture(photographed_plane, 0.0, 1.0)
    both = texture(photographed_plane, contrast, noise_dn)
    unlike = np.median(clean.energy - clean.common)  # interpolation in each photograph by itself
    expected = contrast**2 * np.median(clean.common), contrast**2 * unlike + noise_dn**2 * np.median(noise.energy)
    assert np.median(both.common) == pytest.approx(expected[0], rel=0.2)
    assert np.median(both.energy - both.common) == pytest.approx(expected[1], rel=0.2)
    ratio = np.median(noise_over_texture(both))
    assert ratio == pytest.approx(expected[1] / expected[0], rel=0.3)


def test_textured_ground_is_not_weak_and_weak_ground_is(photographed_plane: Any) -> None:
    assert not weak_patches(texture(photographed_plane, 1.0, 2.0)).any()
    assert weak_patches(texture(photographed_plane, 0.1, 4.0)).all()
    # a surface that is wrong by metres makes no weak texture of a strong one, whose differences are large
    assert not weak_patches(texture(photographed_plane, 1.0, 2.0, off_m=0.5)).all()
    assert weak_patches(texture(photographed_plane, 0.1, 4.0, off_m=3.0)).all()


def made(ratio: FloatArray, noise: float = 3.0) -> Texture:
    """Return the texture of patches with a ``ratio`` of noise over it."""
    return Texture(noise + noise / ratio, noise / ratio)


def test_ratio_is_noise_over_texture() -> None:
    ratio = np.linspace(0.1, 1.0 / LEAST_TEXTURE, 42).reshape(6, 7)
    assert noise_over_texture(made(ratio)) == pytest.approx(ratio)
    unknown = made(ratio)
    unknown.energy[2, 3] = unknown.common[2, 3] = np.nan
    assert noise_over_texture(unknown)[2, 3] == 0.0
    none = made(ratio)
    none.common[:] = -0.1
    assert noise_over_texture(none).max() <= 1.0 / LEAST_TEXTURE + 1e-9


def test_what_differs_by_more_than_noise_is_texture() -> None:
    """A patch that no photograph shows like another, because its height is not known."""
    of = made(np.full((6, 6), 0.2))
    of.common[1, 1] = 0.0
    assert noise_over_texture(of)[1, 1] == pytest.approx(3.0 / (18.0 - 2.0 * 3.0))


@pytest.mark.parametrize("energy", [3.6 * MOST_NOISE, 100.0, 400.0])
def test_leaves_in_the_wind_are_no_weak_texture(energy: float) -> None:
    """Photographs of a wood have nothing in common, as those of a lawn at dusk; but their differences are large."""
    wood = Texture(np.full((20, 20), energy), np.full((20, 20), -0.05 * energy))
    assert noise_over_texture(wood).max() < ENOUGH
    assert not weak_patches(wood).any()
    lawn = Texture(np.full((20, 20), 0.9 * MOST_NOISE), np.full((20, 20), 0.05 * MOST_NOISE))
    assert weak_patches(lawn).all()


def test_few_patches_tell_nothing() -> None:
    few = made(np.full((1, LEAST_PATCHES - 1), 10.0))
    assert not noise_over_texture(few).any()
    assert noise_over_texture(made(np.full((1, LEAST_PATCHES), 10.0))).all()


def test_single_patches_are_as_the_ground_around() -> None:
    ratio = np.full((20, 20), 0.1)
    ratio[10, 10] = 30.0
    assert not weak_patches(made(ratio)).any()
    ratio = np.full((20, 20), 8.0)
    ratio[9:12, 9:12] = 0.1
    assert GROUND_PATCHES**2 > 2 * 9
    assert weak_patches(made(ratio)).all()
    ratio[:, 10:] = 0.1
    weak = weak_patches(made(ratio))
    assert weak[:, :9].all()
    assert not weak[:, 11:].any()


def test_a_patch_has_no_more_texture_than_those_around() -> None:
    ratio, weak = np.full((9, 9), 6.0), np.ones((9, 9), bool)
    ratio[4, 3:6], ratio[0, 0], weak[0, 0] = 0.2, 0.2, False
    found = as_around(ratio, weak)
    assert AROUND_PATCHES == 5
    assert np.all(found[weak] == 6.0)
    assert found[0, 0] == 0.0
    ratio[4, 4] = 20.0
    assert as_around(ratio, weak)[4, 4] == 20.0


def test_weak_texture_takes_photographs_first_and_then_larger_windows() -> None:
    ratio = np.array([[0.1, ENOUGH, 1.5 * ENOUGH, 4.0 * ENOUGH, 1000.0]])
    effort = effort_for(ratio, np.full(ratio.shape, 20), 6, 0.5)
    assert effort.views.tolist() == [[6, 6, 9, MOST_VIEWS, MOST_VIEWS]]
    assert effort.side[0, :3].tolist() == [1.0, 1.0, 1.0]
    # the variance of a match is that of ENOUGH: samples times photographs grow as the ratio
    assert effort.side[0, 3] ** 2 == pytest.approx(1.0 + 3.0 * 6 / 10)
    assert effort.side[0, 4] == LARGEST
    assert effort.kept.tolist() == [[0.5, 0.5, WEAK_KEPT, WEAK_KEPT, WEAK_KEPT]]
    assert effort.weak.tolist() == [[False, False, True, True, True]]
    assert np.all(np.diff(effort.expected[0, 1:]) < 0.0)
    assert effort.expected[0, 4] == LEAST_EXPECTED
    assert effort.expected[0, 3] == pytest.approx((1.0 + ENOUGH) / (1.0 + 4.0 * ENOUGH))
    few = effort_for(ratio, np.full(ratio.shape, 3), 6, 0.5)
    assert few.side[0, 3] > effort.side[0, 3]
    assert effort_for(ratio, few.views, 16, 0.9).kept.tolist() == [[0.9] * 5]


def test_windows_grow_where_texture_is_weak() -> None:
    effort = effort_for(np.array([[0.1, 1.2 * ENOUGH, 1000.0]]), np.full((1, 3), 20), 6, 0.5)
    windows = windows_for(effort, 2, 3, 1.5)
    assert windows.half.tolist() == [[2, 3, 9]]
    assert windows.kept.tolist() == effort.kept.tolist()
    assert windows.noise == 1.5
