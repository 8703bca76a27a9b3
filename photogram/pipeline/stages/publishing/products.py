"""Surface, orthophoto and dense cloud as they are handed over, and what the report shows of them."""

import shutil
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from datetime import date, datetime
from pathlib import Path
from threading import Event

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.files.atomic import replacing
from photogram.files.clouds.dense_points import (
    CHUNK_CELLS,
    GROUND,
    NEVER_CLASSIFIED,
    NOT_GROUND,
    DensePoints,
    points_of_cells,
    write_dense_laz,
)
from photogram.files.clouds.points import NO_DATE
from photogram.files.maps.cogs import CATEGORY_SUFFIX
from photogram.files.maps.rasters import picture_on_grid, read_codes
from photogram.files.npz_json import read_json
from photogram.grid import MapGrid, Window
from photogram.languages.language import Language
from photogram.machine import cores
from photogram.pipeline.stages.dense import DenseSummary
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.orthophoto import RIM_FILE
from photogram.pipeline.stages.stored_surface import StoredSurface, reason_left_out
from photogram.pipeline.stages.surface_frame import SurfaceFrame, made_frame, plane_record
from photogram.pipeline.stages.surfaces.surface import WATER_FILE, matched, surface_layers
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.tiles import BlockFiles
from photogram.project.measured.measured_block import PhotographNote
from photogram.report.figures.page_figures import PageFigure
from photogram.report.figures.surface_figures import (
    DrawnFigure,
    drawn_orthophoto,
    drawn_surface,
    on_plane,
    surface_figures,
    write_surface_pictures,
)
from photogram.report.figures.thumbnails import thumbnails
from photogram.report.numbers.dense import (
    checks_plan,
    dense_numbers,
    orthophoto_check_numbers,
    orthophoto_numbers,
    sigma_numbers,
    water_numbers,
)
from photogram.report.numbers.dense_surface import DenseSurface, OrthophotoPicture, ground_marks
from photogram.report.record.ground import GroundPointRecord
from photogram.report.record.surfaces import DenseRecord, NoOrthophotoRecord, OrthophotoRecord, PlaneRecord
from photogram.result_files import PICTURES, within_results
from photogram.surface.dsm import FILLED, INTERPOLATED, MEASURED, WATER, measured_in
from photogram.surface.ortho.marked_targets import (
    GreyImage,
    LocatedTarget,
    Mark,
    find_target,
    mark_neighbourhood,
    target_window_cells,
)

CLOUD = "dense.laz"
MAXIMUM_PICTURE_PX = 1800
"""Longer side of the orthophoto on the page, at most."""

DROWNS = 3.0
"""A datum known so many times worse in height than the shape hides it: figures then show the relative sigma."""

CHUNKS_AHEAD = 2
"""Parts of the dense cloud that wait to be written, for each thread that makes them."""


def copy_products(run: Run, results: Path) -> list[str]:
    """Copy what the stages of surfaces have made into the folder of results; returns the names."""
    names = []
    for stage in BEFORE_RESULTS:
        # what the keys of a GeoTIFF cannot hold stands beside it
        companions = [name + CATEGORY_SUFFIX for name in stage.products if name.endswith(".tif")]
        for name in dict.fromkeys((*stage.products, *companions)):
            if run.workspace.has(stage.name, name):
                made = run.workspace.file(stage.name, name)
                names.append(within_results(name))
                with replacing(results / names[-1]) as partial:
                    shutil.copyfile(made, partial)
    return names


def flight_date(notes: Sequence[PhotographNote], poses: Sequence[Pose | None]) -> date:
    """Return the day of the last exposure with a pose whose time the tags give, in their notes, NO_DATE where none
    does: the date of the clouds."""
    times = [note["time"] for note, pose in zip(notes, poses, strict=True) if pose is not None]
    return max((datetime.fromisoformat(time).date() for time in times if time is not None), default=NO_DATE)


def write_dense_cloud(run: Run, path: Path, ended: Event) -> bool:
    """Write a point for every measured cell of the dense surface that the orthophoto shows, in its colour; for every
    one, without colours, where there is no orthophoto; no file where nothing was matched. Returns whether it was
    written. Raises CancelledError, and leaves no file, once the work beside which it is written has ``ended``."""
    if not matched(run):
        return False
    layers, created = surface_layers(run), flight_date(run.notes(), made_frame(run).block().poses)
    site = made_frame(run)
    coloured = run.workspace.has("orthophoto", "orthophoto.tif")
    picture = run.workspace.file("orthophoto", "orthophoto.tif") if coloured else None
    chunks = _chunks(run, site, layers, picture, ended)
    origin_map_m = None if site.plane is None else site.map_m(np.zeros((1, 3)))[0]
    write_dense_laz(
        path,
        layers.grid,
        run.project.product_crs,
        chunks,
        created,
        coloured=coloured,
        plane_origin_map_m=origin_map_m,
    )
    return True


def _chunks(
    run: Run, site: SurfaceFrame, layers: BlockFiles, picture: Path | None, ended: Event
) -> Iterator[DensePoints]:
    classified = run.workspace.has("relief", "dtm_source.tif")
    terrain = run.workspace.file("relief", "dtm_source.tif") if classified else None

    def chunk(window: Window) -> DensePoints:
        height, sigma, confidence, rays, source = layers.read(window, "height", "sigma", "confidence", "rays", "source")
        colour = np.zeros((*window.shape, 3), np.uint8)
        if picture is not None:
            rgba = picture_on_grid(picture, layers.grid, window)
            # over the finished surface no photograph sees it: its height and its visibility contradict each other
            colour, height = rgba[..., :3], np.where(rgba[..., 3] > 0, height, np.float32(np.nan))
        classes = np.full(window.shape, NEVER_CLASSIFIED, np.uint8)
        if terrain is not None:
            classes = np.where(read_codes(terrain, window) == MEASURED, GROUND, NOT_GROUND).astype(np.uint8)
        points = points_of_cells(
            layers.grid, window, height, colour, sigma, confidence, rays, measured_in(source), classes
        )
        return replace(points, position_map_m=site.map_m(points.position_map_m))

    with ThreadPoolExecutor(cores()) as workers:
        ahead = deque[Future[DensePoints]]()
        for window in layers.grid.tiles(CHUNK_CELLS):
            if ended.is_set():
                raise CancelledError
            ahead.append(workers.submit(chunk, window))
            if len(ahead) > CHUNKS_AHEAD * cores():
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()


def orthophoto_picture(run: Run) -> OrthophotoPicture | None:
    """Return the orthophoto small enough for a page, None where there is none."""
    if not run.workspace.has("orthophoto", "orthophoto.tif"):
        return None
    path = run.workspace.file("orthophoto", "orthophoto.tif")
    whole = MapGrid(**read_json(run.workspace.file("orthophoto", "grid.json")))
    block = -(-max(whole.rows, whole.columns) // MAXIMUM_PICTURE_PX)
    rows, columns = -(-whole.rows // block), -(-whole.columns // block)
    grid = MapGrid(whole.west_map_m, whole.north_map_m, whole.cell_m * block, rows, columns)
    rgba = picture_on_grid(path, grid, grid.whole)
    rim = read_json(run.workspace.file("orthophoto", RIM_FILE))
    return OrthophotoPicture(
        rgba, grid.west_map_m, grid.north_map_m, grid.cell_m, whole.cell_m, (whole.rows, whole.columns),
        {"area_m2": rim["area_m2"], "transparent": rim["transparent"] / max(rim["cells"], 1)},
    )  # fmt: skip


def dense_surface(run: Run, surface: StoredSurface) -> DenseSurface | None:
    """Return the dense surface as the report takes it, None where nothing was matched."""
    if not matched(run):
        return None
    layers = surface_layers(run)
    rays, confidence, seen = layers.read(layers.grid.whole, "rays", "confidence", "seen")
    source = read_codes(run.workspace.file("surface", "dsm_source.tif"), layers.grid.whole)
    names = tuple(
        p.name
        for p, pose in zip(run.project.photographs, made_frame(run).block().poses, strict=True)
        if pose is not None
    )
    return DenseSurface(
        surface.heights(), surface.sigma(), source == FILLED, measured_in(source), rays, confidence,
        seen, source == WATER, names, {k: v for k, v in asdict(run.project.dense).items() if k != "enabled"},
        source == INTERPOLATED,
    )  # fmt: skip


MARKS_LOOKED_UP = 3
"""Photographs in which the neighbourhood of a target is looked up, at most: those nearest above it."""


def targets_in_orthophoto(
    run: Run, site: SurfaceFrame, points: Sequence[GroundPointRecord]
) -> dict[str, LocatedTarget | str]:
    """Return where the orthophoto shows the targets of ground points, whose places are those of the frame ``site``, by
    name, or why one was not found."""
    path = run.workspace.file("orthophoto", "orthophoto.tif")
    whole = MapGrid(**read_json(run.workspace.file("orthophoto", "grid.json")))
    block = site.block()
    ground, half = block.control_points, target_window_cells() // 2
    centres, of_photograph = dict[str, FloatArray](), dict[int, list[tuple[str, FloatArray]]]()
    for point in points:
        if point["adjusted_map_m"] is None:
            continue
        east, north, height_m = point["adjusted_map_m"]
        column = np.floor((east - whole.west_map_m) / whole.cell_m) + 0.5
        row = np.floor((whole.north_map_m - north) / whole.cell_m) + 0.5
        centre = np.array([whole.west_map_m + column * whole.cell_m, whole.north_map_m - row * whole.cell_m, height_m])
        centres[point["name"]] = centre
        marks = (ground.mark_point == ground.name.index(point["name"])) & np.isfinite(ground.mark_sigma_px)
        above = block.frame.world_from_map(centre[None])[0]
        seen = [
            (float(np.linalg.norm((pose.position_world_m - above)[:2])), int(i), ground.mark_pixel[m])
            for m, i in zip(np.flatnonzero(marks), ground.mark_photograph[marks], strict=True)
            if (pose := block.poses[i]) is not None
        ]
        for _, i, pixel in sorted(seen, key=lambda mark: mark[:2])[:MARKS_LOOKED_UP]:
            of_photograph.setdefault(i, []).append((point["name"], pixel))
    templates: dict[str, list[GreyImage]] = {name: [] for name in centres}
    for i, own in sorted(of_photograph.items()):
        grey, camera, pose = run.grey(i), block.cameras[block.photographs[i].camera], block.poses[i]
        assert pose is not None
        for name, pixel in own:
            mark = Mark(grey, camera, pose, pixel)
            template = mark_neighbourhood(mark, centres[name], whole.cell_m, block.frame)
            if template is not None:
                templates[name].append(template)
    targets: dict[str, LocatedTarget | str] = {}
    for name, centre in centres.items():
        corner = centre[:2] + whole.cell_m * (half + 0.5) * np.array([-1.0, 1.0])
        grid = MapGrid(float(corner[0]), float(corner[1]), whole.cell_m, 2 * half + 1, 2 * half + 1)
        picture = picture_on_grid(path, grid, grid.whole)
        targets[name] = find_target(picture, centre, whole.cell_m, templates[name])
    missing = "fewer than two of its marks intersect"
    return {point["name"]: targets.get(point["name"], missing) for point in points}


_SAMPLED_CELLS = 4_000_000  # that a median is taken of, about


def matching_sigma_m(run: Run) -> float | None:
    """Return the median standard deviation of the matched heights by themselves, without what photographs and
    calibration do to all of them; None where nothing was measured."""
    layers = surface_layers(run)
    step = max(layers.grid.rows * layers.grid.columns // _SAMPLED_CELLS, 1)
    sigmas = []
    for window in layers.windows:
        own, source = layers.read(window, "own", "source")
        sigmas.append(own[source == MEASURED][::step])
    sigma = np.concatenate(sigmas)
    sigma = sigma[np.isfinite(sigma)]
    return float(np.median(sigma)) if len(sigma) else None


def _as_drawn(
    stored: StoredSurface, dense: DenseSurface, numbers: DenseRecord
) -> tuple[DenseSurface, DenseRecord, float | None]:
    """Return the surface and its numbers as figures show them, and the datum's sigma in height where it is left out of
    them: where it would hide everything else."""
    shape, relative = made_frame(stored.run).shape(), stored.relative_sigma()
    if shape is None or relative is None or numbers["sigma_m"] is None:
        return dense, numbers, None
    without = replace(dense, sigma=relative)
    spread, datum_sigma_m = sigma_numbers(without), float(np.sqrt(shape.datum_covariance_m2[2, 2]))
    if spread is None or not datum_sigma_m > DROWNS * spread["median"]:
        return dense, numbers, None
    return without, {**numbers, "sigma_m": spread}, datum_sigma_m


@dataclass(frozen=True)
class ReportedSurface:
    """What report.json says of the orthophoto, of the dense surface and of the plane that they are made on, None of
    what was not made, their figures for the page, and the names of their pictures."""

    orthophoto: OrthophotoRecord | NoOrthophotoRecord | None
    dense: DenseRecord | None
    plane: PlaneRecord | None
    figures: list[PageFigure]
    pictures: list[str]


def report_surface(
    stored: StoredSurface, control_points: Sequence[GroundPointRecord], results: Path
) -> ReportedSurface:
    """Report on the orthophoto and on the dense surface, and write their pictures; nothing of what the project asks for
    none of."""
    run = stored.run
    site = made_frame(run)
    upright, language = site.plane is not None, Language(run.project.report.language)
    points = site.ground_points(control_points)
    drawn, ground = list[DrawnFigure](), ground_marks(points)
    picture, dense = orthophoto_picture(run), dense_surface(run, stored)
    orthophoto: OrthophotoRecord | NoOrthophotoRecord | None = None
    if picture is not None:
        orthophoto = orthophoto_numbers(picture)
        checks = [point for point in points if checks_plan(point)]
        if checks:
            targets = targets_in_orthophoto(run, site, checks)
            orthophoto["check_points"] = orthophoto_check_numbers(checks, targets, upright=upright)
        drawn.append(drawn_orthophoto(picture, ground, language))
    elif reason := reason_left_out(run, "orthophoto"):
        orthophoto = {"left_out": reason}
    numbers: DenseRecord | None = None
    if dense is not None:
        left_out_m2 = run.workspace.summary("dense", DenseSummary).get("left_out_m2", 0.0)
        numbers = dense_numbers(dense, ground, matching_sigma_m(run), left_out_m2=left_out_m2, upright=upright)
        if run.workspace.has("surface", WATER_FILE):
            areas = read_json(run.workspace.file("surface", WATER_FILE))
            numbers["water"] = water_numbers(areas, numbers["cells"])
        target_m = None if upright else run.project.report.target_rmse_v_m
        surface, numbers_drawn, datum_sigma_m = _as_drawn(stored, dense, numbers)
        drawn += drawn_surface(surface, ground, numbers_drawn, target_m, datum_sigma_m, language)
    if upright:
        drawn = [on_plane(figure) for figure in drawn]
    names = write_surface_pictures(results / PICTURES, drawn)
    figures = surface_figures(drawn) + thumbnails(picture, stored.heights() if stored.is_there else None)
    return ReportedSurface(orthophoto, numbers, plane_record(run), figures, [f"{PICTURES}/{name}" for name in names])
