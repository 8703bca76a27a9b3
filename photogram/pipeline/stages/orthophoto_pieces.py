"""Pieces of the stage `orthophoto`: photographs that are looked at, and tiles; in threads from what they share, in
other processes from what this one has written."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import asdict, astuple
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.files.npz_json import read_arrays, read_json, write_arrays, write_json
from photogram.files.records import read_record, write_record
from photogram.grid import MapGrid, Window
from photogram.machine import cores, memory_bytes
from photogram.pipeline.stages.surface_frame import made_frame
from photogram.pipeline.stages.surfaces.closing import stored_closing
from photogram.pipeline.store.pieces import PieceType, run_pieces
from photogram.pipeline.store.run import Run
from photogram.surface.ortho.block_samples import BlockSamples, seen_cells
from photogram.surface.ortho.colour_balance import Balance
from photogram.surface.ortho.masked_cells import Masks
from photogram.surface.ortho.orthophoto import CACHE_BYTES, LEAST_CACHED, TILE_CELLS, Orthophoto, plain_blocks
from photogram.surface.ortho.plan_sigma import RaysAt
from photogram.surface.ortho.seamlines import Lattice, Seams
from photogram.surface.ortho.visibility import SurfaceModel
from photogram.surface.views import Views

_GRID, _LATTICE, _SEAMS, _BALANCE = "grid.json", "lattice.npz", "seams.npz", "balance.npz"

TILES_ALONG = 4
"""Tiles along a square of them that one process makes, so that a photograph that it decodes serves several."""

_WHOLE = ("block_cells", "candidate", "cost", "height_map_m", "sample_map_m", "centre_world_m", "looks")


class CachedPhotographs:
    """Decoded photographs by number, the ``most`` last used ones kept; each is decoded once at a time, whoever asks."""

    @staticmethod
    def of(run: Run, views: Views, share: int = 1) -> CachedPhotographs:
        """Return the photographs of a run, as many of them kept as one of ``share`` processes may."""
        sizes = [(int(width), int(height)) for width, height in views.size_px]

        def read(view: int) -> ByteArray:
            return run.pixels(int(views.photograph[view]), sizes[view])

        return CachedPhotographs(read, photographs_cached(sizes, share))

    def __init__(self, read: Callable[[int], ByteArray], most: int) -> None:
        self._read, self._most = read, most
        self._lock = Lock()
        self._pixels: OrderedDict[int, Future[ByteArray]] = OrderedDict()

    def __call__(self, number: int) -> ByteArray:
        """Return the pixels (H, W, 3) of a photograph. Raises whatever reading it raises."""
        with self._lock:
            mine = number not in self._pixels
            future = self._pixels.setdefault(number, Future())
            self._pixels.move_to_end(number)
            if len(self._pixels) > self._most:
                self._pixels.popitem(last=False)
        if mine:
            try:
                future.set_result(self._read(number))
            except BaseException as error:
                future.set_exception(error)
                raise
        return future.result()


def photographs_cached(sizes_px: Sequence[tuple[int, int]], share: int = 1) -> int:
    """Return how many decoded photographs of these sizes fit into CACHE_BYTES and a sixteenth of the memory, divided
    among ``share`` processes; LEAST_CACHED at least."""
    largest = max((3 * width * height for width, height in sizes_px), default=1)
    return max(LEAST_CACHED, min(memory_bytes() // 16, CACHE_BYTES) // share // largest)


def masks_of(run: Run, views: Views) -> Masks | None:
    """Return the masks of the photographs of a run, None where it has none."""
    masked = run.masked(views.photograph)
    return Masks(masked, lambda view: run.mask(int(views.photograph[view]))) if masked.any() else None


def looked_at(
    run: Run, folder: Path, scratch: Path, block_samples: BlockSamples, pixels_of: CachedPhotographs
) -> list[tuple[IntArray, FloatArray]]:
    """Look at every photograph, and return the colours of each at the places where they are compared."""
    if run.pool is None:
        return list(
            run.executor.map(lambda view: block_samples.at(view, pixels_of(view)), range(len(block_samples.views)))
        )
    write_json(scratch / _GRID, asdict(block_samples.grid))
    lattice = block_samples.lattice
    write_arrays(scratch / _LATTICE, {name: np.asarray(getattr(lattice, name)) for name in _WHOLE})
    colours = []
    for view, name in enumerate(run_pieces(run, folder, _BLOCK_SAMPLES, range(len(block_samples.views)))):
        samples = read_arrays(scratch / name)
        block_samples.take(view, samples)
        colours.append((samples["place"], samples["colour"]))
        (scratch / name).unlink()
    return colours


def tiles_of(
    run: Run, folder: Path, scratch: Path, orthophoto: Orthophoto, pixels_of: CachedPhotographs
) -> Iterator[tuple[Window, tuple[ByteArray, RaysAt]]]:
    """Yield all tiles of an orthophoto with their red, green, blue and alpha (rows, columns, 4), and the rays that show
    them."""
    if run.pool is None:
        yield from orthophoto.tiles_with_rays(pixels_of, run.executor)
        return
    write_record(scratch / _SEAMS, orthophoto.seams)
    write_record(scratch / _BALANCE, orthophoto.balance)
    write_json(scratch / "colours.json", [orthophoto.feather_cells, orthophoto.highlights])
    squares = list(orthophoto.grid.tiles(TILES_ALONG * TILE_CELLS))
    for square, name in zip(squares, run_pieces(run, folder, _SQUARES, squares), strict=True):
        made = read_arrays(scratch / name)
        (scratch / name).unlink()
        for number, window in enumerate(square.tiles(TILE_CELLS)):
            cells, sideways, state = (made[f"{key}{number}"] for key in RaysAt._fields)
            yield window, (made["rgba"][window.within(square)], RaysAt(Window(*cells.tolist()), sideways, state))


class _Elsewhere:
    """What another process than the one that began the stage reads of it: its scratch folder, the photographs, and the
    terrain under them."""

    def __init__(self, run: Run, folder: Path) -> None:
        # the only folder with this file: others belong to products that are being written
        self.scratch = next(path.parent for path in folder.glob(f".photogram-*/{_GRID}"))
        block = made_frame(run).block()
        self.grid, self.frame, self.views = MapGrid(**read_json(self.scratch / _GRID)), block.frame, Views.of(block)
        self.terrain = SurfaceModel.under(self.views, self.frame, stored_closing(run)[0])
        self.pixels_of = CachedPhotographs.of(run, self.views, share=cores())
        self.masks = masks_of(run, self.views)


def _block_samples(run: Run, folder: Path) -> tuple[_Elsewhere, BlockSamples]:
    here = _Elsewhere(run, folder)
    arrays = read_arrays(here.scratch / _LATTICE)
    block, candidate, cost, height, sample, centre, looks = (arrays[name] for name in _WHOLE)
    lattice = Lattice.unseen(int(block), candidate, cost, height, sample, centre, looks)
    return here, BlockSamples.of(here.views, here.frame, here.terrain, here.grid, lattice, here.masks)


def _sample_blocks(prepared: tuple[_Elsewhere, BlockSamples], view: int) -> str:
    """Look at a photograph, and return the file that says what was seen."""
    here, block_samples = prepared
    name = f"look{view:05d}.npz"
    place, colour = block_samples.at(view, here.pixels_of(view))
    write_arrays(here.scratch / name, {"place": place, "colour": colour, **block_samples.of_view(view)})
    return name


def _orthophoto(run: Run, folder: Path) -> tuple[_Elsewhere, Orthophoto]:
    here = _Elsewhere(run, folder)
    feather_cells, highlights = read_json(here.scratch / "colours.json")
    seams = read_record(here.scratch / _SEAMS, Seams)
    balance = read_record(here.scratch / _BALANCE, Balance)
    seen = seen_cells(here.views, here.frame, here.terrain, here.masks)
    return here, Orthophoto(
        here.views, here.frame, here.terrain, here.grid, seams, balance, seen, feather_cells, highlights,
        plain_blocks(seams),
    )  # fmt: skip


def _square(prepared: tuple[_Elsewhere, Orthophoto], square: Window) -> str:
    """Make the tiles of a square, and return the file that holds them."""
    here, orthophoto = prepared
    name = f"square{square.row:07d}-{square.column:07d}.npz"
    made = np.empty((*square.shape, 4), np.uint8)
    rays: dict[str, NDArray[Any]] = {}
    for number, window in enumerate(square.tiles(TILE_CELLS)):
        made[window.within(square)], (cells, sideways, state) = orthophoto.tile_with_rays(window, here.pixels_of)
        rays |= {f"window{number}": np.array(astuple(cells)), f"sideways{number}": sideways, f"state{number}": state}
    write_arrays(here.scratch / name, {"rgba": made, **rays})
    return name


_BLOCK_SAMPLES = PieceType(_block_samples, _sample_blocks)
_SQUARES = PieceType(_orthophoto, _square)
