"""Orthophotos of simulated scenes against renderings of the same scenes from straight above, and exact identities."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial.transform import Rotation

from photogram.arrays import BoolArray, ByteArray, FloatArray
from photogram.camera import Camera, Pose, oriented_by, project_points, rotation_from_gimbal
from photogram.errors import PhotogramError
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.stages import orthophoto as orthophoto_stage
from photogram.pipeline.stages.orthophoto import left_out_reason
from photogram.simulation.rendering import intersect, render, visible
from photogram.simulation.scene import Scene, make_scene, paint_targets, surface_raster
from photogram.surface.ortho.colour_balance import KNEE_DN, WHITE_DN, Balance, highlight_curve
from photogram.surface.ortho.orthophoto import (
    Orthophoto,
    OrthophotoSettings,
    orthophoto_grid,
    plan_orthophoto,
)
from photogram.surface.ortho.seamlines import Seams, rate_blocks, sample_blocks, seams_of
from photogram.surface.ortho.visibility import SeenCells, SurfaceModel, WindowedSurface
from photogram.surface.views import Views
from photogram.survey import Raster

DOWN = np.diag([1.0, -1.0, -1.0])
EAST, NORTH, HEIGHT = 602340.0, 5794120.0, 100.0
FRAME = LocalFrame("EPSG:25832", (EAST, NORTH, HEIGHT), "grid")
WIDTH, DEPTH, FOCAL, ABOVE = 480, 360, 500.0, 30.0
GSD = ABOVE / FOCAL
TARGETS = np.array([[0.0, 0.0], [6.0, 4.0], [-7.0, 4.5], [-4.0, -6.0], [7.0, -5.0]])
NO_PICTURE = np.zeros((0, 0, 3), np.uint8)


def camera() -> Camera:
    middle = np.array([WIDTH / 2 + 2.0, DEPTH / 2 - 3.0])
    return Camera("c", WIDTH, DEPTH, FOCAL, middle, np.array([-0.08, 0.06, -0.01, 0.0]), np.array([4e-4, -3e-4]))


def flown(columns: int, rows: int, seed: int = 1) -> list[Pose]:
    rng = np.random.default_rng(seed)
    poses = []
    for i in range(columns):
        for j in range(rows):
            turn = Rotation.from_euler("xyz", [*rng.normal(0, 2, 2), 180.0 * (i % 2) + rng.normal(0, 3)], degrees=True)
            x, y = (i - (columns - 1) / 2) * 0.3 * WIDTH * GSD, (j - (rows - 1) / 2) * 0.25 * DEPTH * GSD
            poses.append(Pose(DOWN @ turn.as_matrix(), np.array([x, y, ABOVE]) + rng.normal(0, 0.4, 3)))
    return poses


def views_of(cameras: Sequence[Camera], poses: Sequence[Pose]) -> Views:
    number = np.arange(len(poses))
    return Views(number, oriented_by(cameras, number, poses))


def level(half_m: float, cell_m: float = 0.2, height_map_m: float = HEIGHT) -> Raster:
    n = round(2 * half_m / cell_m)
    return Raster(np.full((n, n), height_map_m, np.float32), EAST - half_m, NORTH + half_m, cell_m)


def centred(rows: int, columns: int, cell_m: float = GSD) -> MapGrid:
    return MapGrid(EAST - columns / 2 * cell_m, NORTH + rows / 2 * cell_m, cell_m, rows, columns)


def from_above(scene: Scene, grid: MapGrid, height_m: float = 1e4) -> FloatArray:
    """Render the cells of a grid around the origin from so high that rays are parallel: no noise, no fall of light
    towards the corners, the blur of the photographs (0.45 px), a pixel for a cell."""
    middle = np.array([(grid.columns - 1) / 2, (grid.rows - 1) / 2])
    high = Camera("above", grid.columns, grid.rows, height_m / grid.cell_m, middle)
    return render(scene, high, Pose(DOWN, np.array([0.0, 0.0, height_m])), seed=0, noise_dn=0.0, vignetting=0.0).astype(
        np.float64
    )


def made(plan: Orthophoto, pixels_of: Callable[[int], ByteArray], workers: int = 2, side: int = 512) -> ByteArray:
    whole = np.zeros((plan.grid.rows, plan.grid.columns, 4), np.uint8)
    with ThreadPoolExecutor(workers) as pool:
        for window, rgba in plan.tiles(pixels_of, pool, side):
            whole[window.slices] = rgba
    return whole


def planned(
    views: Views, surface: Raster, pictures: Sequence[ByteArray], grid: MapGrid | None, settings: OrthophotoSettings
) -> Orthophoto:
    with ThreadPoolExecutor(2) as pool:
        return plan_orthophoto(views, FRAME, surface, pictures.__getitem__, pool, settings, grid=grid)


def seams_without_pictures(views: Views, surface: Raster, grid: MapGrid, side_cells: int = 512) -> Seams:
    """Choose a photograph for every block of a grid from the surface alone."""
    terrain = SurfaceModel.under(views, FRAME, WindowedSurface.of(surface))
    with ThreadPoolExecutor(2) as pool:
        lattice = rate_blocks(views, FRAME, terrain, grid, pool, None, side_cells)
    seen = SeenCells(terrain)
    for view in range(len(views)):
        sample_blocks(views, FRAME, terrain, grid, lattice, seen, view, NO_PICTURE)
    return seams_of(lattice, terrain, grid, np.zeros(len(views)))


@dataclass(frozen=True)
class Flat:
    scene: Scene
    views: Views
    pictures: list[ByteArray]


@pytest.fixture(scope="module")
def flat() -> Flat:
    """Level ground, nine photographs with noise of 2 grey levels and light falling towards the corners."""
    bare = make_scene(5, 70.0, 0.1, relief_m=0.0, buildings=0, trees=0, finest_wavelength_m=2 * GSD)
    scene = paint_targets(bare, TARGETS, 0.3)
    poses = flown(3, 3)
    pictures = [render(scene, camera(), pose, seed=n) for n, pose in enumerate(poses)]
    return Flat(scene, views_of([camera()] * 9, poses), pictures)


# ---- identities ----------------------------------------------------------------------------------------------------


def test_a_nadir_photograph_over_a_plane_is_its_own_orthophoto_exactly() -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (61, 83, 3), dtype=np.uint8)
    pinhole = Camera("c", 83, 61, 200.0, np.array([41.0, 30.0]))
    views = views_of([pinhole], [Pose(DOWN, np.array([0.0, 0.0, 20.0]))])
    grid = centred(61, 83, 0.1)
    rgba = made(planned(views, level(10.0), [picture], grid, OrthophotoSettings()), [picture].__getitem__)
    assert np.array_equal(rgba[..., :3], picture)
    assert np.all(rgba[..., 3] == 255)


@pytest.mark.parametrize("cell_m", [0.11, 0.16 / 3.0], ids=["odd", "centres on cell borders"])
def test_what_a_cell_holds_does_not_depend_on_tiles_and_workers(walled: Walled, cell_m: float) -> None:
    views, surface, pictures = walled.views, walled.surface, walled.pictures
    grid = centred(211, 301, cell_m)
    settings = OrthophotoSettings(feather_cells=6.0)
    plan = planned(views, surface, pictures, grid, settings)
    once = made(plan, pictures.__getitem__, 1, 1000)
    assert np.all(once[..., 3] == 255)
    assert len(np.unique(plan.seams.label)) > 2
    for workers, side in ((3, 64), (2, 77)):
        assert np.array_equal(made(plan, pictures.__getitem__, workers, side), once)
    first, again = (seams_without_pictures(views, surface, grid, side) for side in (512, 24))
    for name in ("label", "candidate", "clear", "inside", "looks", "height_map_m"):
        assert np.array_equal(getattr(again, name), getattr(first, name), equal_nan=name == "height_map_m")


def test_slivers_behind_a_ridge_are_closed_and_the_shadow_of_a_wall_is_not(
    walled: Walled, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four photographs from the west; a ridge one cell wide, which the photographs do not show, hides slivers."""
    grid, views = centred(331, 397), views_of([camera()] * 4, walled.poses[:4])

    def transparent(surface: Raster) -> BoolArray:
        plan = planned(views, surface, walled.pictures, grid, OrthophotoSettings(balance=False))
        return np.asarray(made(plan, walled.pictures.__getitem__)[..., 3] == 0)

    heights = walled.surface.values.copy()
    heights[380:420, 460] += np.float32(1.0)
    shadow, ridged = transparent(walled.surface), transparent(replace(walled.surface, values=heights))
    monkeypatch.setattr("photogram.surface.ortho.orthophoto.slivers_of", lambda hidden, _: np.zeros_like(hidden))
    np.testing.assert_array_equal(transparent(walled.surface), shadow)
    bare = transparent(replace(walled.surface, values=heights))
    assert not (ridged & ~bare).any()
    assert np.count_nonzero(bare & ~ridged) > 0.3 * np.count_nonzero(bare & ~shadow) > 100


# ---- level ground against its rendering ----------------------------------------------------------------------------


def shift_px(picture: FloatArray, truth: FloatArray) -> float:
    (x, y), _ = cv2.phaseCorrelate(truth.astype(np.float32), picture.astype(np.float32))
    return float(np.hypot(x, y))


def test_orthophoto_of_level_ground_is_its_rendering_from_straight_above(flat: Flat) -> None:
    grid = centred(301, 353)
    plan = planned(flat.views, level(22.0), flat.pictures, grid, OrthophotoSettings())
    rgba, truth = made(plan, flat.pictures.__getitem__), from_above(flat.scene, grid)
    assert np.all(rgba[..., 3] == 255)
    assert len(np.unique(plan.seams.label)) >= 8
    assert np.sqrt(np.mean((rgba[..., :3] - truth) ** 2)) < 2.6
    for row in (0, 150):
        for column in (0, 176):
            part = (slice(row, row + 150), slice(column, column + 176))
            assert shift_px(rgba[..., 1][part].astype(np.float64), truth[..., 1][part]) < 0.1


def test_targets_lie_at_their_coordinates(flat: Flat) -> None:
    grid = centred(331, 397)
    rgba = made(planned(flat.views, level(22.0), flat.pictures, grid, OrthophotoSettings()), flat.pictures.__getitem__)
    grey = rgba[..., :3].mean(axis=2)
    east, north = grid.centres_map_m(grid.whole)
    x, y = np.meshgrid(east - EAST, north - NORTH)
    for target in TARGETS:
        distance = np.hypot(x - target[0], y - target[1])
        # The dark quarters end within the ring, so that the edge of the window plays no part.
        ring = np.median(grey[(distance > 0.34) & (distance < 0.4)])
        dark = np.where(distance < 0.38, np.clip(0.7 * ring - grey, 0.0, None), 0.0)
        place = np.array([(dark * x).sum(), (dark * y).sum()]) / dark.sum()
        assert np.linalg.norm(place - target) < 0.3 * GSD


def test_cells_larger_than_pixels_hold_the_mean_of_what_they_cover(flat: Flat) -> None:
    grid, fine = centred(60, 70, 4 * GSD), centred(240, 280)
    rgba = made(planned(flat.views, level(22.0), flat.pictures, grid, OrthophotoSettings()), flat.pictures.__getitem__)
    mean = from_above(flat.scene, fine).reshape(60, 4, 70, 4, 3).mean(axis=(1, 3))
    assert np.sqrt(np.mean((rgba[..., :3] - mean) ** 2)) < 1.5


def test_photographs_of_different_exposure_are_balanced(flat: Flat) -> None:
    log_factor = np.random.default_rng(2).normal(0.0, 0.06, (9, 3))
    factor = np.exp(log_factor - log_factor.mean(axis=0))
    pictures = [np.clip(np.rint(p * f), 0, 255).astype(np.uint8) for p, f in zip(flat.pictures, factor, strict=True)]
    grid = centred(301, 353)
    truth = from_above(flat.scene, grid)
    rms = []
    for balance in (True, False):
        plan = planned(flat.views, level(22.0), pictures, grid, OrthophotoSettings(balance=balance))
        rms.append(np.sqrt(np.mean((made(plan, pictures.__getitem__)[..., :3] - truth) ** 2)))
        if balance:
            np.testing.assert_allclose(plan.balance.log_gain.sum(axis=0), 0.0, atol=1e-9)
            np.testing.assert_allclose(plan.balance.log_gain, np.log(factor), atol=0.006)
            # digital numbers go with the root of the light, whose loss is r²/2
            np.testing.assert_allclose(plan.balance.falloff, -0.25, atol=0.04)
        else:
            assert np.all(plan.balance.log_gain == 0.0)
    assert rms[0] < 3.0 < rms[1]


def test_bright_ground_in_a_dark_photograph_is_not_made_white(flat: Flat) -> None:
    """A photograph whose colours are multiplied by 1.5 shows places of 230: they become white, and none darker."""
    plan = planned(flat.views, level(22.0), flat.pictures, centred(301, 353), OrthophotoSettings())
    assert plan.highlights == 0.0
    candidate = np.tile(np.array([3, 1], np.int32), (10, 10, 1))
    grey = np.full((10, 10, 2, 16), 100, np.uint8)
    grey[4:7, 4:7, 0] = 230
    lattice: Any = SimpleNamespace(candidate=candidate, grey=grey)
    log_gain = np.array([0.0, 0.0, 0.0, -np.log(1.5)])
    curve = highlight_curve(lattice, np.full((10, 10), 3, np.int32), log_gain)
    beyond = 230 * 1.5 - KNEE_DN
    assert beyond / (1 + curve * beyond) == pytest.approx(WHITE_DN - KNEE_DN)
    assert highlight_curve(lattice, np.full((10, 10), 1, np.int32), log_gain) == 0.0
    pictures = [np.full_like(picture, 230) for picture in flat.pictures]
    bright = replace(plan, highlights=curve, balance=Balance(np.full((9, 3), -np.log(1.4)), np.zeros((9, 3))))
    shown = made(bright, pictures.__getitem__)[..., :3]
    assert 245 < shown.min() <= shown.max() < 255
    assert np.all(made(replace(bright, highlights=0.0), pictures.__getitem__)[..., :3] == 255)


def test_noise_of_the_surface_hides_nothing(flat: Flat) -> None:
    grid, smooth = centred(301, 353), level(22.0, 2 * GSD)
    noise = np.random.default_rng(3).normal(0.0, 0.6 * GSD, smooth.values.shape).astype(np.float32)
    surfaces = (smooth, replace(smooth, values=smooth.values + noise))
    plain, noisy = (seams_without_pictures(flat.views, surface, grid) for surface in surfaces)
    assert np.mean(plain.clear == noisy.clear) > 0.998
    assert np.mean(plain.label == noisy.label) > 0.95


# ---- what stands in the way ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Walled:
    scene: Scene
    views: Views
    poses: list[Pose]
    surface: Raster
    pictures: list[ByteArray]


@pytest.fixture(scope="module")
def walled() -> Walled:
    """Green ground with a red block of 3 m by 12 m, 6 m high; its pictures are exact at the centres of pixels."""
    bare = make_scene(5, 80.0, 0.1, relief_m=0.0, buildings=0, trees=0)
    x, y = np.meshgrid(np.linspace(-40, 40, 801), np.linspace(-40, 40, 801))
    height = np.where((np.abs(x - 1.0) < 1.5) & (np.abs(y) < 6.0), np.float32(6.0), np.float32(0.0))
    scene = replace(bare, height_m=height)
    poses = flown(3, 4)
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(DEPTH))
    pixel = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    pictures = []
    for pose in poses:
        red = intersect(scene, camera(), pose, pixel)[:, 2] > 0.01
        pictures.append(np.where(red[:, None], [200, 0, 0], [0, 200, 0]).astype(np.uint8).reshape(DEPTH, WIDTH, 3))
    surface = surface_raster(scene, FRAME, 0.1)
    return Walled(scene, views_of([camera()] * len(poses), poses), poses, surface, pictures)


@pytest.mark.parametrize("photographs", [4, 12])
def test_ground_behind_a_wall_never_shows_the_roof(walled: Walled, photographs: int) -> None:
    """Four photographs are all from the west, so that something stays hidden; of twelve one sees every place."""
    grid, poses = centred(331, 397), walled.poses[:photographs]
    views = views_of([camera()] * photographs, poses)
    plan = planned(views, walled.surface, walled.pictures, grid, OrthophotoSettings(balance=False))
    rgba = made(plan, walled.pictures.__getitem__)
    east, north = grid.centres_map_m(grid.whole)
    x, y = np.meshgrid(east - EAST, north - NORTH)
    out = np.maximum(np.abs(x - 1.0) - 1.5, np.abs(y) - 6.0)
    shown = rgba[..., 3] == 255
    # left out at the edge: a cell of the surface, half a pixel of the photograph, the reach of the interpolation
    ground, roof = shown & (out > 0.3), shown & (out < -0.2)
    assert roof.sum() > 8000
    assert np.all(rgba[ground, 0] <= 2)
    assert np.all(rgba[ground, 1] > 195)
    assert np.all(rgba[roof, 0] > 195)
    place = np.column_stack([x.ravel(), y.ravel(), np.where(out.ravel() < 0, 6.0, 0.0)])
    pixels = [project_points(camera(), pose, place) for pose in poses]
    seen = np.any(
        [visible(walled.scene, p, place) & camera().contains(q) for p, q in zip(poses, pixels, strict=True)], 0
    )
    seen = seen.reshape(x.shape)
    surely, never = minimum_filter(seen, 15) & (np.abs(out) > 0.3), maximum_filter(seen, 9)
    assert np.count_nonzero(~never) > (3000 if photographs == 4 else -1)
    assert np.all(shown[surely])
    assert not np.any(shown[~never])


def test_a_seam_goes_around_a_building(walled: Walled) -> None:
    """The building stands between two photographs, where a seam would be on level ground."""
    grid, ground = centred(331, 397), level(40.0, 0.1)
    with_house = replace(ground, values=ground.values.copy())
    with_house.values[386:414, 386:414] += 4.0
    x = -397 / 2 * GSD + (np.arange(50) + 0.5) * 8 * GSD
    y = 331 / 2 * GSD - (np.arange(42) + 0.5) * 8 * GSD
    roof = (np.abs(y)[:, None] < 1.4) & (np.abs(x)[None] < 1.4)
    open_ground, house = (
        seams_without_pictures(walled.views, surface, grid).label[roof] for surface in (ground, with_house)
    )
    assert len(np.unique(open_ground)) > 1
    assert len(np.unique(house)) == 1


def test_where_there_is_no_surface_there_is_no_colour(flat: Flat) -> None:
    surface = level(22.0)
    surface.values[100:130, 90:120] = np.nan
    grid = centred(301, 353)
    rgba = made(planned(flat.views, surface, flat.pictures, grid, OrthophotoSettings()), flat.pictures.__getitem__)
    east, north = grid.centres_map_m(grid.whole)
    row = np.floor((surface.north_map_m - north) / 0.2).astype(int)
    column = np.floor((east - surface.west_map_m) / 0.2).astype(int)
    known = np.isfinite(surface.values[np.ix_(row, column)])
    assert np.array_equal(rgba[..., 3] == 255, known)
    assert np.all(rgba[~known] == 0)


# ---- settings ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong", [{"cell_m": 0.0}, {"cell_m": float("nan")}, {"feather_cells": -1.0}, {"feather_cells": 9.0}]
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(PhotogramError, match=next(iter(wrong))):
        OrthophotoSettings(**wrong)


def test_the_grid_has_the_photographs_ground_sampling_distance(flat: Flat) -> None:
    grid = orthophoto_grid(flat.views, SurfaceModel.under(flat.views, FRAME, WindowedSurface.of(level(22.0))))
    assert grid.cell_m == pytest.approx(GSD, rel=0.02)
    assert (grid.rows * grid.cell_m, grid.columns * grid.cell_m) == pytest.approx((44.0, 44.0), abs=2 * grid.cell_m)


def test_a_surface_above_the_photographs_is_refused(flat: Flat) -> None:
    with pytest.raises(PhotogramError, match="not above the surface"):
        orthophoto_grid(
            flat.views,
            SurfaceModel.under(flat.views, FRAME, WindowedSurface.of(level(22.0, height_map_m=HEIGHT + 50.0))),
        )


def test_a_surface_without_heights_is_refused(flat: Flat) -> None:
    empty = Raster(np.full((50, 50), np.nan, np.float32), EAST - 5.0, NORTH + 5.0, 0.2)
    with pytest.raises(PhotogramError, match=r"no heights: set orthophoto\.enabled to false"):
        planned(flat.views, empty, flat.pictures, None, OrthophotoSettings())


# ---- photographs that look sideways --------------------------------------------------------------------------------


def turned_by(pitch_deg: float, yaw_deg: float = 30.0) -> Pose:
    return Pose(rotation_from_gimbal(yaw_deg, pitch_deg, 0.0), np.zeros(3))


@pytest.mark.parametrize(("pitch_deg", "words"), [(-90.0, ""), (-45.0, ""), (-20.0, "20° below"), (15.0, "15° above")])
def test_photographs_that_look_sideways_make_none(pitch_deg: float, words: str) -> None:
    poses = [turned_by(pitch_deg, 40.0 * i) for i in range(5)] + [turned_by(-90.0), None, turned_by(pitch_deg)]
    reason = left_out_reason(poses)
    assert words in reason
    assert bool(reason) == bool(words)
    assert left_out_reason([None]) == ""


@pytest.mark.usefixtures("undrawn")
def test_the_stage_says_so_everywhere(adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(orthophoto_stage, "LEAST_DEPRESSION_DEG", 91.0)
    assert (adjusted_survey / "results/deliverables/orthophoto.tif").is_file()
    report = run_pipeline(load_project(adjusted_survey / "project.yaml"), start="orthophoto")
    reason = dict(report["orthophoto"])["left_out"]
    assert isinstance(reason, str)
    assert reason.startswith("the photographs are oblique (median optical axis 8")
    assert not (adjusted_survey / "results/deliverables/orthophoto.tif").exists()
    assert f"No orthophoto: {reason}." in (adjusted_survey / "results/deliverables/report.html").read_text(
        encoding="utf-8"
    )
    assert json.loads((adjusted_survey / "work/orthophoto.stage/stage.json").read_text())["left_out"] == reason
