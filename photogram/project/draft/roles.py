"""Roles of ground points written into a project file, as they were chosen on a page."""

from collections.abc import Callable, Mapping
from pathlib import Path

from photogram.errors import ProjectError
from photogram.project.control.mark_entries import mark_entries
from photogram.project.document import Document
from photogram.project.draft.edits import write_values
from photogram.survey import Role


def write_roles(project: Path, roles: Mapping[str, Role], check: Callable[[Path], object]) -> None:
    """Give ground points roles, by their names: in their own entry those that the project file lists, in the entry of
    their file the others. Raises ProjectError where there is no such point, ControlPointError where a file of points
    cannot be read, and as ``write_values``."""
    listed = Document(project).at(("control_points", "list"))
    own = [
        entry.get("name") if isinstance(entry, dict) else None for entry in (listed if isinstance(listed, list) else [])
    ]
    files, _ = mark_entries(project)

    def key(name: str) -> tuple[str | int, ...]:
        if name in own:
            return "control_points", "list", own.index(name), "role"
        for number, entry in enumerate(files):
            if name in entry.names:
                return "control_points", "files", number, "roles", name
        raise ProjectError(f"{project}: there is no ground point {name!r}: reload the page")

    write_values(project, {key(name): role for name, role in roles.items()}, check)
