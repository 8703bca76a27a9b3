"""One run of a project: its photographs as they are measured, masked and decoded, and the folders of its stages.

A stage reads only what earlier stages have written, so that a resumed run sees exactly what an uninterrupted one sees;
what a stage has stored is read by functions beside it.
"""

from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray, ByteArray, IntArray
from photogram.files.npz_json import file_fingerprint, read_json, read_json_as
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_grey, read_photograph
from photogram.files.photographs.masks import read_mask, read_masks
from photogram.files.solutions.stored_solutions import read_stored
from photogram.machine import cores
from photogram.pipeline.store.pools import Pool, WorkOrder
from photogram.pipeline.store.stored_photographs import StoredFrame, read_measured
from photogram.pipeline.store.workspace import Workspace
from photogram.project.measured.measured_block import PhotographNote, block_of
from photogram.project.project import Project
from photogram.project.start import InitialSolution, start_of
from photogram.project.validation.undeclared_heights import with_undeclared_heights
from photogram.survey import Block

FRAME, MEASURED, NOTES = "frame.json", "measured.npz", "tags.json"

STRETCHES = "stretches.json"
"""File of the stage `photographs` with the stretch to 8 bits of each camera; not there where none has more."""

AUTOMATIC_MASKS = "masks.json"
"""File of the stage `transfer` with the share of each photograph that is masked automatically; not there without."""


def mask_file(photograph: int) -> str:
    """Return the file of the stage `transfer` with the automatic mask of a photograph."""
    return f"mask{photograph:05d}.png"


@dataclass(frozen=True)
class Run:
    """One run of a project: the project, its workspace, the executor of threads for parallel work, and the ``pool`` of
    processes that do pieces of it, where there is one; ``orders`` are what they are told of the stages at work, by the
    stage's partial folder."""

    project: Project
    workspace: Workspace
    executor: Executor
    pool: Pool | None = None
    orders: dict[Path, WorkOrder] = field(default_factory=dict, init=False, repr=False, compare=False)
    _memory: list[int] = field(default_factory=list, init=False, repr=False, compare=False)
    _stretches: dict[str, dict[str, Stretch]] = field(default_factory=dict, init=False, repr=False, compare=False)
    _blocks: dict[str, Block] = field(default_factory=dict, init=False, repr=False, compare=False)

    @cached_property
    def photograph_fingerprints(self) -> tuple[str, ...]:
        """Return the content fingerprint of every photograph."""
        # with workers of its own, since one of the executor's may be the first to ask
        with ThreadPoolExecutor(cores()) as workers:
            return tuple(workers.map(file_fingerprint, [p.path for p in self.project.photographs]))

    @cached_property
    def mask_fingerprints(self) -> tuple[tuple[str, ...], ...]:
        """Return the content fingerprints of the masks that are given for every photograph."""
        files = self.project.masks.files
        distinct = sorted({path for paths in files for path in paths})
        with ThreadPoolExecutor(cores()) as workers:
            marks = dict(zip(distinct, workers.map(file_fingerprint, distinct), strict=True))
        return tuple(tuple(marks[path] for path in paths) for paths in files)

    def given_mask(self, index: int) -> BoolArray | None:
        """Return which pixels (height, width) of a photograph the masks that are given leave, None where it has none.
        Raises ImageError as ``read_masks``."""
        paths = self.project.masks.of(index)
        if not paths:
            return None
        camera = self.project.cameras[self.project.photographs[index].camera]
        size_px = camera.width_px, camera.height_px
        return read_masks(paths, size_px, self.mask_fingerprints[index])

    @cached_property
    def automatically_masked(self) -> dict[str, float]:
        """Return the share of each photograph that is masked automatically, by name, of those that have such a mask.
        Needs the stage `transfer`."""
        if "sky" not in self.project.masks.auto or not self.workspace.has("transfer", AUTOMATIC_MASKS):
            return {}
        return {str(n): float(s) for n, s in read_json(self.workspace.file("transfer", AUTOMATIC_MASKS)).items()}

    def mask(self, index: int) -> BoolArray | None:
        """Return which pixels (height, width) of a photograph are used, by the masks that are given and those found
        automatically, None where it has neither. Needs the stage `transfer`."""
        used = self.given_mask(index)
        if self.names[index] not in self.automatically_masked:
            return used
        automatic = read_mask(self.workspace.file("transfer", mask_file(index)))
        return automatic if used is None else used & automatic

    def masked(self, indices: IntArray) -> BoolArray:
        """Return which of some photographs have a mask, given or found automatically. Needs the stage `transfer`."""
        names, automatic = self.names, self.automatically_masked
        return np.array([bool(self.project.masks.of(i)) or names[i] in automatic for i in indices.tolist()], dtype=bool)

    def note_memory(self, highest: int | None) -> None:
        """Note the most memory, in bytes, that a process of the pool has held in the present stage."""
        self._memory[:] = [max(highest or 0, *self._memory, 0)]

    def taken_memory(self) -> int:
        """Return the most memory that was noted since it was asked last, in bytes, 0 where none was."""
        noted, self._memory[:] = max(self._memory, default=0), []
        return noted

    @property
    def stretches(self) -> dict[str, Stretch]:
        """Return the stretch to 8 bits of each camera whose photographs have more, by its name. Needs the stage
        `photographs`."""
        mark = self.workspace.mark("photographs") or ""
        if mark not in self._stretches:
            there = self.workspace.has("photographs", STRETCHES)
            stored = read_json(self.workspace.file("photographs", STRETCHES)) if there else {}
            self._stretches[mark] = {str(name): Stretch(int(low), int(high)) for name, (low, high) in stored.items()}
        return self._stretches[mark]

    def stretch(self, index: int) -> Stretch | None:
        """Return the stretch to 8 bits of a photograph, None where it has no more. Needs the stage `photographs`."""
        return self.stretches.get(self.project.cameras[self.project.photographs[index].camera].name)

    def pixels(self, index: int, size_px: tuple[int, int] | None = None) -> ByteArray:
        """Return a photograph as red, green, blue (height, width, 3). Raises ImageError as ``read_photograph``, and
        where it is not what it was when the run began."""
        path, sha256 = self.project.photographs[index].path, self.photograph_fingerprints[index]
        return read_photograph(path, size_px, sha256, self.stretch(index))

    def grey(self, index: int) -> ByteArray:
        """Return a photograph's luminance (height, width). Raises ImageError as ``pixels``."""
        path, sha256 = self.project.photographs[index].path, self.photograph_fingerprints[index]
        return read_grey(path, None, sha256, self.stretch(index))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the photographs."""
        return tuple(p.name for p in self.project.photographs)

    def block(self) -> Block:
        """Return the block as measured: no poses, no tie points. Needs the stage `photographs`.

        It is assembled once in a process for each state of that stage: from what the stage has stored of the
        photographs, and from the project's ground points, which may have changed since.
        """
        mark = self.workspace.mark("photographs") or ""
        if mark not in self._blocks:
            file = self.workspace.file
            origin_map_m = read_json_as(file("photographs", FRAME), StoredFrame)["origin_map_m"]
            measured = read_measured(file("photographs", MEASURED), self.project, origin_map_m)
            self._blocks[mark] = with_undeclared_heights(self.project, block_of(self.project, measured), self.notes())
        return self._blocks[mark]

    def notes(self) -> list[PhotographNote]:
        """Return what the project, files of positions and tags say of each photograph. Needs the stage
        `photographs`."""
        return read_json_as(self.workspace.file("photographs", NOTES), list[PhotographNote])

    @cached_property
    def start(self) -> InitialSolution | None:
        """Return what the project starts from, None where it starts from photographs alone. Raises ProjectError,
        ExchangeError where the solution is not what it was when the project was read."""
        start, photographs = self.project.start, self.project.photographs
        if start is None:
            return None
        camera_of = [p.camera for p in photographs]
        return start_of(self.names, camera_of, self.project.cameras, read_stored(start.solution))
