"""A survey in one file: its results, with a record of what they were made of."""

import zipfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict

from photogram import __version__
from photogram.files.atomic import replacing
from photogram.files.npz_json import file_fingerprint, text_of
from photogram.files.stage_folders import errors_of
from photogram.files.zip_archives import add_file, zip_entry
from photogram.pipeline.store.run import Run
from photogram.project.folders import input_files
from photogram.project.project import SECTIONS
from photogram.report.versions import versions
from photogram.result_files import ResultFolder
from photogram.wording import things

PACKAGE = "survey.zip"
RECORD = "record"
"""Folder in the archive for what the results were made of."""
INPUTS = "inputs.json"


class InputFile(TypedDict):
    """A file that a survey was made of."""

    name: str
    bytes: int
    sha256: str


class InputRecord(TypedDict):
    """What a survey was made of: ``files`` by the keys of the project file that name them."""

    photogram: str
    versions: dict[str, str | None]
    project: InputFile
    photographs: list[InputFile]
    files: dict[str, InputFile]
    settings: dict[str, object]
    """Of each section of the project file, as they took part: those that it does not give too."""


def input_record(run: Run) -> InputRecord:
    """Return what the survey of a run is made of. Raises WorkspaceError where a file cannot be read."""
    project = run.project
    named = input_files(project.path)
    return {
        "photogram": __version__,
        "versions": versions(),
        "project": _described(project.path),
        "photographs": [
            {"name": p.name, "bytes": p.path.stat().st_size, "sha256": checksum}
            for p, checksum in zip(project.photographs, run.photograph_fingerprints, strict=True)
        ],
        "files": {key: _described(path) for key, path in named.items() if path.is_file()},
        "settings": {name: asdict(getattr(project, name)) for name in SECTIONS},
    }


def _described(path: Path) -> InputFile:
    with errors_of(path, "cannot be read"):
        return {"name": path.name, "bytes": path.stat().st_size, "sha256": file_fingerprint(path)}


def write_package(path: Path, project: Path, results: Path, record: InputRecord) -> str:
    """Write an archive (ZIP) of the folders of ``results``, and of ``record`` beside a copy of the ``project`` file in
    a folder of its own; return in words what it holds. It is written whole or not at all, and the same survey gives the
    same bytes. Raises WorkspaceError where a file cannot be read or written."""
    files = [file for file in _packed(results) if file.resolve() != path.resolve()]
    with replacing(path) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in files:
            add_file(archive, file, file.relative_to(results).as_posix())
        add_file(archive, project, f"{RECORD}/{project.name}")
        archive.writestr(zip_entry(f"{RECORD}/{INPUTS}"), text_of(record))
    return f"{things(len(files), 'file')} of {', '.join(ResultFolder)}, and what they were made of"


def _packed(results: Path) -> Iterator[Path]:
    for folder in ResultFolder:
        within = sorted((results / folder).rglob("*"))
        yield from (path for path in within if path.is_file() and not path.is_symlink() and path.name[0] != ".")
