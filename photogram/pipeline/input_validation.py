"""Validation of a survey's inputs before processing: reads the project, the tags of the photographs and the free space
of the machine, and gathers all that is found wrong with them.

`photogram check` shows it, and `photogram adjust` stops at its errors before any work.
"""

import shutil
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os.path import exists, isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

from photogram.adjustment.problem import check_engine
from photogram.arrays import BoolArray
from photogram.errors import AdjustmentError, ImageError, ProjectError
from photogram.files.atomic import unwritable
from photogram.files.photographs.duplicates import find_duplicates
from photogram.files.photographs.headers import PhotographHeader, read_headers
from photogram.files.photographs.masks import check_mask, read_masks
from photogram.files.photographs.tags import PhotographTags
from photogram.files.stage_folders import earlier_folders
from photogram.machine import cores, free_memory_bytes
from photogram.pipeline.costs.forecast import Forecast, compiled_share, forecast
from photogram.pipeline.costs.self_test import Speed, measured_speed
from photogram.pipeline.costs.space import machine_needs
from photogram.pipeline.pipeline import STAGES, load_project, remaining_stages
from photogram.pipeline.reference_placement import known_surface_findings, reference_findings
from photogram.pipeline.store.results_record import FOREIGN, FOREIGN_REMEDY, foreign_products
from photogram.pipeline.volume_findings import volume_findings
from photogram.project.findings import Finding, Findings
from photogram.project.project import Project, photograph_paths
from photogram.project.start import start_findings
from photogram.project.validation.check import by_severity, check_survey, header_findings, project_errors
from photogram.project.validation.masks import marks_in_masks, mask_findings
from photogram.wording import some

WORTH_TESTING_S = 20.0
"""From how many seconds of work on, on the reference machine, the speed of this one is tested before."""


def _free_disk_bytes(folder: Path) -> int:
    """Return the free space of the disk on which ``folder`` is, or will be made."""
    return shutil.disk_usage(next(p for p in (folder, *folder.parents) if exists(p))).free


def folder_findings(project: Project) -> list[Finding]:
    """Return whether results and intermediate results can be written, and what in the folder of the latter is not used
    any more."""
    findings = []
    for key, folder in (("results", project.results), ("work", project.work)):
        reason = unwritable(folder.absolute())
        if reason:
            findings.append(Finding("error", key, reason, f"allow it, or give another folder under {key}"))
    foreign = foreign_products(project.results)
    if foreign:
        findings.append(Finding("error", "results", f"{some(foreign)}: {FOREIGN}", FOREIGN_REMEDY))
    earlier = earlier_folders(project.work, tuple(stage.name for stage in STAGES))
    if earlier:
        names = some([folder.name for folder in earlier])
        text = f"folders in {project.work} from an earlier version of photogram are no longer used: {names}"
        findings.append(Finding("note", "work", text, "delete them to free space"))
    return findings


def engine_findings(project: Project) -> list[Finding]:
    """Return whether the settings of the adjustment ask for GTSAM, and it is not installed."""
    try:
        check_engine(project.adjustment)
    except AdjustmentError as error:
        return [Finding("error", "adjustment", str(error))]
    return []


def _headers(paths: Sequence[Path], cameras: Sequence[object]) -> tuple[list[PhotographHeader], list[tuple[int, ...]]]:
    """Return the headers of photographs, and groups of those that are the same."""
    with ThreadPoolExecutor(cores()) as executor:
        headers = read_headers(paths, executor)
        return headers, find_duplicates(paths, [header.tags for header in headers], cameras, executor)


def given_mask_findings(project: Project) -> list[Finding]:
    """Return what is wrong with the masks of a project; only those of photographs with marks of ground points are
    decoded, of the others the size, the kind and, where they have any, the checksums are looked at."""
    if not project.masks.given:
        return []

    def size_px(photograph: int) -> tuple[int, int]:
        camera = project.cameras[project.photographs[photograph].camera]
        return camera.width_px, camera.height_px

    def damage(wanted: tuple[Path, tuple[int, int]]) -> str:
        try:
            check_mask(*wanted)
        except ImageError as error:
            return str(error)
        return ""

    wanted = {(path, size_px(i)) for i, paths in enumerate(project.masks.files) for path in paths}
    with ThreadPoolExecutor(cores()) as executor:
        looked_at = dict(zip(sorted(wanted), executor.map(damage, sorted(wanted)), strict=True))
    errors = [text for text in looked_at.values() if text]
    unusable = {path for (path, _), text in looked_at.items() if text}

    def mask_of(photograph: int) -> BoolArray | None:
        paths = project.masks.of(photograph)
        try:
            return read_masks(paths, size_px(photograph)) if paths and unusable.isdisjoint(paths) else None
        except ImageError as error:
            errors.append(str(error))
            return None

    marks = marks_in_masks(project, mask_of)
    return mask_findings(list(dict.fromkeys(errors)), marks)


@dataclass(frozen=True)
class CheckedProject:
    """What the check of a project has found, and the tags of its photographs, None where one cannot be read."""

    findings: Findings
    tags: tuple[PhotographTags | None, ...]


def checked_project(project: Project) -> CheckedProject:
    """Return everything that can be known to be wrong with a project that has been read, errors, then warnings, then
    notes, and the tags.

    Reads the headers of the photographs and asks the machine for its memory and free disk; nothing is decoded but
    photographs suspected to be there twice. Raises OSError where the disk cannot be asked.
    """
    photographs = project.photographs
    headers, duplicates = _headers([p.path for p in photographs], [p.camera for p in photographs])
    free_disk_bytes = _free_disk_bytes(project.work.absolute())
    needs = machine_needs(STAGES, project, [header.tags for header in headers], cores())
    survey = check_survey(project, headers, needs, duplicates, free_disk_bytes, free_memory_bytes())
    tags = tuple(header.tags for header in headers)
    reference = reference_findings(project, tags)
    findings = Findings(
        by_severity(
            [
                *folder_findings(project),
                *engine_findings(project),
                *reference,
                *volume_findings(project, tags),
                *known_surface_findings(project, tags),
                *given_mask_findings(project),
                *start_findings(project.start),
                *survey,
            ]
        )
    )
    return CheckedProject(findings, tags)


def tags_of(project: Project) -> tuple[PhotographTags | None, ...]:
    """Return the tags of a project's photographs, None where one cannot be read."""
    with ThreadPoolExecutor(cores()) as executor:
        headers = read_headers([p.path for p in project.photographs], executor)
    return tuple(header.tags for header in headers)


def predicted_costs(
    project: Project,
    tags: Sequence[PhotographTags | None],
    start: str | None = None,
    until: str | None = None,
    *,
    test: bool = True,
) -> Forecast:
    """Return what ``run_pipeline`` will take on this machine, for what is not there yet; ``tags`` are those of
    ``project.photographs``.

    Tests the machine for two or three seconds where the work is worth it, and stages remain whose time depends on it
    most; elsewhere, or without ``test``, it counts as as fast as the reference. Raises WorkspaceError where there is no
    such stage.
    """
    remaining, compiled = remaining_stages(project, start, until), compiled_share(STAGES)
    untested = forecast(STAGES, project, tags, Speed(), cores(), remaining, compiled)
    depends = any(stage.costs.is_tested for stage in STAGES if stage.name in remaining)
    if not test or not depends or untested.seconds < WORTH_TESTING_S:
        return untested
    return forecast(STAGES, project, tags, measured_speed(), cores(), remaining, compiled)


def check_project(project: Path | str, photographs: Path | str | None = None) -> Findings:
    """Return everything that can be known to be wrong with a project file before the work starts, the worst first;
    where the file itself has errors, those and what is wrong with its photographs.

    ``project`` is the path of the file, ``photographs`` the folder of the photographs in place of the file's own. Takes
    seconds: reads the headers of the photographs, and asks the machine for its memory and free disk. Raises
    ProjectError where the file is missing or is not YAML.
    """
    path = Path(project)
    folder = None if photographs is None else Path(photographs)
    try:
        survey = load_project(path, folder)
    except ProjectError as error:
        # Photographs that are missing are among these errors already.
        there = [p for p in photograph_paths(path, folder) if isfile(p)]
        headers, duplicates = _headers(there, [None] * len(there))
        return Findings(by_severity([*project_errors(path, error), *header_findings(headers, duplicates)]))
    return checked_project(survey).findings
