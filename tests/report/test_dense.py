"""The dense surface in numbers: means of blocks, heights between cells, counts, and the test at the check points."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from makers import ground_point

from photogram import grid
from photogram.arrays import FloatArray
from photogram.grid import bands, block_means, block_of, decimated
from photogram.report.numbers.dense import (
    dense_numbers,
    orthophoto_check_numbers,
    orthophoto_numbers,
    overlap_on_surface,
    surface_check_numbers,
    water_numbers,
)
from photogram.report.numbers.dense_surface import (
    DenseSurface,
    GroundMarks,
    OrthophotoPicture,
    ground_marks,
    sampled,
)
from photogram.report.record.block import OverlapRecord
from photogram.surface.ortho.marked_targets import LocatedTarget
from photogram.survey import Raster

WEST, NORTH, CELL = 602_300.0, 5_794_200.0, 0.25
SLOPE = np.array([0.08, -0.05])
OVERLAP: OverlapRecord = {
    "median": 3.0, "mean": 3.0, "share_2_or_more": 1.0, "share_3_or_more": 0.5, "area_m2": 1.0, "cell_m": 1.0,
}  # fmt: skip


def plane(places_map_m: FloatArray) -> FloatArray:
    return np.asarray(40.0 + (places_map_m[..., :2] - [WEST, NORTH]) @ SLOPE)


def a_surface(rows: int = 60, columns: int = 90) -> DenseSurface:
    """A plane with a hole, filled cells, and a margin that the photographs hardly see."""
    row, column = np.mgrid[0:rows, 0:columns]
    centres = np.stack([WEST + (column + 0.5) * CELL, NORTH - (row + 0.5) * CELL], axis=-1)
    heights, sigma = plane(centres).astype(np.float32), (0.01 + 0.0005 * column).astype(np.float32)
    hole = (row >= 10) & (row < 16) & (column >= 20) & (column < 30)
    filled = (row >= 40) & (row < 43) & (column >= 50) & (column < 60)
    sigma[hole | filled], heights[hole] = np.nan, np.nan
    rays = np.where(hole | filled, 0, 2 + row // 12).astype(np.uint8)
    confidence = np.where(hole | filled, np.nan, 0.5 + row / 200).astype(np.float32)
    return DenseSurface(
        Raster(heights, WEST, NORTH, CELL), Raster(sigma, WEST, NORTH, CELL), filled,
        np.where(hole | filled, 0, np.where(row < 5, 4, 1)).astype(np.uint8), rays, confidence,
        np.clip(columns - 1 - column, 0, 3).astype(np.uint8), None, ("DJI_0001.JPG", "DJI_0002.JPG"), {"cell_gsd": 2.0},
    )  # fmt: skip


def checks_on_the_plane(errors_m: list[float], sigma_m: float = 0.02, role: str = "check") -> GroundMarks:
    place = np.array([[WEST + 2.1 + 0.9 * i, NORTH - 5.3, 0.0] for i in range(len(errors_m))]).reshape(-1, 3)
    place[:, 2] = plane(place) - errors_m
    return GroundMarks(
        tuple(f"C{i}" for i in range(len(errors_m))), np.full(len(errors_m), role == "check"), place,
        np.full((len(errors_m), 3), sigma_m), np.zeros(len(errors_m), dtype=bool),
    )  # fmt: skip


# ---- means of blocks -----------------------------------------------------------------------------------------------


@given(st.integers(1, 23), st.integers(1, 17), st.integers(1, 9), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_means_of_blocks_hold_the_sum_of_all_cells(rows: int, columns: int, block: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    values = random.normal(0, 3, (rows, columns))
    values[random.random(values.shape) < 0.3] = np.nan
    keep = random.random(values.shape) < 0.8
    means, share = block_means(values, block, keep)
    for i, j in np.ndindex(means.shape):
        part = values[i * block : (i + 1) * block, j * block : (j + 1) * block]
        chosen = part[np.isfinite(part) & keep[i * block : (i + 1) * block, j * block : (j + 1) * block]]
        assert share[i, j] == pytest.approx(chosen.size / part.size)
        assert means[i, j] == pytest.approx(chosen.mean()) if chosen.size else np.isnan(means[i, j])


def test_means_do_not_depend_on_the_bands_they_are_made_in(monkeypatch: pytest.MonkeyPatch) -> None:
    raster = Raster(np.random.default_rng(0).normal(0, 1, (101, 37)).astype(np.float32), WEST, NORTH, CELL)
    whole = decimated(raster, 20)
    monkeypatch.setattr(grid, "BAND_CELLS", 300)
    assert len(list(bands(raster.values.shape, 6))) > 10
    for one, other in zip(whole, decimated(raster, 20), strict=True):
        one, other = (v.values if isinstance(v, Raster) else v for v in (one, other))
        np.testing.assert_array_equal(one, other)
    assert whole[0].values.shape == (17, 7)
    assert (whole[0].west_map_m, whole[0].north_map_m, whole[0].cell_m) == (WEST, NORTH, 6 * CELL)


@pytest.mark.parametrize(("shape", "block"), [((100, 40), 1), ((101, 40), 2), ((40, 300), 3), ((1, 1), 1)])
def test_no_side_of_a_picture_is_longer_than_asked(shape: tuple[int, int], block: int) -> None:
    assert block_of(shape, 100) == block


# ---- heights between cells -----------------------------------------------------------------------------------------


def test_a_plane_is_read_exactly_between_its_cells() -> None:
    dense = a_surface()
    places = np.array([[WEST + 3.07, NORTH - 9.91], [WEST + CELL / 2, NORTH - CELL / 2], [WEST + 20.01, NORTH - 14.8]])
    at = sampled(dense, places)
    np.testing.assert_allclose(at.height_m, plane(places), atol=5e-6)
    np.testing.assert_allclose(at.slope, np.tile(SLOPE, (3, 1)), atol=5e-5)
    np.testing.assert_allclose(at.sigma_m, 0.01 + 0.0005 * ((places[:, 0] - WEST) / CELL - 0.5), atol=1e-7)


@pytest.mark.parametrize(
    ("row", "column", "known", "inside", "filled"),
    [
        (9.4, 25.0, True, True, False),
        (9.6, 25.0, False, True, False),  # below the centres of row 9
        (10.0, 25.0, False, True, False),
        (15.9, 25.0, False, True, False),
        (16.5, 25.0, True, True, False),
        (41.0, 55.0, False, True, True),
        (39.9, 50.0, False, True, True),
        (0.3, 5.0, False, False, False),
        (30.0, 89.7, False, False, False),
    ],
)
def test_nothing_is_read_across_a_hole(row: float, column: float, known: bool, inside: bool, filled: bool) -> None:
    at = sampled(a_surface(), np.array([[WEST + column * CELL, NORTH - row * CELL]]))
    assert bool(np.isfinite(at.height_m[0])) == known
    assert (bool(at.inside[0]), bool(at.filled[0])) == (inside, filled)
    assert np.isnan(at.sigma_m[0]) == np.isnan(at.height_m[0])


def test_heights_and_sigma_must_lie_on_one_grid() -> None:
    dense = a_surface()
    with pytest.raises(ValueError, match="one grid"):
        replace(dense, sigma=replace(dense.sigma, west_map_m=WEST + 1))
    with pytest.raises(ValueError, match="rays"):
        replace(dense, rays=dense.rays[1:])


# ---- what is counted -----------------------------------------------------------------------------------------------


def test_cells_and_areas_of_what_is_mapped_add_up() -> None:
    dense = a_surface()
    numbers = dense_numbers(dense, checks_on_the_plane([]), left_out_m2=12.5)
    cells, areas = numbers["cells"], numbers["areas"]
    # the three columns at the rim have heights, though fewer than three photographs show them
    assert cells == {
        "grid": 5400, "mapped": 5400, "measured": 5400 - 60 - 30, "filled": 30, "water": 0, "interpolated": 60,
        "seen_2_or_more": 5400 - 2 * 60, "seen_3_or_more": 5400 - 3 * 60,
        "measured_of_these": 5400 - 3 * 60 - 60 - 30, "water_of_these": 0,
    }  # fmt: skip
    told = [areas["mapped_m2"], areas["measured_m2"], areas["filled_m2"], areas["water_m2"], areas["interpolated_m2"]]
    assert told == [count * CELL**2 for count in (5400, 5310, 30, 0, 60)]
    assert areas["seen_3_or_more_m2"] == 5220 * CELL**2
    assert areas["left_out_m2"] == 12.5
    assert numbers["completeness"] == pytest.approx(5130 / 5220)
    assert sum(numbers["by_rays"].values()) == cells["measured"]
    assert sum(numbers["by_level"].values()) == cells["measured"]
    assert numbers["by_level"]["4"] == 5 * dense.heights.values.shape[1]
    assert numbers["share_3_or_more"] == pytest.approx(1 - numbers["by_rays"]["2"] / 5310)
    known = dense.sigma.values[dense.measured()]
    sigma, confidence = numbers["sigma_m"], numbers["confidence"]
    assert sigma is not None
    assert sigma["median"] == pytest.approx(np.median(known))
    assert sigma["percentile_95"] == pytest.approx(np.percentile(known, 95), rel=1e-6)
    assert sigma["maximum"] == known.max()
    assert confidence is not None
    assert confidence["minimum"] == pytest.approx(0.5)
    assert numbers["photographs"] == {"used": 2, "names": ["DJI_0001.JPG", "DJI_0002.JPG"]}
    assert json.loads(json.dumps(numbers, allow_nan=False)) == numbers


def test_cells_without_height_that_one_photograph_shows_are_not_mapped() -> None:
    dense = a_surface()
    heights, none = dense.heights.values.copy(), checks_on_the_plane([])
    heights[:, -3:] = np.nan  # seen by 2, 1 and 0
    wet = np.zeros(heights.shape, dtype=bool)
    heights[:5, :5], wet[:5, :5] = np.nan, True
    numbers = dense_numbers(replace(dense, heights=replace(dense.heights, values=heights), water=wet), none)
    cells = numbers["cells"]
    assert (cells["mapped"], cells["water"], cells["interpolated"]) == (5400 - 2 * 60, 25, 60 + 60)
    assert cells["measured"] + cells["filled"] + cells["water"] + cells["interpolated"] == cells["mapped"]
    assert cells["seen_3_or_more"] == 5400 - 3 * 60
    assert cells["water_of_these"] == 25
    assert numbers["completeness"] == pytest.approx((5130 - 25) / (5220 - 25))
    assert water_numbers([], cells)["share"] == 25 / 5280
    on_it = overlap_on_surface(OVERLAP, numbers)
    assert on_it["area_m2"] == 5280 * CELL**2
    assert on_it["share_3_or_more"] == 5220 / 5280


def test_of_two_photographs_at_a_time_nothing_is_said_of_three() -> None:
    dense = replace(a_surface(), settings={"photographs": 2})
    numbers = dense_numbers(dense, checks_on_the_plane([]))
    assert (numbers["completeness"], numbers["areas"]["seen_3_or_more_m2"]) == (None, None)
    assert overlap_on_surface(OVERLAP, numbers) == OVERLAP


def test_filled_cells_count_alike_whether_their_heights_are_given_or_not() -> None:
    dense, none = a_surface(), checks_on_the_plane([])
    heights = np.where(dense.filled, np.nan, dense.heights.values).astype(np.float32)
    without = replace(dense, heights=replace(dense.heights, values=heights))
    assert dense_numbers(dense, none) == dense_numbers(without, none)


def test_a_surface_without_any_height_has_no_statistics() -> None:
    dense = a_surface()
    nothing = replace(dense.heights, values=np.full_like(dense.heights.values, np.nan))
    numbers = dense_numbers(replace(dense, heights=nothing), checks_on_the_plane([0.0] * 4))
    assert numbers["sigma_m"] is None
    assert numbers["completeness"] == 0
    assert numbers["by_level"] == {}
    assert numbers["share_3_or_more"] is None
    assert "predicted, not tested" in numbers["check_points"]["sentence"]


def test_orthophoto_is_told_by_its_own_cells() -> None:
    rgba = np.zeros((10, 20, 4), dtype=np.uint8)
    rgba[:5, :, 3] = 255
    picture = OrthophotoPicture(rgba, WEST, NORTH, 1.0, 0.05, (200, 400), {"area_m2": 101.0, "transparent": 0.002})
    numbers = {"cell_m": 0.05, "rows": 200, "columns": 400, "covered": 0.5}
    assert orthophoto_numbers(picture) == numbers | {"rim": {"area_m2": 101.0, "transparent": 0.002}}


def a_target(east_m: float, north_m: float) -> LocatedTarget:
    return LocatedTarget(np.array([WEST + east_m, NORTH + north_m]), 0.95, 3)


def test_orthophoto_at_check_points() -> None:
    """RMSE in plan with the survey's own sigma, by hand; what was not found is named, and control never enters."""
    points = [ground_point(f"C{i}", "check") for i in range(4)] + [ground_point("G1", "control")]
    for i, point in enumerate(points):
        point["surveyed_map_m"], point["surveyed_sigma_m"] = [WEST + 10.0 * i, NORTH, 40.0], [0.03, 0.04, 0.05]
    found: dict[str, LocatedTarget | str] = {
        "C0": a_target(0.03, 0.0), "C1": a_target(10.0, 0.06), "C2": a_target(19.97, 0.0), "C3": "several places",
        "G1": a_target(49.0, 0.0),
    }  # fmt: skip
    numbers = orthophoto_check_numbers(points, found)
    assert (numbers["n"], [p["name"] for p in numbers["points"]]) == (3, ["C0", "C1", "C2"])
    assert numbers["mean_m"] == pytest.approx([0.0, 0.02], abs=1e-6)
    assert numbers["fit_rmse_h_m"] == pytest.approx(np.sqrt((0.03**2 + 0.06**2 + 0.03**2) / 3), rel=1e-6)
    assert numbers["survey_rmse_h_m"] == pytest.approx(0.05)
    assert numbers["rmse_h_m"] == pytest.approx(np.sqrt(0.0018 + 0.05**2), rel=1e-6)
    assert numbers["not_tested"] == [{"name": "C3", "reason": "several places"}]
    assert "at 3 check points whose targets it shows: RMSE 0.042 m in plan" in numbers["sentence"]
    assert "1 more was not found in it" in numbers["sentence"]


@pytest.mark.parametrize("assumed", [("C0",), ("C0", "C1", "C2")])
def test_an_assumed_accuracy_of_the_survey_is_in_no_figure_of_the_orthophoto(assumed: tuple[str, ...]) -> None:
    points = [ground_point(f"C{i}", "check") for i in range(3)]
    for i, point in enumerate(points):
        point["surveyed_map_m"] = [WEST + 10.0 * i, NORTH, 40.0]
        point["surveyed_sigma_assumed"] = point["name"] in assumed
    numbers = orthophoto_check_numbers(points, {f"C{i}": a_target(10.0 * i + 0.03, 0.0) for i in range(3)})
    assert numbers["fit_rmse_h_m"] == pytest.approx(0.03)
    assert numbers["survey_rmse_h_m"] is numbers["rmse_h_m"] is None


def test_orthophoto_without_found_targets_is_not_tested() -> None:
    points = [ground_point(f"C{i}", "check") for i in range(3)]
    nothing = orthophoto_check_numbers(points, {p["name"]: "no contrast" for p in points})
    assert (nothing["n"], nothing["rmse_h_m"]) == (0, None)
    assert "it is not tested in plan" in nothing["sentence"]
    two = orthophoto_check_numbers(points, {"C0": a_target(0.0, 0.0), "C1": a_target(0.0, 0.0)})
    assert (two["n"], two["rmse_h_m"]) == (2, None)
    assert "too few check points for an RMSE" in two["sentence"]


# ---- at the check points -------------------------------------------------------------------------------------------


def test_a_surface_that_is_too_high_everywhere_has_that_as_mean_and_rmse() -> None:
    found = surface_check_numbers(a_surface(), checks_on_the_plane([0.03] * 5))
    assert found["n"] == 5
    assert (found["mean_m"], found["rmse_m"]) == pytest.approx((0.03, 0.03), abs=1e-5)
    assert found["sd_m"] == pytest.approx(0, abs=1e-5)
    assert found["survey_rmse_m"] is not None
    assert found["rmse_v_m"] == pytest.approx(np.hypot(0.03, found["survey_rmse_m"]), abs=1e-5)


@pytest.mark.parametrize("count", [1, 5])
def test_an_assumed_accuracy_of_the_survey_is_in_no_figure_of_the_surface(count: int) -> None:
    points = replace(checks_on_the_plane([0.03] * 5), sigma_assumed=np.arange(5) < count)
    found = surface_check_numbers(a_surface(), points)
    assert found["rmse_m"] == pytest.approx(0.03, abs=1e-5)
    assert found["survey_rmse_m"] is found["rmse_v_m"] is None
    untested = replace(points, checks_height=np.arange(5) >= count)
    assert (surface_check_numbers(a_surface(), untested)["rmse_v_m"] is None) == (count == 5)


def test_the_survey_in_plan_counts_by_the_slope() -> None:
    (point, *_) = surface_check_numbers(a_surface(), checks_on_the_plane([0.01] * 3, sigma_m=0.02))["points"]
    assert point["survey_sigma_m"] == pytest.approx(0.02 * np.sqrt(1 + SLOPE @ SLOPE), abs=1e-6)
    assert point["sigma_m"] == pytest.approx(0.01 + 0.0005 * (2.1 / CELL - 0.5), abs=1e-6)
    assert point["sigma_m"] is not None
    assert point["survey_sigma_m"] is not None
    assert point["z"] == pytest.approx(0.01 / np.hypot(point["sigma_m"], point["survey_sigma_m"]), rel=1e-3)
    assert point["surface_m"] - point["surveyed_m"] == pytest.approx(point["difference_m"])


def test_normalised_differences_are_1_where_the_prediction_is_right() -> None:
    """600 points that scatter as predicted: the RMS of z is 1 within 4 of its own sigmas, 1 / √(2n)."""
    random, n = np.random.default_rng(4), 600
    place = np.column_stack([random.uniform(WEST + 8, WEST + 21, n), random.uniform(NORTH - 9.5, NORTH - 4.5, n)])
    dense, sigma = a_surface(), np.full((n, 3), [0.0, 0.0, 0.015])
    spread = np.hypot(sampled(dense, place).sigma_m, 0.015)
    surveyed = plane(place) + spread * random.normal(0, 1, n)
    every = np.ones(n, dtype=bool)
    marks = GroundMarks(tuple(map(str, range(n))), every, np.column_stack([place, surveyed]), sigma, ~every)
    found = surface_check_numbers(dense, marks)
    assert found["n"] == n
    assert found["rms_z"] == pytest.approx(1, abs=4 / np.sqrt(2 * n))


def test_control_points_never_enter() -> None:
    dense, marks = a_surface(), checks_on_the_plane([0.01, -0.02, 0.03, 5.0])
    checks = replace(marks, checks_height=np.array([True, True, True, False]))
    assert surface_check_numbers(dense, checks) == surface_check_numbers(dense, marks.select(np.arange(3)))
    none = surface_check_numbers(dense, checks_on_the_plane([0.01] * 4, role="control"))
    assert none["n"] == 0
    assert none["points"] == []
    assert none["not_tested"] == []


@pytest.mark.parametrize(
    ("row", "column", "reason"),
    [(13, 25, "it lies in a hole"), (41.5, 55, "its cells are filled, not measured"), (200, 5, "outside the surface")],
)
def test_points_without_a_measured_height_are_named_with_the_reason(row: float, column: float, reason: str) -> None:
    marks = checks_on_the_plane([0.01] * 4)
    marks.place_map_m[2, :2] = WEST + column * CELL, NORTH - row * CELL
    found = surface_check_numbers(a_surface(), marks)
    assert found["n"] == 3
    (missing,) = found["not_tested"]
    assert missing["name"] == "C2"
    assert reason in missing["reason"]


@pytest.mark.parametrize(("count", "words"), [(0, "predicted, not tested"), (2, "C0 +0.040 m and C1 +0.040 m only")])
def test_too_few_check_points_make_no_rmse(count: int, words: str) -> None:
    found = surface_check_numbers(a_surface(), checks_on_the_plane([0.04] * count))
    assert (found["n"], len(found["points"])) == (count, count)
    assert found["rmse_m"] is found["rmse_v_m"] is found["mean_m"] is found["rms_z"] is None
    assert words in found["sentence"]


def test_refuted_sigmas_are_a_warning_and_right_ones_are_none() -> None:
    dense = a_surface()
    assert dense_numbers(dense, checks_on_the_plane([0.02, -0.02, 0.03]))["warnings"] == []
    (warning,) = dense_numbers(dense, checks_on_the_plane([0.4, -0.2, 0.3]))["warnings"]
    assert "3 check points" in warning


def test_ground_marks_follow_the_role_in_height() -> None:
    point = {"name": "P", "surveyed_map_m": [1.0, 2.0, 3.0], "surveyed_sigma_m": [0.1, 0.1, 0.2]}
    roles = (["control", "control", "check"], ["control"] * 3, ["check"] * 3)
    points: list[Any] = [point | {"axis_roles": role} for role in roles]
    marks = ground_marks(points)
    assert marks.checks_height.tolist() == [True, False, True]
    assert ground_marks([]).place_map_m.shape == (0, 3)
