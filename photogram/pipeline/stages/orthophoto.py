"""The stage `orthophoto`: reads the adjustment, the surface and the photographs, and writes `orthophoto.tif`."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from threading import Lock

import numpy as np

from photogram.arrays import ByteArray
from photogram.camera import Pose
from photogram.files.maps.cogs import write_cog_rgba
from photogram.files.npz_json import read_json, write_json
from photogram.grid import Window
from photogram.machine import memory_bytes
from photogram.pipeline.stages.no_surface import LEFT_OUT
from photogram.pipeline.stages.surface_frame import made_frame
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage import Progress
from photogram.pipeline.store.stage_summary import StageSummary
from photogram.surface.ortho.orthophoto import LEAST_HELD, TILE_CELLS, Orthophoto, plan_orthophoto
from photogram.surface.views import Views

LEAST_DEPRESSION_DEG = 40.0
"""Of the median optical axis, below the horizon: what is flatter shows facades, which a plan does not; oblique flights
for models of towns look down by 45°."""


def left_out_reason(poses: Sequence[Pose | None]) -> str:
    """Return why photographs of these poses make no orthophoto in plan, empty where they do."""
    down = np.array([-pose.rotation_world_from_camera[2, 2] for pose in poses if pose is not None])
    if not len(down):
        return ""
    depression_deg = float(np.rad2deg(np.arcsin(np.clip(np.median(down), -1.0, 1.0))))
    if depression_deg >= LEAST_DEPRESSION_DEG:
        return ""
    side = f"{depression_deg:.0f}° below" if depression_deg >= 0 else f"{-depression_deg:.0f}° above"
    return (
        f"the photographs are oblique (median optical axis {side} the horizon): an orthophoto would not show "
        "what they show"
    )


class HeldPhotographs:
    """Decoded photographs by number, the ``held`` last used ones kept; each is decoded once at a time, whoever asks."""

    def __init__(self, read: Callable[[int], ByteArray], held: int) -> None:
        self._read, self._held = read, held
        self._lock = Lock()
        self._pixels: OrderedDict[int, Future[ByteArray]] = OrderedDict()

    def __call__(self, number: int) -> ByteArray:
        """Return the pixels (H, W, 3) of a photograph. Raises whatever reading it raises."""
        with self._lock:
            mine = number not in self._pixels
            future = self._pixels.setdefault(number, Future())
            self._pixels.move_to_end(number)
            if len(self._pixels) > self._held:
                self._pixels.popitem(last=False)
        if mine:
            try:
                future.set_result(self._read(number))
            except BaseException as fault:
                future.set_exception(fault)
                raise
        return future.result()


def photographs_held(sizes_px: Sequence[tuple[int, int]]) -> int:
    """Return how many decoded photographs of these sizes fit into a sixteenth of the memory, LEAST_HELD at least."""
    largest = max((3 * width * height for width, height in sizes_px), default=1)
    return max(LEAST_HELD, memory_bytes() // 16 // largest)


def make_orthophoto(run: Run, folder: Path, progress: Progress) -> StageSummary:
    """Make the orthophoto on the surface and write it as ``orthophoto.tif``, tile by tile; of photographs that look
    sideways none, and why in ``left_out.json``."""
    if not run.project.orthophoto.enabled:
        return {}
    site = made_frame(run)
    reason = "" if run.project.surface.plane == "auto" else left_out_reason(run.adjusted_block().poses)
    if not run.has_surface():
        reason = str(read_json(run.workspace.file("surface", LEFT_OUT))["left_out"])
    if reason:
        write_json(folder / LEFT_OUT, {"left_out": reason})
        return {"left_out": reason}
    block = site.block()
    views = Views.of(block)
    sizes = [(int(width), int(height)) for width, height in views.size_px]
    pixels_of = HeldPhotographs(
        lambda view: run.pixels(int(views.photograph[view]), sizes[view]), photographs_held(sizes)
    )
    camera = np.array([block.photographs[i].camera for i in views.photograph], dtype=np.int64)
    progress(0, 0, "seams and exposure")
    orthophoto = plan_orthophoto(
        views, block.frame, run.filled_surface(), pixels_of, run.executor, run.project.orthophoto, camera=camera
    )
    grid, shown = orthophoto.grid, 0

    def counted() -> Iterator[tuple[Window, ByteArray]]:
        nonlocal shown
        total = -(-grid.rows // TILE_CELLS) * -(-grid.columns // TILE_CELLS)
        for done, (window, rgba) in enumerate(orthophoto.tiles(pixels_of, run.executor), 1):
            shown += int(np.count_nonzero(rgba[..., 3]))
            yield window, rgba
            progress(done, total, f"{grid.columns} × {grid.rows} cells of {grid.cell_m:g} m")

    write_cog_rgba(folder / "orthophoto.tif", grid, site.plan, counted(), note=site.note)
    write_json(folder / "grid.json", grid)
    size: StageSummary = {"rows": grid.rows, "columns": grid.columns, "cell_m": grid.cell_m}
    return {**size, "cells": shown, **summary(orthophoto)}


def summary(orthophoto: Orthophoto) -> StageSummary:
    """Return how many photographs an orthophoto is made of, and by what the brightest and the darkest of them are
    multiplied, as the mean of the channels."""
    label = orthophoto.seams.label
    used = np.unique(label[label >= 0])
    factor = np.exp(-orthophoto.balance.log_gain[used]).mean(axis=1)
    least, most = (float(factor.min()), float(factor.max())) if len(used) else (1.0, 1.0)
    return {"photographs": len(used), "least_factor": round(least, 4), "greatest_factor": round(most, 4)}
