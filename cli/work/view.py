"""What `photogram view` does."""

import webbrowser
from pathlib import Path

from rich.markup import escape

from photogram.errors import ReportError
from photogram.pipeline.view import cloud_of, read_pictures, read_results, results_folder, write_page
from photogram.terminal.console import console, steps


def run(results: Path, points: int, cloud: Path | None, photographs: Path | None, show: bool) -> None:
    """Write the page of a folder of results, and open it if asked for."""
    results = results_folder(results)
    record = read_results(results)
    path = cloud or cloud_of(results)
    with steps("Pictures") as progress:
        pictures = read_pictures(results, record, photographs, progress)
    for note in pictures.notes:
        console.print(note, soft_wrap=True, markup=False)
    with steps("3-D view") as progress:
        target = write_page(results, record, path, pictures, points, progress)
    console.print(f"Written: {escape(str(target))}, {target.stat().st_size / 1e6:.1f} MB", soft_wrap=True)
    if show and not webbrowser.open(target.absolute().as_uri()):
        raise ReportError(f"no browser found: open {target} yourself")
