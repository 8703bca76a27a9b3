"""Orthophotos of simulated surveys against the true one: time, what is transparent, seams, errors in plan.

    python benchmarks/orthophoto.py [--seeds 1,2,3] [--width 1200] [--repeat 1] [--threads 2] [--keep FOLDER]
    python benchmarks/orthophoto.py --project PROJECT [--repeat 1]

Simulated: the 24 photographs, 80/70, of simulation.whole_survey_plan over buildings and trees, with true poses, each
brightened or darkened at random (4 %). The surface is what dense matching leaves of the true one (cells of 2 GSD):
noise of half a GSD times 1.5; in crowns two thirds of the cells are missing, in lumps, and the rest scatters by 0.3 m;
two cells along walls are missing. What follows is that of the stage: closed surface, seams, balance, tiles, rim, file.

`s/Mpx`: processor time of all threads over the pixels within the rim; the parts of it beside. `transparent`: pixels
within the rim, in %; `hidden`: of these, those that the true scene hides from all photographs that show them.
`seams`: mean difference of the two balanced photographs along the seams, in grey levels, and along straight ones
(Voronoi: every block from the photograph nearest in plan). The truth is the scene rendered from straight above:
`shift`: median length, in pixels, of what parts of 64 × 64 pixels on open ground are shifted by against it (phase
correlation), and its 95 % quantile; `rms`: of the colours on open ground, in grey levels.

PROJECT has a surface already; its orthophoto is made into a folder that is removed again, and only time, size, and the
transparent pixels are told. Nothing in PROJECT is changed.
"""

import argparse
import resource
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import binary_dilation

from photogram.arrays import BoolArray, ByteArray, Float32Array, FloatArray, Int32Array
from photogram.camera import Camera, Pose, oriented_by, project_points
from photogram.files.maps.cogs import write_cog_rgba
from photogram.grid import MapGrid, Window
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.orthophoto import make_orthophoto
from photogram.simulation.rendering import render, visible
from photogram.simulation.scene import Material, surface_raster
from photogram.simulation.simulated_survey import SimulatedSurvey, render_photographs, simulate, whole_survey_plan
from photogram.surface.dsm import filled_heights
from photogram.surface.dtm import ground_between
from photogram.surface.ortho.closed_surface import close_surface
from photogram.surface.ortho.orthophoto import Orthophoto, OrthophotoSettings, plan_orthophoto
from photogram.surface.ortho.outline import cells_inside, rim_of, sides_of
from photogram.surface.ortho.seamlines import rate_blocks, sample_blocks
from photogram.surface.ortho.visibility import SeenCells, WindowedSurface
from photogram.surface.views import Views
from photogram.survey import Raster

Pictures = list[ByteArray]

SURFACE_GSD, FILL_CELLS = 2.0, 25
NOISE_GSD, CROWN_NOISE_M, CROWN_MISSING = 0.75, 0.3, 0.67
PART_PX, ABOVE_M = 64, 1e4
HEADINGS = (
    f"{'seed':>4}{'Mpx':>7}{'s/Mpx':>7}{'surface':>9}{'seams':>7}{'tiles':>7}{'file':>6}{'MB':>6}"
    f"{'transparent':>13}{'hidden':>8}{'seams DN':>10}{'straight':>10}{'shift px':>10}{'95 %':>6}{'rms DN':>8}"
)


def processor_s() -> float:
    """Return the processor time of all threads of this process so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def matched_surface(survey: SimulatedSurvey) -> tuple[Raster, Float32Array]:
    """Return what dense matching leaves of the true surface, NaN where it finds nothing, and standard deviations."""
    gsd, rng = survey.plan.gsd_m, np.random.default_rng([survey.seed, 18])
    truth = surface_raster(survey.scene, survey.frame, SURFACE_GSD * gsd)
    material = material_of(survey, MapGrid.of(truth))
    crowns, roofs = material == Material.TREE, material >= Material.ROOF_TILES
    walls = binary_dilation(roofs, iterations=2) & binary_dilation(~roofs, iterations=2)
    noise = np.where(crowns, CROWN_NOISE_M, NOISE_GSD * gsd)
    values = truth.values + noise * rng.standard_normal(truth.values.shape)
    lumps = cv2.resize(rng.random((values.shape[0] // 8 + 1, values.shape[1] // 8 + 1)), values.shape[::-1])
    values[(crowns & (lumps < np.quantile(lumps, CROWN_MISSING))) | walls] = np.nan
    flown = survey.frame.map_from_world(np.array([pose.position_world_m for pose in survey.truth.poses]))
    half_m = 0.5 * survey.plan.height_px * gsd
    grid = MapGrid.of(truth)
    north_m, west_m = grid.north_map_m - flown[:, 1].max() - half_m, flown[:, 0].min() - half_m - grid.west_map_m
    tall, wide = np.ptp(flown[:, :2], axis=0)[::-1] + 2.0 * half_m
    row = np.clip(np.array([north_m, north_m + tall]) / grid.cell_m, 0, grid.rows).astype(int)
    column = np.clip(np.array([west_m, west_m + wide]) / grid.cell_m, 0, grid.columns).astype(int)
    at = (slice(row[0], row[1]), slice(column[0], column[1]))
    west, north = grid.west_map_m + column[0] * grid.cell_m, grid.north_map_m - row[0] * grid.cell_m
    raster = Raster(np.ascontiguousarray(values[at], np.float32), float(west), float(north), grid.cell_m)
    return raster, np.ascontiguousarray(noise[at], np.float32)


def material_of(survey: SimulatedSurvey, grid: MapGrid) -> ByteArray:
    """Return the material (rows, columns) of the scene at the cells of a grid."""
    scene = survey.scene
    east, north = grid.centres_map_m(grid.whole)
    level = np.full(grid.rows * grid.columns, survey.frame.origin_map_m[2])
    place = np.column_stack([np.tile(east, grid.rows), np.repeat(north, grid.columns), level])
    vertex = np.rint((survey.frame.world_from_map(place)[:, :2] - [scene.west_m, scene.south_m]) / scene.cell_m)
    column, row = np.clip(vertex.astype(int), 0, np.array(scene.material.shape[::-1]) - 1).T
    return np.asarray(scene.material[row, column].reshape(grid.rows, grid.columns))


@dataclass(frozen=True, eq=False)
class Made:
    """An orthophoto, what is within its rim, and the processor time of the parts: surface, seams, tiles, file."""

    plan: Orthophoto
    rgba: ByteArray
    inside: BoolArray
    seconds: tuple[float, float, float, float]


def made(views: Views, survey: SimulatedSurvey, pictures: Pictures, threads: int, folder: Path) -> Made:
    """Make the orthophoto of a survey as the stage does."""
    raster, sigma = matched_surface(survey)
    grid = MapGrid.of(raster)
    marks = [processor_s()]
    with ThreadPoolExecutor(threads) as pool:
        filled, measured = filled_heights(raster.values, grid.cell_m, FILL_CELLS), np.isfinite(raster.values)
        height, spread = np.empty_like(raster.values), np.empty_like(raster.values)

        def part(window: Window) -> tuple[Float32Array, BoolArray, Float32Array]:
            known = measured[window.slices]
            return filled[window.slices], known, np.where(known, sigma[window.slices], np.float32(np.nan))

        def write(window: Window, values: Float32Array, sigmas: Float32Array) -> None:
            height[window.slices], spread[window.slices] = values, sigmas

        close_surface(grid, part, pool, write, ground_between(grid, lambda of: part(of)[::2]))
        marks.append(processor_s())
        surface = WindowedSurface.of(grid.raster(height), spread)
        plan = plan_orthophoto(
            views, survey.frame, surface, pictures.__getitem__, pool, OrthophotoSettings(cell_m=survey.plan.gsd_m)
        )
        marks.append(processor_s())
        rim = rim_of(plan.seams.looks, plan.seams.label >= 0, plan.blocks)
        sides = sides_of(rim)
        rgba = np.zeros((plan.grid.rows, plan.grid.columns, 4), np.uint8)
        for window, tile in plan.tiles(pictures.__getitem__, pool):
            tile[~cells_inside(sides, plan.grid, window)] = 0
            rgba[window.slices] = tile
    marks.append(processor_s())
    tiles = ((window, rgba[window.slices]) for window in plan.grid.tiles(512))
    write_cog_rgba(folder / "orthophoto.tif", plan.grid, survey.plan.crs, tiles)
    marks.append(processor_s())
    inside = cells_inside(sides, plan.grid, plan.grid.whole)
    surface_s, seams_s, tiles_s, file_s = np.diff(marks).tolist()
    return Made(plan, rgba, inside, (surface_s, seams_s, tiles_s, file_s))


def world_of(survey: SimulatedSurvey, place_map_m: FloatArray) -> FloatArray:
    """Return the places (N, 3) of the true surface, world, at places (N, 2) of the map."""
    level = np.full(len(place_map_m), survey.frame.origin_map_m[2])
    foot = survey.frame.world_from_map(np.column_stack([place_map_m, level]))
    up = (survey.frame.world_from_map(np.column_stack([place_map_m, level + 100.0])) - foot) / 100.0
    above = np.zeros(len(foot))
    for _ in range(3):
        above = (survey.scene.height((foot + above[:, None] * up)[:, :2]) - foot[:, 2]) / up[:, 2]
    return np.asarray(foot + above[:, None] * up)


def truly_hidden(survey: SimulatedSurvey, grid: MapGrid, cells: BoolArray) -> float:
    """Return which share of some cells the scene hides from all photographs that show them."""
    row, column = (a[:: max(len(a) // 20_000, 1)] for a in np.nonzero(cells))
    east, north = grid.centres_map_m(grid.whole)
    world = world_of(survey, np.column_stack([east[column], north[row]]))
    seen, camera = np.zeros(len(world), bool), survey.truth.camera
    for pose in survey.truth.poses:
        shown = camera.contains(project_points(camera, pose, world))
        seen[shown] |= visible(survey.scene, pose, world[shown], tolerance_m=0.02)
    return float(np.mean(~seen)) if len(seen) else float("nan")


def from_above(survey: SimulatedSurvey, grid: MapGrid) -> Float32Array:
    """Return the true colours (rows, columns, 3) of the cells of a grid: no noise, the blur of the photographs."""
    east, north = grid.centres_map_m(grid.whole)
    truth = np.empty((grid.rows, grid.columns, 3), np.float32)
    side = max(grid.rows, grid.columns) + 64
    high = Camera("above", side, side, ABOVE_M / grid.cell_m, np.full(2, (side - 1) / 2.0))
    middle = survey.frame.world_from_map(np.array([[east.mean(), north.mean(), survey.frame.origin_map_m[2]]]))[0]
    pose = Pose(np.diag([1.0, -1.0, -1.0]), middle + np.array([0.0, 0.0, ABOVE_M]))
    picture = render(survey.scene, high, pose, seed=0, noise_dn=0.0, vignetting=0.0)
    for window in grid.tiles(512):
        columns, rows = np.meshgrid(east[window.slices[1]], north[window.slices[0]])
        pixel = project_points(high, pose, world_of(survey, np.column_stack([columns.ravel(), rows.ravel()])))
        u, v = pixel.astype(np.float32).T.reshape(2, *window.shape)
        truth[window.slices] = cv2.remap(picture, u, v, cv2.INTER_CUBIC)
    return truth


def seam_differences(
    survey: SimulatedSurvey, views: Views, plan: Orthophoto, pictures: Pictures
) -> tuple[float, float]:
    """Return the mean difference, in grey levels, of the photographs along the seams, and along straight ones."""
    seen = SeenCells(plan.terrain)
    with ThreadPoolExecutor(1) as pool:
        lattice = rate_blocks(views, survey.frame, plan.terrain, plan.grid, pool)
        for view in range(len(views)):
            sample_blocks(views, survey.frame, plan.terrain, plan.grid, lattice, seen, view, pictures[view])
    gain = np.exp(-plan.balance.log_gain.mean(axis=1))
    grey = np.where(lattice.grey > 0, lattice.grey * gain[lattice.candidate][..., None], np.nan)
    blocks = plan.blocks
    east, north = blocks.centres_map_m(blocks.whole)
    place = np.stack(np.meshgrid(east, north), axis=-1)
    away = np.linalg.norm(plan.terrain.position_map_m[lattice.candidate][..., :2] - place[:, :, None], axis=-1)
    away[(lattice.candidate < 0) | ~lattice.inside] = np.inf
    nearest = np.take_along_axis(lattice.candidate, np.argmin(away, axis=2)[..., None], axis=2)[..., 0]
    known = np.isfinite(away).any(axis=2) & (plan.seams.label >= 0)
    return _along(plan.seams.label, lattice.candidate, grey, known), _along(nearest, lattice.candidate, grey, known)


def _along(label: Int32Array, candidate: Int32Array, grey: FloatArray, known: BoolArray) -> float:
    """Return the mean difference, over the blocks on both sides of each seam, of the photographs on its sides."""
    found = []
    for axis in (0, 1):
        first, second = (
            (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1)),
            (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None)),
        )
        p, q = label[first], label[second]
        seam = (p != q) & known[first] & known[second]
        for at in (first, second):
            lists, values = candidate[at][seam], grey[at][seam]
            a, b = (
                np.where((lists == n[seam][:, None])[..., None], values, np.nan) for n in (p, q)
            )  # fmt: skip
            apart = np.abs(np.fmax.reduce(a, axis=1) - np.fmax.reduce(b, axis=1))
            found.append(apart[np.isfinite(apart)])
    return float(np.mean(np.concatenate(found)))


def errors(survey: SimulatedSurvey, made_one: Made) -> tuple[float, float, float]:
    """Return the median and the 95 % quantile of what parts of the orthophoto are shifted by, in pixels, and the root
    mean square difference of colours, in grey levels, on open ground."""
    grid, rgba = made_one.plan.grid, made_one.rgba
    truth = from_above(survey, grid)
    built = binary_dilation(material_of(survey, grid) >= Material.TREE, iterations=8)
    open_ground = (rgba[..., 3] > 0) & ~built
    difference = (rgba[..., :3].astype(np.float32) - truth)[open_ground]
    shifts, window = [], cv2.createHanningWindow((PART_PX, PART_PX), cv2.CV_32F)
    for part in grid.tiles(PART_PX):
        if part.shape == (PART_PX, PART_PX) and open_ground[part.slices].mean() > 0.95:
            pair = [np.ascontiguousarray(a[part.slices][..., 1], np.float32) for a in (truth, rgba)]
            (x, y), _ = cv2.phaseCorrelate(pair[0], pair[1], window)
            shifts.append(float(np.hypot(x, y)))
    median, most = np.quantile(shifts, [0.5, 0.95]).tolist() if shifts else (float("nan"), float("nan"))
    return median, most, float(np.sqrt(np.mean(difference**2)))


def run_simulated(seed: int, width_px: int, threads: int, repeat: int, keep: Path | None) -> str:
    """Return the line of one simulated survey."""
    survey = simulate(whole_survey_plan(width_px), seed)
    rng = np.random.default_rng([seed, 81])
    pictures = []
    for _, picture in render_photographs(survey):
        factor = np.exp(rng.normal(0.0, 0.04, 3))
        pictures.append(np.clip(np.rint(picture * factor), 0, 255).astype(np.uint8))
    number = np.arange(len(pictures))
    views = Views(number, oriented_by([survey.truth.camera], np.zeros(len(number), int), survey.truth.poses))
    with tempfile.TemporaryDirectory() as name:
        folder = keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        runs = [made(views, survey, pictures, threads, folder) for _ in range(repeat + 1)][1:]  # the first compiles
    best = min(runs, key=lambda one: sum(one.seconds))
    holes = best.inside & (best.rgba[..., 3] == 0)
    mpx = np.count_nonzero(best.inside) / 1e6
    own, straight = seam_differences(survey, views, best.plan, pictures)
    shift, most, rms = errors(survey, best)
    parts = [s / mpx for s in best.seconds]
    hidden = truly_hidden(survey, best.plan.grid, holes)
    return (
        f"{seed:>4}{mpx:>7.2f}{sum(parts):>7.2f}{parts[0]:>9.2f}{parts[1]:>7.2f}{parts[2]:>7.2f}{parts[3]:>6.2f}"
        f"{peak_mib():>6.0f}{holes.sum() / best.inside.sum():>13.3%}"
        f"{hidden:>8.0%}{own:>10.2f}{straight:>10.2f}{shift:>10.3f}{most:>6.2f}{rms:>8.2f}"
    )


def run_project(path: Path, repeat: int) -> None:
    """Print the time and the transparent pixels of a project's orthophoto."""
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as name, open_run(load_project(path)) as run:
            began = processor_s()
            found = make_orthophoto(run, Path(name), lambda *_: None)
            seconds, rim = processor_s() - began, found["cells"] + found["transparent"]
            print(
                f"{rim / 1e6:.2f} Mpx within the rim, {found['transparent'] / rim:.3%} transparent, {seconds:.1f} s of "
                f"processor time, {seconds / rim * 1e6:.2f} s per Mpx, peak {peak_mib():.0f} MiB"
            )


def peak_mib() -> float:
    """Return the most memory that this process held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1,2,3")
    parser.add_argument("--width", type=int, default=1200)
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--project", type=Path)
    given = parser.parse_args()
    if given.project is not None:
        run_project(given.project, given.repeat)
        return
    print(HEADINGS)
    for seed in map(int, given.seeds.split(",")):
        print(run_simulated(seed, given.width, given.threads, given.repeat, given.keep), flush=True)


if __name__ == "__main__":
    main()
