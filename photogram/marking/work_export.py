"""What `photogram mark --export` does."""

from pathlib import Path

from rich.markup import escape

from photogram.files.marks.formats import MarkFormat
from photogram.marking.mark_export import export_marks
from photogram.terminal.console import console
from photogram.wording import things


def run(project: Path, photographs: Path | None, target: Path, form: MarkFormat | None, overwrite: bool) -> None:
    """Write points and marks for another program, and say what was left out."""
    written = export_marks(project, target, form, photographs=photographs, overwrite=overwrite)
    for note in written.notes:
        console.print(f"[yellow]warning[/yellow] {escape(note)}", soft_wrap=True, highlight=False)
    content = f"{things(written.points, 'point')} in {written.crs}, {things(written.marks, 'mark')}"
    console.print(f"Exported: {escape(content)}", soft_wrap=True, highlight=False)
    for file in written.files:
        console.print(escape(str(file)), soft_wrap=True, highlight=False)
