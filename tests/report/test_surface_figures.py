"""Profiles and pictures of a dense surface: where lines run, what is drawn of them, what the captions say."""

import base64
import io
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from photogram.arrays import FloatArray
from photogram.languages.language import Language
from photogram.report.figures.profile_figure import gaps, hillshade, quantiles, sigma_counts
from photogram.report.figures.profiles import ProfileLine, profile, site_lines, step_line, surface_profiles
from photogram.report.figures.surface_figures import (
    DrawnFigure,
    drawn_orthophoto,
    drawn_surface,
    on_plane,
    surface_figures,
    write_surface_pictures,
)
from photogram.report.figures.surface_maps import rays_scale, target_bounds_m, target_shares
from photogram.report.numbers.dense import dense_numbers
from photogram.report.numbers.dense_surface import DenseSurface, GroundMarks, OrthophotoPicture
from photogram.survey import Raster

WEST, NORTH, CELL = 602_300.0, 5_794_200.0, 0.2
HOUSE, ROOF_M = np.array([WEST + 34.0, NORTH - 12.0]), 5.0
TREE, CROWN_M = np.array([WEST + 12.0, NORTH - 22.0]), 9.0
NO_POINTS = GroundMarks((), np.zeros(0, dtype=bool), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=bool))
KEYS = ["orthophoto", "dense surface", "dense sigma", "dense rays", "dense sigma histogram", "dense profiles"]


def ground_m(places_map_m: FloatArray) -> FloatArray:
    return np.asarray(100.0 + (places_map_m[..., :2] - [WEST, NORTH]) @ [0.06, -0.03])


def scene(rows: int = 150, columns: int = 250) -> DenseSurface:
    """A slope with a flat-roofed house askew, a higher tree with a rough crown, and a hole along one easting."""
    row, column = np.mgrid[0:rows, 0:columns]
    centres = np.stack([WEST + (column + 0.5) * CELL, NORTH - (row + 0.5) * CELL], axis=-1)
    heights, random = ground_m(centres), np.random.default_rng(1)
    axis = np.array([np.cos(np.deg2rad(25.0)), np.sin(np.deg2rad(25.0))])
    along, across = (centres - HOUSE) @ axis, (centres - HOUSE) @ np.array([-axis[1], axis[0]])
    house = (np.abs(along) < 5.0) & (np.abs(across) < 3.5)
    heights[house] = ground_m(HOUSE) + ROOF_M
    reach = np.hypot(*(centres - TREE).transpose(2, 0, 1))
    crown = reach < 4.0
    heights[crown] += (
        CROWN_M * np.sqrt(np.maximum(1 - (reach / 4.0) ** 2, 0.0)) + random.normal(0, 0.6, heights.shape)
    )[crown]
    hole = (column >= 100) & (column < 110)
    filled = hole & (row < 40)
    heights[hole & ~filled] = np.nan
    sigma = np.where(hole, np.nan, 0.02 + 0.0001 * row)
    rays = np.where(hole, 0, 2 + column // 50)
    return DenseSurface(
        Raster(heights.astype(np.float32), WEST, NORTH, CELL), Raster(sigma.astype(np.float32), WEST, NORTH, CELL),
        filled, np.where(hole, 0, 1).astype(np.uint8), rays.astype(np.uint8),
        np.where(hole, np.nan, 0.8).astype(np.float32), None, None, ("a.jpg",), {},
    )  # fmt: skip


def marks(*places: tuple[float, float], error_m: float = 0.0) -> GroundMarks:
    """Check points so far east and south of the corner; the last one is control."""
    place = np.array([[WEST + east, NORTH - south, 0.0] for east, south in places])
    place[:, 2] = ground_m(place) - error_m
    checks = np.arange(len(places)) < len(places) - 1
    names, stated = tuple(f"P{i}" for i in range(len(places))), np.zeros(len(places), dtype=bool)
    return GroundMarks(names, checks, place, np.full((len(places), 3), 0.01), stated)


def an_orthophoto() -> OrthophotoPicture:
    rgba = np.zeros((300, 500, 4), dtype=np.uint8)
    tone = np.random.default_rng(2).integers(0, 40, (300, 500, 3)) + np.arange(500)[:, None] // 4
    rgba[..., :3], rgba[..., 3] = tone, np.where(np.arange(500) < 400, 255, 0)
    return OrthophotoPicture(rgba, WEST, NORTH, 0.1, 0.05, (600, 1000), {"area_m2": 1400.0, "transparent": 0.001})


POINTS = marks((5.0, 14.0), (45.0, 16.0), (30.0, 3.0), (25.0, 25.0), error_m=0.03)


@pytest.fixture(scope="module")
def drawn() -> list[DrawnFigure]:
    dense = scene()
    surface = drawn_surface(dense, POINTS, dense_numbers(dense, POINTS), 0.05)
    return [drawn_orthophoto(an_orthophoto(), POINTS), *surface]


def test_captions_say_the_datum_once_where_sigmas_are_without_it() -> None:
    dense = scene()
    numbers = dense_numbers(dense, POINTS)
    captions = {d.key: d.caption for d in drawn_surface(dense, POINTS, numbers, None, 9.7)}
    for key in ("dense sigma", "dense profiles"):
        assert "the datum, ± 9.7 m, is common to all heights and excluded here" in captions[key]
    assert not any("datum, ±" in d.caption for d in drawn_surface(dense, POINTS, numbers))


def texts_of(figure: Figure) -> set[str]:
    return {text.get_text() for text in figure.findobj(Text) if isinstance(text, Text)}


def test_pictures_of_the_client_are_in_the_language_and_the_others_in_english(drawn: list[DrawnFigure]) -> None:
    dense, german = scene(), Language("de")
    made = [drawn_orthophoto(an_orthophoto(), POINTS, german)]
    made += drawn_surface(dense, POINTS, dense_numbers(dense, POINTS), 0.05, None, german)
    own = [figure for figure in surface_figures(made) if figure.language == "de"]
    assert [figure.key for figure in own] == ["orthophoto", "dense surface"]
    for now, before in zip(made, drawn, strict=True):
        assert now.caption == before.caption
        if now.language != german:
            assert [a.get_xlabel() for a in now.figure.axes] == [a.get_xlabel() for a in before.figure.axes]
            assert now.alternative == before.alternative
            continue
        assert {"Ostwert, m", "Nordwert, m", "Prüfpunkte in der Höhe (3)", "Passpunkte in der Höhe (1)"} <= texts_of(
            now.figure
        )
        assert now.alternative != before.alternative
        assert not {text for text in texts_of(now.figure) if re.search(r"\d\.\d|easting|height|points", text)}
    assert {"P0\nΔh +3,0 cm", "Höhe, m (grau: keine Daten)"} <= texts_of(made[1].figure)


def test_on_a_plane_the_labels_are_in_the_language_too() -> None:
    dense = scene()
    relief = drawn_surface(dense, NO_POINTS, dense_numbers(dense, NO_POINTS), language=Language("fr"))[0]
    said = texts_of(on_plane(relief).figure)
    assert {"x, vers la droite dans le plan, m", "en avant du plan, m (gris\u202f: pas de données)"} <= said
    assert "est, m" not in said


# ---- profiles ------------------------------------------------------------------------------------------------------


def test_lines_run_along_and_across_a_site_that_lies_askew() -> None:
    row, column = np.mgrid[0:200, 0:200]
    turn = np.deg2rad(30.0)
    x, y = column - 100.0, 100.0 - row
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    inside = (np.abs(along) < 80) & (np.abs(across) < 30)
    site = Raster(np.where(inside, 1.0, np.nan).astype(np.float32), WEST, NORTH, 1.0)
    first, second = site_lines(site, np.zeros((0, 2)))
    assert (first.letter, second.letter) == ("A", "B")
    np.testing.assert_allclose(first.direction, [np.cos(turn), np.sin(turn)], atol=0.02)
    np.testing.assert_allclose(second.direction, [np.sin(turn), -np.cos(turn)], atol=0.02)
    assert (first.length_m, second.length_m) == pytest.approx((160, 60), abs=4)
    middle = np.array([[WEST + 100.0, NORTH - 100.0]])
    assert abs(first.along_and_across_m(middle)[1][0]) < 2


def test_lines_pass_through_a_check_point_near_the_middle_and_not_through_one_far_off() -> None:
    site = Raster(np.ones((60, 100), dtype=np.float32), WEST, NORTH, 1.0)
    near, far = np.array([[WEST + 80.0, NORTH - 25.0]]), np.array([[WEST + 80.0, NORTH - 4.0]])
    first, _ = site_lines(site, near)
    assert first.along_and_across_m(near)[1] == pytest.approx([0.0], abs=1e-6)
    first, _ = site_lines(site, far)
    assert first.along_and_across_m(np.array([[WEST + 50.0, NORTH - 30.0]]))[1] == pytest.approx([0.0], abs=1e-6)


def test_the_third_profile_crosses_the_house_and_not_the_higher_tree() -> None:
    profiles = surface_profiles(scene(), NO_POINTS)
    assert [p.line.letter for p in profiles] == ["A", "B", "C"]
    edge = profiles[2].line
    along, off = edge.along_and_across_m(np.stack([HOUSE, TREE]))
    assert abs(off[0]) < 5
    assert 0 < along[0] < edge.length_m
    rise = profiles[2].height_m - ground_m(edge.start_map_m + profiles[2].distance_m[:, None] * edge.direction)
    assert np.nanmax(rise) == pytest.approx(ROOF_M, abs=0.6)  # the roof is level, the ground is not


@pytest.mark.parametrize("name", ["a slope", "a slope with noise", "nothing"])
def test_no_step_is_found_where_there_is_none(name: str) -> None:
    row, column = np.mgrid[0:120, 0:160]
    values = 0.8 * column + 0.3 * row + (np.random.default_rng(0).normal(0, 0.05, row.shape) if "noise" in name else 0)
    values = np.full(row.shape, np.nan) if name == "nothing" else values
    if name == "nothing":
        values[0, :3] = 1.0
    assert step_line(Raster(values.astype(np.float32), WEST, NORTH, 0.2), 0.5) is None


def test_profile_holds_heights_gaps_and_the_check_points_beside_it() -> None:
    dense = scene()
    ends = np.array([[WEST + 2.0, NORTH - 14.0], [WEST + 28.0, NORTH - 14.0]])
    found = profile(dense, ProfileLine("A", "", *ends), marks((5.0, 14.1), (8.0, 13.0), (6.0, 14.0), error_m=0.05))
    places = ends[0] + found.distance_m[:, None] * [1.0, 0.0]
    on_ground = np.hypot(*(places - TREE).T) > 8.0
    known = np.isfinite(found.height_m)
    np.testing.assert_allclose(found.height_m[known & on_ground], ground_m(places)[known & on_ground], atol=2e-5)
    ((low, high),) = gaps(found)  # columns 100 to 109, which are 20 to 22 m, and half a cell beside them
    assert (low, high) == pytest.approx((20.0 - 0.1 - 2.0, 22.0 + 0.1 - 2.0), abs=0.21)
    assert found.check_points.name == ("P0",)  # P1 is too far off, P2 is control
    assert found.check_distance_m == pytest.approx([3.0])
    assert found.check_difference_m == pytest.approx([0.05], abs=2e-5)


def test_a_profile_begins_and_ends_where_there_is_a_surface() -> None:
    ends = np.array([[WEST - 6.0, NORTH - 25.0], [WEST + 21.0, NORTH - 25.0]])
    found = profile(scene(), ProfileLine("A", "", *ends), NO_POINTS)
    assert np.isfinite(found.height_m[[0, -1]]).all()
    assert found.line.start_map_m[0] == pytest.approx(WEST + 0.1, abs=0.2)
    assert found.line.length_m == pytest.approx(found.distance_m[-1] - found.distance_m[0])
    assert gaps(found) == []


def test_nothing_to_draw_makes_no_profile() -> None:
    dense = scene()
    empty = replace(dense, heights=replace(dense.heights, values=np.full_like(dense.heights.values, np.nan)))
    assert surface_profiles(empty, NO_POINTS) == []
    figures = drawn_surface(empty, NO_POINTS, dense_numbers(empty, NO_POINTS))
    assert [f.key for f in figures] == ["dense surface"]


# ---- numbers behind the pictures -----------------------------------------------------------------------------------


def test_counted_quantiles_are_those_of_the_cells() -> None:
    dense = scene()
    counts, edges = sigma_counts(dense)
    known = dense.sigma.values[dense.measured()]
    assert counts.sum() == len(known)
    assert counts.sum(axis=1)[2:7] == pytest.approx(np.bincount(dense.rays[dense.measured()], minlength=7)[2:7])
    assert edges[[0, -1]] == pytest.approx([known.min(), known.max()])
    found = quantiles(counts.sum(axis=0), edges, (0.05, 0.5, 0.95))
    # sigma has 150 values, as many as rows: a quantile between two of them is any of these
    np.testing.assert_allclose(found, np.percentile(known, [5, 50, 95]), atol=1.1e-4)
    one_far_off = replace(dense, sigma=replace(dense.sigma, values=dense.sigma.values.copy()))
    one_far_off.sigma.values[0, 0] = 4000.0
    counts, edges = sigma_counts(one_far_off)
    found = quantiles(counts.sum(axis=0), edges, (0.5,))
    np.testing.assert_allclose(found, np.median(known), rtol=0.004)
    assert np.isnan(quantiles(np.zeros(4), np.arange(5.0), (0.5,))).all()


def test_shares_of_the_target_are_those_of_the_cells() -> None:
    dense, target_m = scene(), 0.05
    known = dense.sigma.values[dense.measured()]
    bounds = target_bounds_m(target_m).astype(np.float32)
    assert bounds[[0, -1]].tolist() == [0, np.inf]
    expected = [np.mean((known > low) & (known <= high)) for low, high in pairwise(bounds)]
    np.testing.assert_allclose(target_shares(dense, target_m), expected, atol=1e-12)
    assert sum(expected) == 1


def test_light_comes_from_the_north_west() -> None:
    row, column = np.mgrid[0:20, 0:20]
    towards, away = hillshade(1.0 * (row + column), 1.0), hillshade(-1.0 * (row + column), 1.0)
    assert towards[10, 10] > away[10, 10]
    hole = np.where(column < 3, np.nan, 1.0)
    np.testing.assert_array_equal(np.isnan(hillshade(hole, 1.0)), column < 3)


@pytest.mark.parametrize(("most", "texts"), [(2, ["2"]), (5, ["2", "3", "4", "5"]), (12, None), (60, None)])
def test_every_number_of_photographs_has_one_colour(most: int, texts: list[str] | None) -> None:
    scale, places, labels = rays_scale(most)
    assert len(places) == len(labels)
    assert texts is None or labels == texts
    assert scale.norm(np.array(2)) == 0
    assert labels[-1].split("–")[-1] == str(most)


# ---- pictures ------------------------------------------------------------------------------------------------------


def test_every_figure_has_a_caption_that_says_what_is_seen(drawn: list[DrawnFigure]) -> None:
    assert [d.key for d in drawn] == KEYS
    captions = {d.key: d.caption for d in drawn}
    assert all(d.caption.endswith(".") and d.alternative for d in drawn)
    assert "1000 × 600 cells of 5 cm" in captions["orthophoto"]
    assert "are filled from their neighbours (dsm_filled.tif)" in captions["dense surface"]
    assert "does not include mismatches" in captions["dense sigma"]
    assert "100\u202f% of the measured cells lie within it" in captions["dense sigma"]
    assert "A runs along the site; B runs across the site; C runs over a sharp edge" in captions["dense profiles"]


def test_ground_points_stand_at_their_coordinates_with_their_differences(drawn: list[DrawnFigure]) -> None:
    for key, texts in (("orthophoto", {"P0", "P1", "P2", "P3"}), ("dense surface", {"P0\nΔh +3.0 cm", "P3"})):
        axes = next(d.figure for d in drawn if d.key == key).axes[0]
        assert texts <= {text.get_text() for text in axes.texts}
        places = {line.get_marker(): np.column_stack(line.get_data()) for line in axes.lines}
        np.testing.assert_allclose(places["o"], POINTS.place_map_m[:3, :2])
        np.testing.assert_allclose(places["^"], POINTS.place_map_m[3:, :2])


def test_profiles_are_drawn_with_a_band_of_two_sigma_and_gaps(drawn: list[DrawnFigure]) -> None:
    figure = next(d.figure for d in drawn if d.key == "dense profiles")
    first = surface_profiles(scene(), POINTS)[0]
    line = next(line for line in figure.axes[0].lines if line.get_label() == "surface")
    np.testing.assert_array_equal(line.get_ydata(), first.height_m)
    (band,) = [c for c in figure.axes[0].collections if c.get_label() == "± 2 sigma"]
    assert isinstance(band, PolyCollection)
    assert len(band.get_paths()) == 1 + len(gaps(first))  # the band has the gaps too
    title = figure.axes[0].get_title()
    times = float(title.split("×")[1])
    box, (low, high) = figure.axes[0].get_window_extent(), figure.axes[0].get_ylim()
    assert times == pytest.approx((box.height / (high - low)) / (box.width / first.line.length_m), rel=0.06)


@pytest.mark.filterwarnings("error")
def test_figures_are_the_same_twice_and_photographs_are_held_as_jpeg(tmp_path: Path) -> None:
    made = []
    for name in ("first", "second"):
        drawn = [drawn_orthophoto(an_orthophoto(), POINTS)]
        assert write_surface_pictures(tmp_path / name, drawn) == ["orthophoto.png"]
        made.append(surface_figures(drawn))
    assert made[0] == made[1]
    first, second = ((tmp_path / name / "orthophoto.png").read_bytes() for name in ("first", "second"))
    assert first == second
    svg = base64.b64decode(made[0][0].uri.partition(",")[2], validate=True)
    assert ET.fromstring(svg).tag.endswith("svg")
    found = re.search(rb"data:image/jpeg;base64,([^\"]*)", svg)
    assert found is not None
    with Image.open(io.BytesIO(base64.b64decode(found[1]))) as photograph:
        assert photograph.format == "JPEG"
        rgb = np.asarray(photograph).astype(int)
    assert np.abs(rgb[:, -10:] - 0xD4).max() < 12  # where there is no photograph the ground of the map shows


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("rows", "columns"), [(250, 40), (2, 2)])
def test_sites_of_any_shape_are_drawn_without_a_warning(rows: int, columns: int) -> None:
    dense = scene(rows, columns)
    numbers = dense_numbers(dense, NO_POINTS)
    keys = [d.key for d in drawn_surface(dense, NO_POINTS, numbers)]
    assert keys[:4] == KEYS[1:5]
