"""What is refused before anything that computes is imported: within a second, whatever a command is pointed at."""

from collections.abc import Iterable
from pathlib import Path


def check_project_file(path: Path) -> None:
    """Raise ProjectError where a project file cannot be read, is far too large, or is not YAML."""
    from photogram.project.document import check_syntax

    check_syntax(path)


def check_tables(paths: Iterable[Path]) -> None:
    """Raise ProjectError where a table of points or marks cannot be read, is far too large, or is not text."""
    from photogram.errors import ProjectError
    from photogram.files.text_lines import table_text_of

    for path in paths:
        table_text_of(path, ProjectError)


def check_clouds(paths: Iterable[Path]) -> None:
    """Raise ProjectError where a LAS or LAZ file cannot be what its header says; others are left to their readers."""
    from photogram.files.clouds.las_headers import check_las

    for path in paths:
        if path.suffix.lower() in (".las", ".laz") and path.is_file():
            check_las(path)
