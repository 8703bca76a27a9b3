"""The stage of dense matching: levels from coarse to fine, block by block, resumed where it was killed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray

from photogram.arrays import BoolArray, ByteArray
from photogram.files.atomic import make_folder, replacing
from photogram.files.maps.polygon_files import read_polygons
from photogram.files.npz_json import file_fingerprint, write_json
from photogram.grid import Window
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import (
    LIBRARIES_BYTES,
    MATCHED_CELL_BYTES,
    Costs,
    Extent,
    Memory,
    Rate,
)
from photogram.pipeline.stages.photographs import stretches
from photogram.pipeline.stages.surface_frame import GridSummary, SurfaceFrame, cells_in_words, fitted_frame
from photogram.pipeline.store.pieces import PieceType, run_pieces
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.tiles import BlockFiles
from photogram.sfm.tie_points.features import BYTES_PER_PX
from photogram.surface.dense.pyramid import (
    AROUND_CELLS,
    MINIMUM_RAYS,
    KnownGround,
    Level,
    Prior,
    default_cell_m,
    finer_prior,
    first_prior,
    known_ground,
    mapped_ground,
    plan_levels,
)
from photogram.surface.dense.steep_places import COARSER
from photogram.surface.dense.tile_matching import (
    BLOCK_CELLS,
    MARGIN_CELLS,
    OF_FINEST,
    DenseSettings,
    Heights,
    MatchedBlock,
    Scene,
    match_block,
    unmatched_block,
)
from photogram.surface.mapped_area import Geometry, cells_within
from photogram.surface.views import Views
from photogram.wording import Progress, things


class DenseSummary(GridSummary, total=False):
    """What the stage says of itself, nothing where no heights were matched."""

    levels: int
    """Number of levels of the pyramid."""
    left_out_m2: float
    """Area of ground that two photographs see, and none resolves."""


ALL_USED = 1.0 - 1e-3
"""Share of what a reduced pixel is the mean of that a mask must leave; the least weight in it is 1/256."""


class ReducedPictures:
    """Grey pictures of the photographs, reduced by powers of two, as files that are mapped, not held, in memory.

    Pixels that a mask leaves out are NaN, and so are reduced ones that hold anything of them.
    """

    def __init__(
        self,
        folder: Path,
        grey: Callable[[int], ByteArray],
        reductions: tuple[int, ...],
        mask: Callable[[int], BoolArray | None],
    ) -> None:
        self.folder, self.grey, self.reductions, self.mask = folder, grey, reductions, mask
        make_folder(folder)

    def _file(self, view: int, reduction: int) -> Path:
        return self.folder / f"{view:05d}_{reduction}.npy"

    def make(self, view: int) -> None:
        """Decode a photograph and write its reduced pictures; those that are there are kept."""
        if all(self._file(view, reduction).is_file() for reduction in self.reductions):
            return
        grey, used = self.grey(view), self.mask(view)
        if 1 in self.reductions:
            self._write(view, 1, grey if used is None else np.where(used, grey, np.float16(np.nan)))
        picture = grey.astype(np.float32)
        share = None if used is None else used.astype(np.float32)
        for step in range(1, max(self.reductions).bit_length()):
            picture = cv2.pyrDown(picture)
            reduced = picture.astype(np.float16)
            if share is not None:
                share = (cv2.pyrDown(share) > ALL_USED).astype(np.float32)
                reduced[share == 0.0] = np.nan
            if 2**step in self.reductions:
                self._write(view, 2**step, reduced)

    def _write(self, view: int, reduction: int, picture: NDArray[np.generic]) -> None:
        with replacing(self._file(view, reduction)) as temporary, temporary.open("wb") as stream:
            np.save(stream, picture, allow_pickle=False)

    def __call__(self, view: int, reduction: int) -> NDArray[np.generic]:
        """Return the picture of a view, mapped from its file."""
        picture: NDArray[np.generic] = np.load(self._file(view, reduction), mmap_mode="r", allow_pickle=False)
        return picture


def heights_folder(cells: int) -> str:
    """Return the folder of the heights in cells so many times as large as those of the surface."""
    return f"heights{cells}"


def match_surface(run: Run, folder: Path, progress: Progress) -> DenseSummary:
    """Match heights for every cell of the surface, level by level; blocks that an interrupted run has finished are
    kept."""
    settings: DenseSettings = run.project.dense
    site = fitted_frame(run) if settings.enabled else ""
    if isinstance(site, str):
        return {}
    dense = _Matching.of(run, site, folder)
    levels, pictures, stores, views = dense.levels, dense.pictures, dense.stores, dense.scene.views
    for done, _ in enumerate(run_pieces(run, folder, _PICTURES, range(len(views)), state=dense), 1):
        progress(done, len(views), "reduced pictures")
    total, done = sum(len(store.windows) for store in stores), 0
    for number, level in enumerate(levels):
        blocks = [(number, block) for block in stores[number].windows]
        for _ in run_pieces(run, folder, _BLOCKS, blocks, state=dense):
            done += 1
            progress(done, total, f"cells of {level.grid.cell_m:g} m")
    shutil.rmtree(pictures.folder)
    for level, store in zip(levels, stores, strict=True):
        if not level.measured:
            shutil.rmtree(store.folder)
    grid, base_map_m = levels[-1].grid, dense.scene.frame.origin_map_m[2]
    note = {
        "levels": [level.cells for level in reversed(levels) if level.measured],
        "side": BLOCK_CELLS,
        "base_map_m": base_map_m,
        "flying_height_m": dense.known.flying_height_m,
    }
    write_json(folder / "grid.json", {**asdict(grid), **note})
    made: DenseSummary = {
        "rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m, "levels": len(levels),
        "left_out_m2": dense.left_out_m2,
    }  # fmt: skip
    return made


def asked_area(run: Run) -> Geometry | None:
    """Return the area of the map that the surface is asked for, None where it is all that photographs resolve."""
    path = run.project.surface.area
    if path is None:
        return None
    return shapely.union_all([polygon.polygon for polygon in read_polygons(Path(path), run.project.crs)])


@dataclass(frozen=True, eq=False)
class _Matching:
    """What every block of every level is matched from."""

    settings: DenseSettings
    scene: Scene
    known: KnownGround
    levels: tuple[Level, ...]
    stores: list[BlockFiles]
    pictures: ReducedPictures
    area: Geometry | None
    left_out_m2: float

    @staticmethod
    def of(run: Run, site: SurfaceFrame, folder: Path) -> _Matching:
        """Return it from the adjustment."""
        settings: DenseSettings = run.project.dense
        block = site.block()
        frame, views = block.frame, Views.of(block)
        points = site.cloud().position_map_m
        known = known_ground(points, frame.world_from_map(points), views, settings.photographs)
        area = asked_area(run)
        if area is None:
            views = replace(views, coarsest_m=known.coarsest_m)
        cell_m = run.project.surface.cell_m or default_cell_m(known.gsd_m)
        ground = mapped_ground(frame, known, views, cell_m, MINIMUM_RAYS, area)
        levels = plan_levels(known, views, ground.grid)
        # steep places of the finest level are looked up in pictures of half their size too
        reductions = tuple(sorted({level.reduction for level in levels} | {COARSER * levels[-1].reduction}))
        pictures = ReducedPictures(
            folder / "pictures",
            lambda view: run.grey(int(views.photograph[view])),
            reductions,
            lambda view: run.mask(int(views.photograph[view])),
        )
        stores = [BlockFiles(folder / heights_folder(level.cells), level.grid, BLOCK_CELLS) for level in levels]
        scene = Scene(frame, views, pictures, run.masked(views.photograph))
        return _Matching(settings, scene, known, levels, stores, pictures, area, ground.left_out_m2)

    @staticmethod
    def read(run: Run, folder: Path) -> _Matching:
        """Return it in another process than the one that began the stage, which has looked at the frame."""
        site = fitted_frame(run)
        assert not isinstance(site, str)
        return _Matching.of(run, site, folder)


def _make_pictures(dense: _Matching, view: int) -> None:
    dense.pictures.make(view)


def _match(dense: _Matching, item: tuple[int, Window]) -> None:
    """Match a block of a level, given by its number, unless it is there."""
    number, block = item
    level = dense.levels[number]
    if dense.stores[number].has(block):
        return
    outer = level.grid.around_window(block, MARGIN_CELLS)
    if not cells_within(dense.area, level.grid, outer).any():
        _write(dense, item, unmatched_block(block.shape, refined=level.measured))
        return
    prior = first_prior(dense.known, level, outer, dense.scene.frame.origin_map_m[2])
    if number:
        prior = _around_coarser(dense.stores[number - 1], level, outer, prior)
    matching = match_block(dense.scene, level, block, prior, dense.settings, refined=level.measured)
    if matching.heights is not None:
        matching.heights.height_m[~cells_within(dense.area, level.grid, block)] = np.nan
    _write(dense, item, matching)


def _write(dense: _Matching, item: tuple[int, Window], matching: MatchedBlock) -> None:
    """Write a block of a level, given by its number: of the last one what no finer level starts from."""
    number, block = item
    last = number == len(dense.levels) - 1
    around = {} if last else {"start_m": matching.start_m, "agreement": matching.agreement}
    layers = {} if matching.heights is None else dict(vars(matching.heights))
    if not last:
        for name in OF_FINEST:
            layers.pop(name, None)
    dense.stores[number].write(block, around | layers)


_PICTURES = PieceType(_Matching.read, _make_pictures)
_BLOCKS = PieceType(_Matching.read, _match)


def _around_coarser(coarser: BlockFiles, level: Level, outer: Window, first: Prior) -> Prior:
    """Return the range of a window from the coarser level."""
    at = coarser.grid.around_window(outer.coarser(2), AROUND_CELLS + 3)
    height, correlation = coarser.read(at, "start_m", "agreement")
    return finer_prior(height, correlation, at, level, outer, first)


def _words(summary: DenseSummary) -> str:
    if "columns" not in summary:
        return "not requested"
    made, area_m2 = f"{cells_in_words(summary)}, {things(summary['levels'], 'level')}", summary.get("left_out_m2", 0.0)
    if not area_m2:
        return made
    area = f"{area_m2:.0f}" if area_m2 >= 10.0 else f"{area_m2:.2g}"
    return f"{made}; {area} m² seen only obliquely and coarsely are not mapped: to map them, draw surface.area"


MATCHING_BYTES = 200e6
"""In memory for one worker that matches heights, the photographs apart, measured at 150 to 200 MB."""


def _memory(extent: Extent) -> Memory:
    matching = min(extent.workers * MATCHING_BYTES, MATCHED_CELL_BYTES * extent.cells)
    matching += BYTES_PER_PX * extent.workers * extent.largest_px
    return Memory(LIBRARIES_BYTES + matching * extent.project.dense.enabled, remedy="set dense.enabled to false")


DENSE: Stage = Stage(
    "dense",
    "Dense matching",
    ("adjustment",),
    lambda run: [
        run.photograph_fingerprints,
        run.project.dense,
        run.project.surface.cell_m,
        run.project.surface.in_plan,
        run.project.surface.plane,
        None if run.project.surface.area is None else file_fingerprint(Path(run.project.surface.area)),
        [layer.name for layer in fields(Heights)],
        *stretches(run),
        *([run.project.epoch] if run.project.epochs else []),
    ],
    match_surface,
    line_of(DenseSummary, _words),
    Costs(
        0.1,
        (Rate("megapixels", 0.03), Rate("dense_mcells", 22.0, "dense")),
        23.0,
        ("photogram.surface.dense",),
        is_asked_for=lambda extent: extent.matched_cells > 0,
        is_tested=True,
        disk_bytes=lambda extent: extent.matched_bytes,
        memory=_memory,
    ),
    is_uneven=True,
)
