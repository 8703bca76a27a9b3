"""What `photogram init` does."""

from pathlib import Path

import typer
from rich.markup import escape
from rich.table import Table

from photogram.pipeline.new_project import Request, read_back, write_project
from photogram.project.draft.assumptions import assumptions
from photogram.project.draft.draft import ProjectDraft
from photogram.terminal.console import console, steps
from photogram.wording import some, things

_OPTIONS = {
    "picture_size_px": "--picture-size",
    "control_sigma_m": "--control-sigma",
    "focal_px": "--focal-px",
}


def _show(draft: ProjectDraft, project: Path) -> None:
    table = Table(title=escape(str(project)), show_header=False)
    flights = f" in {things(draft.flights, 'flight')}"
    table.add_row("photographs", f"{len(draft.photographs)}{flights}")
    for camera in draft.cameras:
        number = sum(p.camera == camera.name for p in draft.photographs)
        focal = f"f {camera.focal_px:.0f} ± {camera.sigmas[0]:.0f} px"
        table.add_row(camera.name, f"{things(number, 'photograph')}, {focal}: {escape(camera.source)}")
    kinds = ", ".join(f"{number} {kind}" for kind, number in draft.gnss_kinds.items())
    without = sum(p.gnss is None for p in draft.photographs)
    table.add_row(
        "GNSS", ", ".join(part for part in (kinds, f"{without} without a position" if without else "") if part)
    )
    if draft.heights:
        table.add_row("heights", escape(draft.heights))
    for positions in draft.positions:
        text = f"of {things(len(positions.rows), 'photograph')}" if positions.rows else f"not used: {positions.error}"
        table.add_row("positions", f"{escape(positions.path)}: {escape(text)}")
    if draft.masks is not None:
        masks = draft.masks
        text = f"not used: {masks.error}" if masks.error else f"of {things(masks.photographs, 'photograph')}"
        table.add_row("masks", f"{escape(masks.path)}: {escape(text)}")
    attitudes = sum(p.has_attitude for p in draft.photographs)
    table.add_row("attitude", f"in the tags of {things(attitudes, 'photograph')}" if attitudes else "none")
    table.add_row("map grid", escape(f"{draft.crs} ({draft.crs_name}), {draft.crs_reason}"))
    for file in draft.control:
        points = f"{things(len(file.position), 'point')} of {escape(file.path)}"
        where = f", in {file.grid}, where they lie among the photographs" if file.grid is not None else ""
        table.add_row(file.role, points + where)
        if file.lacks_marks:
            text = f"no marks for {escape(file.path)} yet: photogram mark makes them, --marks FILE gives them"
            table.add_row("", text)
    for site in draft.other_sites:
        where = f"{site.distance_m / 1000:.1f} km away at {site.longitude_deg:.4f}, {site.latitude_deg:.4f}"
        table.add_row(
            "another site, left out", f"{things(len(site.names), 'photograph')} {where}: {escape(_short(site.names))}"
        )
    reasons = list(draft.left_out_for.items())
    for reason, names in reasons[:10]:
        table.add_row("left out", escape(f"{some(names)}: {reason}"))
    for warning in draft.warnings:
        table.add_row("[yellow]warning[/yellow]", escape(warning))
    more = sum(len(names) for _, names in reasons[10:])
    if more:
        table.add_row("left out", f"and {more} more, see {escape(str(project))}")
    if draft.tags_passed_over:
        table.add_row("tags not read", escape(some(draft.tags_passed_over, 10)))
    if draft.others:
        table.add_row("not read", escape(f"{things(len(draft.others), 'other file')}: {some(draft.others)}"))
    if draft.unsearched:
        table.add_row("not searched", escape(f"{some(draft.unsearched)}: --recursive searches folders within"))
    console.print(table)
    assumed = Table("assumed, since nothing states it", "as", "what becomes of it")
    for assumption in assumptions(draft):
        assumed.add_row(*map(escape, assumption))
    if assumed.row_count:
        console.print(assumed)


def _short(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{names[0]} … {names[-1]}"


def run(wanted: Request) -> None:
    """Read the tags of the photographs, write the project file and show what is in it."""
    for name, value, allowed in wanted.out_of_range():
        raise typer.BadParameter(f"{value:g} must be {allowed}", param_hint=_OPTIONS[name])
    project = wanted.project
    with steps("Photographs") as progress:
        draft = write_project(wanted, progress)
    _show(draft, project)
    for finding in read_back(project):
        console.print(f"[yellow]warning[/yellow] {escape(str(finding))}")
    name = escape(str(project))
    if any(file.lacks_marks for file in draft.control):
        console.print(f"Next: photogram mark {name}, to mark the points in the photographs")
        console.print(f"Then: photogram check {name}, then photogram adjust {name}")
    else:
        console.print(f"Next: photogram check {name}, then photogram adjust {name}")
