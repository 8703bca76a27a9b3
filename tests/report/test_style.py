"""Pictures: what is drawn where, the same bytes for the same data, and whole or not at all."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver, QuiverKey
from matplotlib.text import Text
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from photogram.camera import Camera, LensField
from photogram.errors import WorkspaceError
from photogram.grid import decimated
from photogram.languages.language import Language
from photogram.lens.fields import free_field
from photogram.quality.cloud_comparison import Comparison, statistics
from photogram.report.figures.plan_view import (
    FEW,
    MAXIMUM_PHOTOGRAPH_NAMES,
    PlanContents,
    enlargement,
    overlap_levels,
    place_labels,
    plan_figure,
)
from photogram.report.figures.style import (
    MAXIMUM_RASTER_PX,
    _grid_means,
    candidate_and_verified_matches,
    comparison_figure,
    field_figure,
    length_label,
    new_figure,
    residual_figure,
    save_picture,
    surface_figure,
)
from photogram.survey import Raster, Role
from photogram.teaching.figures import inliers_by_iteration, inliers_by_sample_size
from photogram.teaching.ransac_study import RansacStudy, study

SITE = np.array([719_900.0, 6_191_900.0, 70.0])
SKY, ORANGE, VERMILION, GREEN = (86, 180, 233), (230, 159, 0), (213, 94, 0), (0, 158, 115)
CAMERA = Camera("wide", 600, 400, 500.0, np.array([300.0, 200.0]))


def pixels_near(path: Path, colour: tuple[int, int, int], tolerance: int = 40) -> int:
    rgb = np.asarray(Image.open(path).convert("RGB")).astype(np.int64)
    return int(np.sum(np.abs(rgb - colour).max(axis=2) < tolerance))


def draw_matches(path: Path) -> None:
    random = np.random.default_rng(0)
    left, right = (np.full((rows, columns, 3), 70, dtype=np.uint8) for rows, columns in ((300, 400), (200, 260)))
    pixels = random.uniform(0, [250, 190], (500, 2))
    candidate_and_verified_matches(path, left, right, pixels, pixels, random.random(500) < 0.7, "two photographs")


def a_raster() -> Raster:
    y, x = np.mgrid[0:40, 0:70]
    values = (70 + 5 * np.sin(x / 9) * np.cos(y / 7)).astype(np.float32)
    values[10:20, 30:45] = np.nan
    return Raster(values, SITE[0], SITE[1], 0.5)


def a_comparison(spread_m: float, count: int = 300) -> Comparison:
    random = np.random.default_rng(count)
    difference = random.normal(0.02, spread_m, count)
    difference[:7] = np.nan
    figures = statistics(difference)
    return Comparison(SITE + random.uniform(0, 50, (count, 3)), difference, np.abs(difference), figures, figures, 3)


def contents(photographs: int = 4, ground: int = 6, unregistered: int = 0, flights: int = 1) -> PlanContents:
    random = np.random.default_rng(photographs)
    roles: list[Role] = ["control" if i % 2 else "check" for i in range(ground)]
    positions, points = (SITE + random.uniform(0, [60, 40, 5], (n, 3)) for n in (photographs, ground))
    gnss = np.full((photographs, 3), np.nan)
    gnss[1:] = 0.3
    rows, columns = np.mgrid[0:40, 0:60]
    counts = np.minimum(np.minimum(rows, 39 - rows), np.minimum(columns, 59 - columns)).astype(np.float32)
    counts[:5, :9] = np.nan
    return PlanContents(
        [f"DJI_{i:04d}.JPG" for i in range(photographs)], [f"{i % flights}" for i in range(photographs)],
        np.arange(photographs) >= unregistered, positions, gnss,
        [f"G{i}" for i in range(ground)], roles, points,
        random.normal(0, 0.02, (ground, 3)), Raster(counts, SITE[0], SITE[1] + 40, 1.0),
    )  # fmt: skip


def a_study() -> RansacStudy:
    random = np.random.default_rng(1)
    first = random.uniform(0, 1000, (60, 2))
    return study(first, first + np.array([20, 3]) + random.normal(0, 1, (60, 2)), (40,), (8, 12), (1.0, 3.0))


def a_field() -> LensField:
    field = free_field(CAMERA, 0.2)
    return replace(field, coefficients=field.sigmas)


DRAWINGS: dict[str, Callable[[Path], None]] = {
    "matches": draw_matches,
    "surface": lambda path: save_picture(surface_figure(a_raster(), "surface"), path),
    "comparison": lambda path: save_picture(
        comparison_figure({"linear": a_comparison(0.3), "adjusted": a_comparison(0.05)}), path
    ),
    "residuals": lambda path: save_picture(
        residual_figure(
            CAMERA,
            np.mgrid[0:600:9, 0:400:9].reshape(2, -1).T * 1.0,
            np.random.default_rng(0).normal(0, 1, (67 * 45, 2)),
            "residuals",
        ),
        path,
    ),
    "lens field": lambda path: save_picture(field_figure(CAMERA, a_field(), 1e-4 * np.eye(60), "lens field"), path),
    "plan": lambda path: save_picture(plan_figure(contents(), "plan"), path),
    "iterations": lambda path: inliers_by_iteration(path, a_study(), 1),
    "sample sizes": lambda path: inliers_by_sample_size(path, a_study()),
}


@pytest.mark.parametrize("name", list(DRAWINGS))
@pytest.mark.filterwarnings("error")
def test_a_picture_is_drawn_without_warnings_and_is_the_same_twice(tmp_path: Path, name: str) -> None:
    first, second = tmp_path / "new folder" / "first.png", tmp_path / "second.png"
    DRAWINGS[name](first)
    DRAWINGS[name](second)
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as picture:
        assert picture.size[0] > 500
        assert isinstance(picture, PngImageFile)
        assert picture.text == {}
        assert len(np.unique(np.asarray(picture.convert("L")))) > 20
    assert [p.name for p in first.parent.iterdir()] == ["first.png"]


def test_a_lens_field_is_drawn_as_large_as_it_is() -> None:
    field = a_field()
    axes = field_figure(CAMERA, field, 1e-4 * np.eye(60)).axes[0]
    arrows = next(child for child in axes.get_children() if isinstance(child, Quiver))
    np.testing.assert_allclose(np.hypot(arrows.U, arrows.V), np.linalg.norm(field.shift[::3, ::3], axis=2).ravel())
    columns = np.asarray(arrows.X, dtype=np.float64)
    assert columns.min() == -0.5
    assert columns.max() <= CAMERA.width_px - 0.5
    longest = np.hypot(arrows.U, arrows.V).max() / float(arrows.scale or np.nan)
    assert 5.0 < longest < CAMERA.width_px / 10


def test_an_unwritable_path_is_named_and_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "plain file").write_text("")
    with pytest.raises(WorkspaceError, match="plain file"):
        save_picture(surface_figure(a_raster(), "surface"), tmp_path / "plain file" / "surface.png")
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(WorkspaceError, match=r"taken\.png"):
        save_picture(new_figure(2, 2), tmp_path / "taken.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plain file", "taken.png"]


def test_a_picture_that_fails_keeps_the_one_that_stood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(b"old")
    figure = new_figure(2, 2)

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no canvas")

    monkeypatch.setattr(FigureCanvasAgg, "print_png", fail)
    with pytest.raises(RuntimeError):
        save_picture(figure, path)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1


def test_verified_and_rejected_matches_are_both_seen(tmp_path: Path) -> None:
    black = np.zeros((300, 400, 3), dtype=np.uint8)
    pixels = np.random.default_rng(0).uniform(0, [400, 300], (50, 2))
    seen = {}
    for name, share in (("all", 1.0), ("none", 0.0), ("half", 0.5)):
        path = tmp_path / f"{name}.png"
        candidate_and_verified_matches(path, black, black, pixels, pixels, np.arange(50) < 50 * share, name)
        seen[name] = pixels_near(path, SKY, 90), pixels_near(path, ORANGE, 90)
    assert seen["all"][0] > 5 * seen["none"][0]
    assert seen["none"][1] > 5 * seen["all"][1]
    assert seen["half"][0] > 2 * seen["none"][0]
    assert seen["half"][1] > 2 * seen["all"][1]
    candidate_and_verified_matches(tmp_path / "0.png", black, black, pixels[:0], pixels[:0], np.zeros(0, bool), "empty")


def test_the_light_comes_from_the_north_west_and_holes_are_grey(tmp_path: Path) -> None:
    y, x = np.mgrid[0:200, 0:200]
    hill = 30 - np.hypot(x - 100, y - 100) * 0.25
    hill[95:105, 95:105] = np.nan
    path = tmp_path / "hill.png"
    save_picture(surface_figure(Raster(hill.astype(np.float32), SITE[0], SITE[1], 1.0), "hill"), path)
    grey = np.asarray(Image.open(path).convert("RGB")).astype(np.int64)
    hole = np.argwhere((grey == 221).all(axis=2))
    row, column = hole.mean(axis=0).astype(int)
    assert len(hole) > 200
    lit, dark = (
        grey[row - 120 : row - 80, column - 120 : column - 80],
        grey[row + 80 : row + 120, column + 80 : column + 120],
    )
    assert lit.mean() > dark.mean() + 20
    # the two other corners face sideways and lie between
    assert dark.mean() < grey[row - 120 : row - 80, column + 80 : column + 120].mean() < lit.mean()


def test_a_thinned_raster_keeps_its_means_and_its_corner() -> None:
    values = np.arange(3000 * 7, dtype=np.float32).reshape(3000, 7)
    values[0, 0] = np.nan
    thinned, _ = decimated(Raster(values, 0.0, 0.0, 0.5), MAXIMUM_RASTER_PX)
    assert thinned.values.shape == (1000, 3)
    assert thinned.cell_m == 1.5
    assert thinned.values[0, 0] == np.nanmean(values[:3, :3])
    assert thinned.values[-1, -1] == values[-3:, 6].mean()
    values[:] = np.nan
    assert np.isnan(decimated(Raster(values, 0.0, 0.0, 0.5), MAXIMUM_RASTER_PX)[0].values).all()


def test_an_empty_raster_is_still_a_picture(tmp_path: Path) -> None:
    empty = Raster(np.full((3, 9), np.nan, dtype=np.float32), 0.0, 0.0, 1.0)
    save_picture(surface_figure(empty, "empty"), tmp_path / "empty.png")
    assert (tmp_path / "empty.png").exists()


def test_grid_means_by_hand() -> None:
    pixel = np.array([[1.0, 1], [3, 1], [11, 1], [12, 25]])
    residual = np.array([[1.0, 0], [3, 2], [5, 5], [7, -7]])
    mean_px, mean_residual, count = _grid_means(pixel, residual, 10.0)
    np.testing.assert_array_equal(mean_px, [[2, 1], [11, 1], [12, 25]])
    np.testing.assert_array_equal(mean_residual, [[2, 1], [5, 5], [7, -7]])
    np.testing.assert_array_equal(count, [2, 1, 1])


def test_few_residuals_and_none_are_drawn(tmp_path: Path) -> None:
    for count in (0, 1, 12):
        path = tmp_path / f"{count}.png"
        save_picture(residual_figure(CAMERA, np.full((count, 2), 100.0), np.full((count, 2), 0.5), "marks"), path)
        assert pixels_near(path, VERMILION) > 20


def saved_plan(path: Path, contents: PlanContents) -> Figure:
    figure = plan_figure(contents, "plan")
    save_picture(figure, path)
    return figure


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def words_in(figure: Figure) -> str:
    return "\n".join(text.get_text() for text in figure.axes[0].texts)


@pytest.mark.parametrize(
    ("photographs", "ground", "unregistered", "flights"),
    [(1, 0, 0, 1), (0, 3, 0, 1), (2, 3, 2, 1), (80, 30, 3, 2), (400, 12, 40, 9)],
)
@pytest.mark.filterwarnings("error")
def test_plans_of_every_size(tmp_path: Path, photographs: int, ground: int, unregistered: int, flights: int) -> None:
    saved_plan(tmp_path / "plan.png", contents(photographs, ground, unregistered, flights))
    assert (pixels_near(tmp_path / "plan.png", VERMILION) > 30) == (ground > 0)
    assert (pixels_near(tmp_path / "plan.png", GREEN) > 30) == (ground > 0)


def test_a_plan_is_in_its_language() -> None:
    figure = plan_figure(contents(photographs=6, unregistered=1, flights=2), language=Language("de"))
    texts = {text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)}
    assert {"Ostwert, m", "Nordwert, m", "nicht orientiert (1)", "Aufnahmen, die das Gelände zeigen"} <= texts
    assert any(text.startswith("Flug 1 (") for text in texts)
    keys = [key.text.get_text() for key in figure.findobj(QuiverKey) if isinstance(key, QuiverKey)]
    assert re.match(r"Abweichung GNSS, [\d,]+ (cm|m|mm) \(× ", keys[0])
    assert not [text for text in texts if re.search(r"\d\.\d|flight|points|residuals", text)]


@pytest.mark.parametrize(
    ("plan", "texts"),
    [
        (contents(12, 6), ["photographs (12)", "control points (3)", "check points (3)"]),
        (contents(12, 0, 2, 2), ["flight 0 (5)", "flight 1 (5)", "not registered (2)"]),
        (contents(90, 0, 0, 9), [*(f"flight {i} (10)" for i in range(5)), "4 more flights (40)"]),
    ],
)
def test_the_legend_counts_what_is_drawn(tmp_path: Path, plan: PlanContents, texts: list[str]) -> None:
    assert legend_of(saved_plan(tmp_path / "plan.png", plan)) == texts


def test_the_scale_of_the_arrows_is_said_and_true(tmp_path: Path) -> None:
    axes = saved_plan(tmp_path / "plan.png", contents(12, 6)).axes[0]
    arrows = [child for child in axes.get_children() if isinstance(child, Quiver)]
    keys = [child for child in axes.get_children() if isinstance(child, QuiverKey)]
    assert len(arrows) == len(keys) == 3
    for quiver, key in zip(arrows, keys, strict=True):
        assert quiver.scale is not None
        assert f"(× {1 / quiver.scale:g})" in key.text.get_text()
        assert length_label(key.U) in key.text.get_text()
    assert np.allclose(arrows[0].U, 0.3)
    assert arrows[0].N == 11, "a photograph without GNSS has no arrow"


def test_few_photographs_are_named_and_many_are_not(tmp_path: Path) -> None:
    few = words_in(saved_plan(tmp_path / "few.png", contents(8, 3)))
    many = words_in(saved_plan(tmp_path / "many.png", contents(MAXIMUM_PHOTOGRAPH_NAMES + 1, 3, 1)))
    assert few.count("DJI_") > 5
    assert "DJI_0000" in many
    assert many.count("DJI_") == 1, "only the one that was left out"
    assert "Δh" in many


def test_photographs_of_another_place_do_not_shrink_the_plan(tmp_path: Path) -> None:
    here = contents(12, 3, 2)
    away = here.photograph_map_m.copy()
    away[0] += [0.0, 30_000.0, 0.0]
    away[1] = np.nan
    places = (("here.png", here), ("away.png", replace(here, photograph_map_m=away)))
    drawn = [saved_plan(tmp_path / name, plan) for name, plan in places]
    limits = [(figure.axes[0].get_xlim(), figure.axes[0].get_ylim()) for figure in drawn]
    assert limits[0] == limits[1]
    assert "1 not registered, outside the plan" in words_in(drawn[1])
    assert "1 not registered, without a position" in words_in(drawn[1])
    assert "not registered" not in words_in(drawn[0])


def test_overlap_has_whole_numbers_and_a_colour_each(tmp_path: Path) -> None:
    shown = contents(8, 0)
    figure = saved_plan(tmp_path / "plan.png", shown)
    bar = figure.axes[1]
    labels = [label.get_text() for label in bar.get_yticklabels()]
    assert labels == ["0", "1", "2", "3", "4", "5", "6–7", "8–9", "10–14", "15–19"]
    (picture,) = figure.axes[0].get_images()
    rgba = np.asarray(picture.get_array())
    assert shown.overlap is not None
    for number, colour in enumerate(FEW):
        cells = rgba[shown.overlap.values == number]
        assert np.allclose(cells, to_rgba(colour), atol=1 / 255)
    assert np.all(rgba[np.isnan(shown.overlap.values)][:, 3] == 0)
    # north is up, and the raster lies where it says
    assert tuple(picture.get_extent()) == (SITE[0], SITE[0] + 60, SITE[1], SITE[1] + 40)
    assert len(saved_plan(tmp_path / "none.png", replace(shown, overlap=None)).axes) == 1


def test_the_whole_ground_is_on_the_plan(tmp_path: Path) -> None:
    shown = contents(3, 0)
    figure = saved_plan(tmp_path / "plan.png", replace(shown, photograph_map_m=np.tile(SITE + 5, (3, 1))))
    (west, east), (south, north) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    assert west < SITE[0]
    assert east > SITE[0] + 60
    assert south < SITE[1]
    assert north > SITE[1] + 40


@pytest.mark.parametrize("most", [0, 1, 5, 10, 11, 14, 15, 37, 250, 1000])
def test_classes_of_overlap_hold_every_number_once(most: int) -> None:
    levels = overlap_levels(most)
    assert levels[0] == 0
    assert levels == sorted(set(levels))
    assert levels[-1] <= most
    assert len(levels) <= 24
    assert levels[: min(most, 6) + 1] == list(range(min(most, 6) + 1))


def test_vectors_are_enlarged_by_a_round_factor() -> None:
    vectors = np.array([[0.03, 0.04, 9.0], [np.nan, np.nan, np.nan], [0.03, 0.04, 0.0]])
    assert enlargement(vectors, 12.0) == 200
    assert enlargement(vectors * 0, 12.0) is None
    assert enlargement(vectors[:0], 12.0) is None
    usual = np.tile([0.05, 0.0, 0.0], (40, 1))
    assert enlargement(np.vstack([usual, [[40.0, 0.0, 0.0]]]), 12.0) == 200, "one wrong fix hides no other"


def test_names_never_cover_each_other_or_a_point() -> None:
    random = np.random.default_rng(2)
    anchors = random.uniform(0.1, 0.9, (40, 2))
    figure = new_figure(5, 4)
    axes = figure.add_subplot()
    placed = place_labels(figure, axes, anchors, [f"point {i}" for i in range(40)], anchors)
    boxes = np.array([text.get_window_extent().extents for text in axes.texts])
    assert 10 < placed == len(boxes) < 40
    points = axes.transData.transform(anchors)
    for i, (west, south, east, north) in enumerate(boxes):
        assert not np.any((points > (west, south)).all(axis=1) & (points < (east, north)).all(axis=1))
        others = np.delete(boxes, i, axis=0)
        assert not np.any((others[:, :2] < (east, north)).all(axis=1) & (others[:, 2:] > (west, south)).all(axis=1))


def test_an_empty_plan_or_comparison_is_a_defect() -> None:
    with pytest.raises(ValueError, match="no registered photograph"):
        plan_figure(contents(0, 0), "plan")
    with pytest.raises(ValueError, match="no comparison"):
        comparison_figure({})


@pytest.mark.parametrize(
    ("length_m", "label"), [(1.0, "1 m"), (0.02, "2 cm"), (500.0, "500 m"), (0.0005, "0.5 mm"), (2000.0, "2 km")]
)
def test_lengths_have_a_unit_that_suits_them(length_m: float, label: str) -> None:
    assert length_label(length_m) == label
