"""What `photogram init` does."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os.path import exists, isdir, isfile  # false, not an exception, for a name that cannot be
from pathlib import Path, PurePosixPath

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from photogram.cli.screen.terminal import console, steps
from photogram.errors import ImageError, ProjectError
from photogram.files.atomic import replacing
from photogram.files.photographs.copies import find_copies
from photogram.files.photographs.images import inspect_photograph
from photogram.files.tables.control_files import read_points
from photogram.files.tables.position_files import read_mrk
from photogram.height_systems import HeightSystem
from photogram.pipeline.pipeline import load_project
from photogram.project.draft.draft import (
    ControlFile,
    DraftPositions,
    LeftOut,
    ProjectDraft,
    TaggedPhotograph,
    Wishes,
    draft_project,
)
from photogram.project.draft.text import count, project_text
from photogram.project.positions.matching import match_rows
from photogram.project.ranges import FOCAL_PX, PIXELS, SIGMA_M, Within
from photogram.survey import Role

_SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff")


@dataclass(frozen=True)
class Request:
    """What a project file is asked for: the folder of the photographs, files of ground points with their roles, marks,
    and what the tags do not say; None where nothing is said."""

    photographs: Path
    ground_points: tuple[tuple[Path, Role], ...]
    marks: Path | None
    crs: str | None
    project: Path
    picture_size_px: tuple[int, int] | None
    control_sigma_m: float | None
    heights: HeightSystem | None
    geoid: str | None
    focal_px: float | None
    recursive: bool
    force: bool


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _names(folder: Path, recursive: bool) -> list[str]:
    """Return the names of the photographs in the folder, relative to it."""
    if not isdir(folder):
        raise ImageError(f"{folder}: folder not found: give the folder of the photographs")
    try:
        found = folder.rglob("*") if recursive else folder.iterdir()
        paths = [p.relative_to(folder) for p in found if p.suffix.lower() in _SUFFIXES and p.is_file()]
    except OSError as fault:
        raise ImageError(f"{folder}: cannot be read ({fault.strerror}): check its permissions") from fault
    names = sorted(p.as_posix() for p in paths if not _is_hidden(p))
    if not names:
        within = "" if recursive else "; --recursive searches subfolders"
        raise ImageError(f"{folder}: no photographs (JPEG or TIFF) found: give the folder of the photographs{within}")
    return names


def _inspected(folder: Path, name: str) -> TaggedPhotograph | LeftOut:
    if not name.isprintable():
        return LeftOut(repr(name), "its name has unprintable characters: rename it")
    path = folder / name
    try:
        return TaggedPhotograph(name, inspect_photograph(path))
    except ImageError as fault:
        return LeftOut(name, str(fault).removeprefix(f"photograph {path}: "))


def _inspect(folder: Path, names: list[str]) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    found: list[TaggedPhotograph | LeftOut] = []
    with steps("Photographs", len(names)) as progress, ThreadPoolExecutor(os.cpu_count()) as executor:
        for result in executor.map(lambda name: _inspected(folder, name), names):
            found.append(result)
            progress(len(found), len(names), result.name)
    return (
        [p for p in found if isinstance(p, TaggedPhotograph)],
        [p for p in found if isinstance(p, LeftOut)],
    )


def _without_copies(folder: Path, photographs: list[TaggedPhotograph]) -> tuple[list[TaggedPhotograph], list[LeftOut]]:
    """Return the photographs once each, and those that are copies of another."""
    paths, tags = [folder / p.name for p in photographs], [p.tags for p in photographs]
    with ThreadPoolExecutor(os.cpu_count()) as executor:
        groups = find_copies(paths, tags, [None] * len(paths), executor)
    original = {i: group[0] for group in groups for i in group[1:]}
    return (
        [p for i, p in enumerate(photographs) if i not in original],
        [
            LeftOut(photographs[i].name, f"the same photograph as {photographs[first].name}")
            for i, first in original.items()
        ],
    )


def _relative(path: Path, project: Path) -> str:
    return Path(os.path.relpath(path.absolute(), project.absolute().parent)).as_posix()


def _control_file(
    path: Path, role: Role, marks: Path | None, project: Path, size: tuple[int, int] | None, sigma_m: float | None
) -> ControlFile:
    file = read_points(path)
    return ControlFile(
        _relative(path, project),
        role,
        np.array([p.position for p in file.points]).reshape(-1, 3),
        file.crs,
        file.geographic,
        file.holds_marks,
        all(None not in p.sigma_m for p in file.points),
        None if file.holds_marks or marks is None else _relative(marks, project),
        size,
        None if sigma_m is None else (sigma_m, sigma_m, sigma_m),
    )


def _geoid(geoid: str | None, project: Path) -> str | None:
    return geoid if geoid is None or not isfile(geoid) else _relative(Path(geoid), project)


def _positions(folder: Path, names: list[str], recursive: bool, project: Path) -> tuple[DraftPositions, ...]:
    """Return the MRK files beside the photographs with their rows; those that cannot be used with the reason."""
    found = folder.rglob("*") if recursive else folder.iterdir()
    paths = sorted(
        p for p in found if p.suffix.lower() == ".mrk" and p.is_file() and not _is_hidden(p.relative_to(folder))
    )
    files = []
    for path in paths:
        here = path.relative_to(folder).parent.as_posix()
        beside = [name for name in names if PurePosixPath(name).parent.as_posix() == here]
        written = _relative(path, project)
        try:
            matching = match_rows(read_mrk(path), beside or names)
            files.append(DraftPositions(written, matching.rows, matching.fault))
        except ProjectError as fault:
            lines = str(fault).splitlines()
            more = f" and {len(lines) - 1} more errors" if len(lines) > 1 else ""
            files.append(DraftPositions(written, fault=lines[0].removeprefix(f"{path}:") + more))
    return tuple(files)


def _show(draft: ProjectDraft, project: Path) -> None:
    table = Table(title=escape(str(project)), show_header=False)
    flights = f" in {count(draft.flights, 'flight')}"
    table.add_row("photographs", f"{len(draft.photographs)}{flights}")
    for camera in draft.cameras:
        number = sum(p.camera == camera.name for p in draft.photographs)
        focal = f"f {camera.focal_px:.0f} ± {camera.sigmas[0]:.0f} px"
        table.add_row(camera.name, f"{count(number)}, {focal}: {escape(camera.source)}")
    kinds = ", ".join(f"{number} {kind}" for kind, number in draft.gnss_kinds.items())
    without = sum(p.gnss is None for p in draft.photographs)
    table.add_row(
        "GNSS", ", ".join(part for part in (kinds, f"{without} without a position" if without else "") if part)
    )
    for positions in draft.positions:
        text = f"of {count(len(positions.rows))}" if positions.rows else f"not used: {positions.fault}"
        table.add_row("positions", f"{escape(positions.path)}: {escape(text)}")
    attitudes = sum(p.has_attitude for p in draft.photographs)
    table.add_row("attitude", f"in the tags of {count(attitudes)}" if attitudes else "none")
    table.add_row("map grid", escape(f"{draft.crs} ({draft.crs_name}), {draft.crs_reason}"))
    if not draft.height_systems.known:
        table.add_row("heights", escape(f"say in {project} whether they are above the ellipsoid or a geoid"))
    for file in draft.control:
        table.add_row(file.role, f"{count(len(file.position), 'point')} of {escape(file.path)}")
        if not file.has_marks and file.marks is None:
            table.add_row("", f"no marks in photographs for {escape(file.path)}: give them with --marks FILE")
    for site in draft.other_sites:
        where = f"{site.distance_m / 1000:.1f} km away at {site.longitude_deg:.4f}, {site.latitude_deg:.4f}"
        table.add_row("another site, left out", f"{count(len(site.names))} {where}: {escape(_short(site.names))}")
    for photograph in draft.left_out[:10]:
        table.add_row("left out", escape(f"{photograph.name}: {photograph.reason}"))
    for warning in draft.warnings:
        table.add_row("[yellow]warning[/yellow]", escape(warning))
    if len(draft.left_out) > 10:
        table.add_row("left out", f"and {len(draft.left_out) - 10} more, see {escape(str(project))}")
    console.print(table)


def _short(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{names[0]} … {names[-1]}"


def _check_ranges(wanted: Request) -> None:
    """Refuse figures that cannot be. Raises typer.BadParameter."""
    width, height = wanted.picture_size_px or (None, None)
    given: list[tuple[str, float | None, Within]] = [
        ("--picture-size", width, PIXELS),
        ("--picture-size", height, PIXELS),
        ("--control-sigma", wanted.control_sigma_m, SIGMA_M),
        ("--focal-px", wanted.focal_px, FOCAL_PX),
    ]
    for option, value, allowed in given:
        if value is not None and not allowed.holds(value):
            raise typer.BadParameter(f"{value:g} must be {allowed}", param_hint=option)


def run(wanted: Request) -> None:
    """Read the tags of the photographs, write the project file and show what is in it."""
    _check_ranges(wanted)
    project, photographs = wanted.project, wanted.photographs
    if exists(project) and not wanted.force:
        raise ProjectError(
            f"{project}: the project file exists already: give another with --project FILE, or --force to overwrite it"
        )
    names = _names(photographs, wanted.recursive)
    files = tuple(
        _control_file(path, role, wanted.marks, project, wanted.picture_size_px, wanted.control_sigma_m)
        for path, role in wanted.ground_points
    )
    tagged, unreadable = _inspect(photographs, names)
    tagged, copies = _without_copies(photographs, tagged)
    positions = _positions(photographs, [p.name for p in tagged], wanted.recursive, project)
    wishes = Wishes(wanted.crs, wanted.focal_px, files, wanted.heights, _geoid(wanted.geoid, project), positions)
    draft = draft_project(tagged, [*unreadable, *copies], wishes)
    with replacing(project) as partial:
        partial.write_text(project_text(draft, _relative(photographs, project)), encoding="utf-8")
    _show(draft, project)
    try:
        written = load_project(project)
    except ProjectError as fault:
        raise ProjectError(f"{project} written; fix these errors first:\n{fault}") from fault
    for finding in written.warnings:
        console.print(f"[yellow]warning[/yellow] {escape(str(finding))}")
    console.print(f"Next: photogram check {escape(str(project))}, then photogram adjust {escape(str(project))}")
