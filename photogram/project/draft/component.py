"""The project of a component that nothing ties to the rest of its survey: the same photographs and settings, as a free
network."""

import glob
import json
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from photogram.errors import PhotogramError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.project.document import Document
from photogram.project.project import Project

WRITTEN = "# Written by photogram adjust: photographs that nothing ties to the rest of the survey, as a free network."
_KEPT = ("photogram", "quality", "cameras", "features", "pairs", "matching", "transfer", "adjustment", "report")
"""Blocks that mean the same without a map; what counts metres or names control points has no place in it."""
_OF_PHOTOGRAPHS, _OF_A_PHOTOGRAPH = ("masks", "camera"), ("name", "camera", "flight")


def component_path(survey: Project, number: int) -> Path:
    """Return where the project of a component stands: beside that of its survey, since paths count from there."""
    return survey.path.with_name(f"{survey.path.stem}_component_{number}.yaml")


def _chosen(block: object, keys: Collection[str]) -> dict[str, object]:
    return {key: value for key, value in block.items() if key in keys} if isinstance(block, dict) else {}


def component_text(survey: Project, photographs: Collection[str], number: int) -> str:
    """Return the project file of a component of some photographs by name. Raises ProjectError where the survey's own
    can no longer be read."""
    document = Document(survey.path)
    whole = _chosen(document.value, (*_KEPT, "photographs"))
    given = whole.pop("photographs", {})
    listed = given.get("list") if isinstance(given, dict) else None
    entries = (
        [entry for each in listed if (entry := _chosen(each, _OF_A_PHOTOGRAPH)).get("name") in photographs]
        if isinstance(listed, list)
        else [{"name": name} for name in photographs]
    )
    given_folder = survey.photographs_folder
    folder = _chosen(given, ("folder",)) if given_folder is None else {"folder": str(given_folder.resolve())}
    blocks: dict[str, object] = {
        **whole,
        "crs": "none",
        "photographs": {**folder, **_chosen(given, _OF_PHOTOGRAPHS), "list": entries},
        "results": f"{survey.results.name}_component_{number}",
        "work": f"{survey.work.name}_component_{number}",
    }
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in blocks.items()]
    return "\n".join([WRITTEN, *lines, ""])


def _is_written(path: Path) -> bool:
    """Return whether a file is the project of a component that ``write_component`` has written. Raises OSError where it
    cannot be read."""
    return path.is_file() and path.read_bytes().startswith(WRITTEN.encode())


def write_component(survey: Project, photographs: Collection[str], number: int) -> Path:
    """Write the project of a component and return where. Raises WorkspaceError where another file of that name stands
    there, or nothing can be written."""
    path = component_path(survey, number)
    try:
        if path.exists() and not _is_written(path):
            raise WorkspaceError(f"{path}: not written by photogram adjust: rename it, a component goes there")
        with replacing(path) as partial:
            partial.write_text(component_text(survey, photographs, number), encoding="utf-8")
    except OSError as error:
        if isinstance(error, PhotogramError):
            raise
        raise WorkspaceError(f"{path}: {error.strerror}: allow writing beside the project file") from error
    return path


def earlier_components(survey: Project, written: Collection[Path]) -> list[Path]:
    """Return the projects of components that an earlier adjustment has written, and this one has not ``written``;
    nothing is known of files that cannot be read."""
    earlier = list[Path]()
    for path in sorted(survey.path.parent.glob(f"{glob.escape(survey.path.stem)}_component_*.yaml")):
        with suppress(OSError):
            if path not in written and _is_written(path):
                earlier.append(path)
    return earlier
