"""What `photogram import` does."""

from pathlib import Path

from rich.markup import escape
from rich.table import Table

from photogram.exchange.solution_import import ImportedProject, import_solution
from photogram.terminal.console import console, steps
from photogram.wording import things

_TIE_POINTS = {"theirs": "those of the solution", "own": "matched by photogram"}
_POSES = {"theirs": "those of the solution, as initial values", "own": "found by photogram"}


def run(
    solution: Path, photographs: Path | None, crs: str | None, checks: list[str], project: Path, *, force: bool
) -> None:
    """Write the project and the files beside it, and show what is in it."""
    with steps("Import") as progress:
        progress(0, 0, f"reading {solution.name}")
        imported = import_solution(
            solution, photographs=photographs, project=project, crs=crs, check=checks, force=force, progress=progress
        )
    _show(imported)
    for finding in imported.warnings:
        console.print(f"[yellow]warning[/yellow] {escape(str(finding))}")
    name = escape(str(project))
    console.print(f"Next: photogram check {name}, then photogram adjust {name}")


def _show(imported: ImportedProject) -> None:
    draft = imported.draft
    table = Table(title=escape(str(imported.path)), show_header=False)
    missing = f", {things(len(draft.left_out), 'photograph')} of the solution left out" if draft.left_out else ""
    table.add_row("solution", escape(f"{draft.program}: {draft.contents}"))
    table.add_row("photographs", f"{len(draft.photographs)} in {things(draft.flights, 'flight')}{missing}")
    for camera, reason in zip(draft.cameras, draft.camera_reasons, strict=True):
        table.add_row(escape(camera.name), escape(f"f {camera.focal_px:.1f} px: {reason}"))
    table.add_row("tie points", _TIE_POINTS[draft.tie_points])
    table.add_row("poses", _POSES[draft.poses])
    kinds = [g.kind for g in draft.gnss if g is not None]
    table.add_row("positions", ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)) or "none")
    table.add_row("map grid", escape(f"{draft.crs} ({draft.crs_name}), {draft.crs_reason}"))
    checks = sum(p.role is not None and "control" not in p.role for p in draft.points)
    table.add_row(
        "ground points",
        f"{things(len(draft.points) - checks, 'control point')}, {things(checks, 'check point')}, "
        f"{things(len(draft.marks), 'mark')}"
        if draft.points
        else "none",
    )
    for photograph in draft.left_out[:10]:
        table.add_row("left out", escape(f"{photograph.name}: {photograph.reason}"))
    if len(draft.left_out) > 10:
        table.add_row("left out", f"and {len(draft.left_out) - 10} more, see {escape(str(imported.path))}")
    console.print(table)
    for sentence in imported.left_out:
        console.print(f"Left out: {escape(sentence)}", soft_wrap=True, highlight=False)
