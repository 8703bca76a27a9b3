"""The stage `photographs`: decodes every photograph once and assembles what was measured before the tie points."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
from typing_extensions import TypedDict

from photogram.errors import ImageError, PhotogramError, ProjectError
from photogram.files.npz_json import file_fingerprint, fingerprint, read_json_as, write_json
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.duplicates import find_duplicates
from photogram.files.photographs.images import check_photograph, read_tags
from photogram.files.photographs.stretches import camera_stretches
from photogram.files.photographs.tags import PhotographTags
from photogram.pipeline.stage import Stage, line_of
from photogram.pipeline.stage_costs import Costs, Memory, Rate
from photogram.pipeline.store.pieces import PieceType, StageWork, run_pieces, stage_work
from photogram.pipeline.store.run import FRAME, MEASURED, NOTES, STRETCHES, Run
from photogram.pipeline.store.stored_photographs import StoredFrame, write_measured
from photogram.project.measured.measured_block import (
    PhotographNote,
    companions_of,
    is_amid,
    measured_photographs,
    photograph_note,
)
from photogram.project.measured.measured_positions import measured_position
from photogram.project.measured.unmeasured import withdraw_placeholders, withdraw_position
from photogram.project.positions.frozen import frozen_positions
from photogram.project.project import Project, ProjectPhotograph
from photogram.project.validation.datum import datum_findings
from photogram.project.validation.positions import time_findings
from photogram.wording import Progress, things


class PhotographsSummary(TypedDict, total=False):
    """What the stage says of itself."""

    photographs: int
    """Number of photographs read."""
    copies: int
    """Number of copies left out, if any."""
    frozen_positions: int
    """Number of positions of a stopped receiver, if any."""


def _described(project: Project, photograph: ProjectPhotograph, sha256: str) -> tuple[PhotographNote, PhotographTags]:
    """Decode a photograph once, so that damage shows before hours of work, and return what is known of its pose, and
    its tags."""
    camera = project.cameras[photograph.camera]
    check_photograph(photograph.path, (camera.width_px, camera.height_px), sha256)
    tags = read_tags(photograph.path)
    return photograph_note(photograph, tags, measured_position(project, photograph, tags)), tags


def _decode(work: StageWork, index: int) -> tuple[PhotographNote, PhotographTags] | str:
    """Return what ``_described`` returns of a photograph, or what is wrong with it."""
    run, _ = work
    try:
        return _described(run.project, run.project.photographs[index], run.photograph_fingerprints[index])
    except PhotogramError as error:
        return str(error)


_DECODED = PieceType(stage_work, _decode)


def _leave_out_copies(
    project: Project, notes: Sequence[PhotographNote], tags: Sequence[PhotographTags], executor: Executor
) -> int:
    """Note of each photograph that is another one saved again which that is; it then measures nothing. Returns how many
    there are."""
    photographs = project.photographs
    groups = find_duplicates([p.path for p in photographs], tags, [p.camera for p in photographs], executor)
    for original, *duplicates in groups:
        for i in duplicates:
            withdraw_position(notes[i])
            notes[i]["attitude_deg"] = None
            notes[i]["copy_of"] = photographs[original].name
    return sum(len(group) - 1 for group in groups)


def _leave_out_frozen(notes: Sequence[PhotographNote], times: Sequence[datetime | None]) -> int:
    """Note which positions a receiver gave that had stopped; they are not used. Returns how many there are."""
    nowhere = (np.nan,) * 3
    stated = np.array([note["gnss_map_m"] or nowhere for note in notes], dtype=np.float64).reshape(-1, 3)
    frozen = frozen_positions(stated, times, [note["capture"] for note in notes])
    for note, stopped in zip(notes, frozen, strict=True):
        if stopped:
            withdraw_position(note)
            note["gnss_frozen"] = True
    return int(frozen.sum())


def leave_out(
    project: Project, notes: Sequence[PhotographNote], tags: Sequence[PhotographTags], executor: Executor
) -> tuple[int, int]:
    """Take out of the ``notes`` what measures nothing: placeholders in the tags, photographs that are there twice, and
    positions of a receiver that had stopped. Returns how many there are of the last two.

    Raises ProjectError where times or height references contradict the project.
    """
    times = [None if note["time"] is None else datetime.fromisoformat(note["time"]) for note in notes]
    timed = list(zip(project.photographs, times, strict=True))
    contradictions = [f for f in (*time_findings(timed), *datum_findings(project, tags)) if f.severity == "error"]
    if contradictions:
        raise ProjectError("\n".join(map(str, contradictions)))
    withdraw_placeholders(project, notes, tags)
    return _leave_out_copies(project, notes, tags, executor), _leave_out_frozen(notes, times)


def find_stretches(project: Project, tags: Sequence[PhotographTags], executor: Executor) -> dict[str, Stretch]:
    """Return the stretch of each camera whose photographs have more than 8 bits a channel, by its name. Raises
    ImageError where photographs of one camera differ in these, or all pixels have the same value."""
    return camera_stretches(
        [(p.name, p.path) for p in project.photographs],
        [p.camera for p in project.photographs],
        [camera.name for camera in project.cameras],
        [own.bits for own in tags],
        executor,
    )


def read_photographs(run: Run, folder: Path, progress: Progress) -> PhotographsSummary:
    """Decode every photograph, note its GNSS position and attitude, and store both in the frame of the survey; every
    damaged one is named at once.

    A photograph that is there twice is used once, and positions of a receiver that had stopped are not used. Where
    photographs have more than 8 bits a channel the stretch of each camera is found and stored.
    """
    photographs = run.project.photographs
    notes, tags, errors = list[PhotographNote](), list[PhotographTags](), list[str]()
    for done, decoded in enumerate(run_pieces(run, folder, _DECODED, range(len(photographs))), 1):
        if isinstance(decoded, str):
            errors.append(decoded)
        else:
            notes.append(decoded[0])
            tags.append(decoded[1])
        progress(done, len(photographs), photographs[done - 1].name)
    if errors:
        raise ImageError("\n".join(errors))
    of_cameras = find_stretches(run.project, tags, run.executor)
    duplicates, frozen = leave_out(run.project, notes, tags, run.executor)
    measured = measured_photographs(run.project, notes)
    companions_of(run.project, measured)  # for its errors: hours before the exposures are needed
    write_json(folder / NOTES, notes)
    write_measured(folder / MEASURED, measured)
    if of_cameras:
        write_json(folder / STRETCHES, {name: [own.low, own.high] for name, own in of_cameras.items()})
    frame: StoredFrame = {
        "origin_map_m": measured.frame.origin_map_m,
        "placed_by": _placing_fingerprint(run.project),
    }
    write_json(folder / FRAME, frame)
    summary: PhotographsSummary = {"photographs": len(notes)}
    if duplicates:
        summary["copies"] = duplicates
    if frozen:
        summary["frozen_positions"] = frozen
    return summary


# ---- what it depends on ----------------------------------------------------------------------------------------------


def _height_marks(project: Project) -> list[object]:
    """Return the height systems as declared: the grid of a geoid counts by what is in it."""
    heights, geoid = project.heights, project.heights.geoid
    grid = None if geoid is None or geoid.grid is None else file_fingerprint(Path(geoid.grid))
    return [heights.output, heights.gnss, heights.gnss_given, None if geoid is None else geoid.vertical, grid]


def _placing_fingerprint(project: Project) -> str:
    """Return the fingerprint of the control coordinates that help to choose the origin of the frame."""
    return fingerprint([p.control_map_m for p in project.surveyed.control_points if p.role == "control"])


def _settings_placed_by(run: Run, placing: str) -> object:
    project = run.project
    return [
        run.photograph_fingerprints,
        project.cameras,
        # but for where they lie: a moved folder changes nothing
        [replace(p, path=Path(p.name)) for p in project.photographs],
        project.crs,
        project.world_kind,
        _height_marks(project),
        None if project.datum.grid is None else file_fingerprint(Path(project.datum.grid)),
        placing,
        *([project.rigs] if project.rigs else []),  # companions are measured by their masters
    ]


def _settings(run: Run) -> object:
    return _settings_placed_by(run, _placing_fingerprint(run.project))


def _as_made(run: Run) -> object | None:
    """Return what the stage was made under where its frame still serves, None where it does not, or is not there:
    control points help to choose the origin of the frame, which serves as long as it lies amid the survey."""
    if run.workspace.mark("photographs") is None or not run.workspace.has("photographs", FRAME):
        return None
    frame = read_json_as(run.workspace.file("photographs", FRAME), StoredFrame)
    serves = is_amid(frame["origin_map_m"], run.project, run.notes())
    return _settings_placed_by(run, frame["placed_by"]) if serves else None


def stretches(run: Run) -> list[object]:
    """Return what stages depend on that read pixels of more than 8 bits; nothing in a project without such."""
    return [run.stretches] if run.stretches else []


def _words(summary: PhotographsSummary) -> str:
    parts = [f"{things(summary['photographs'], 'photograph')} read"]
    if summary.get("copies"):
        parts.append(f"{things(summary['copies'], 'copy', 'copies')} left out")
    if summary.get("frozen_positions"):
        parts.append(f"{things(summary['frozen_positions'], 'position')} of a stopped receiver not used")
    return ", ".join(parts)


PHOTOGRAPHS: Stage = Stage(
    "photographs",
    "Photographs",
    (),
    _settings,
    read_photographs,
    line_of(PhotographsSummary, _words),
    Costs(
        0.05,
        (Rate("megapixels", 0.012),),
        memory=lambda extent: Memory(3.0 * extent.workers * extent.largest_px),
    ),
    _as_made,
)
