"""The picture of a difference: what is coloured how, and outlines where they lie."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from matplotlib.colors import to_rgba

from photogram.grid import MapGrid
from photogram.report.figures.difference_figure import (
    NO_DATA,
    DifferencePicture,
    difference_figure,
    gridded,
)
from photogram.report.figures.style import save_picture
from photogram.volumes.volumes import volume_label

GRID = MapGrid(500_000.0, 6_000_000.0, 1.0, 30, 40)


def shown() -> DifferencePicture:
    difference = np.zeros((30, 40))
    difference[5:10, 5:10], difference[5:10, 20:25], difference[20:25, 5:10] = 2.0, -2.0, np.nan
    heap = shapely.box(500_004, 5_999_989, 500_011, 5_999_996)
    return DifferencePicture(
        difference, np.abs(np.nan_to_num(difference)) < 0.1, GRID, [("heap", heap)],
        [shapely.box(500_020, 5_999_975, 500_030, 5_999_985)], "june/dsm.tif", "may/dsm.tif",
        {"heap": volume_label(50.0, 2.5)},
    )  # fmt: skip


def test_raised_ground_is_red_lowered_blue_and_what_is_not_known_grey() -> None:
    axes = difference_figure(shown()).axes[0]
    picture = axes.images[0].get_array()
    assert picture is not None
    raised, lowered, still, hole = picture[7, 7], picture[7, 22], picture[15, 30], picture[22, 7]
    assert raised[0] > raised[2] + 0.2
    assert lowered[2] > lowered[0] + 0.2
    assert np.min(still[:3]) > 0.95
    assert hole[3] == 0.0
    assert axes.get_facecolor() == to_rgba(NO_DATA)
    assert tuple(axes.images[0].get_extent()) == (500_000.0, 500_040.0, 5_999_970.0, 6_000_000.0)
    texts = {text.get_text() for text in axes.texts}
    assert "heap\n+50.0 ± 2.5 m³" in texts
    outlines = [np.asarray(line.get_xydata()) for line in axes.lines]
    assert [line[:, 0].max() for line in outlines] == [500_030.0, 500_011.0]


def test_the_picture_is_the_same_for_the_same_data(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        save_picture(difference_figure(shown()), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    nothing = replace(shown(), difference_m=np.full((30, 40), np.nan))
    save_picture(difference_figure(nothing), tmp_path / "none.png")


def test_points_become_means_over_cells() -> None:
    east, north = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    place = np.column_stack([east.ravel(), north.ravel()])
    within = np.ones(1200, dtype=bool)
    within[place[:, 0] > 30.0] = False
    values, pale, grid = gridded(place, 0.1 * place[:, 0], within)
    assert np.isfinite(values).mean() > 0.95
    middle = grid.centres_map_m(grid.whole)[0]
    known = np.isfinite(values)
    np.testing.assert_allclose(values[known], np.broadcast_to(0.1 * middle, values.shape)[known], atol=0.1)
    assert pale[:, middle < 28].all()
    assert not pale[known & (middle > 32)].any()
