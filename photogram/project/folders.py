"""Where a project keeps its photographs, inputs, intermediate results and results.

Arrangements in which photogram would write over, or remove, what is not its own are errors of the project file.
"""

from collections.abc import Iterator, Sequence
from os.path import islink
from pathlib import Path

from photogram.files.stage_folders import stage_folder_around
from photogram.project.document import Document, Key, read_entry
from photogram.project.schema import PhotographEntry, ProjectFile
from photogram.result_files import FORMER_FOLDERS, WRITTEN_IN_RESULTS

GRID_SUFFIXES = (".gtx", ".tif", ".tiff", ".gsb", ".gri", ".byn", ".bin")
_OWN_KEY: Key = ("work",)
_PROJECT_FILES = (".yaml", ".yml")


def _file_named(section: object, key: str) -> str | None:
    """Return the file that a section of settings names under a key, None where it names none."""
    name = section.get(key) if isinstance(section, dict) else None
    return name if isinstance(name, str) and name.strip() else None


def _input_files(document: Document, file: ProjectFile) -> Iterator[tuple[Key, Path]]:
    """Yield every file but the photographs that a project reads, and the key that names it; the project file itself
    under the key of the work folder."""
    yield _OWN_KEY, document.path.absolute()
    named: list[tuple[Key, str | None]] = [
        (("comparison", "reference"), file.comparison.reference),
        (("orthophoto", "seams"), _file_named(file.orthophoto, "seams")),
        (("known_surface", "path"), _file_named(file.known_surface, "path")),
        (("known_surface", "stable"), _file_named(file.known_surface, "stable")),
        (("surface", "area"), _file_named(file.surface, "area")),
        (("volumes", "polygons"), _file_named(file.volumes, "polygons")),
        (("volumes", "reference"), _file_named(file.volumes, "reference")),
        *((("cameras", name, "matlab"), camera.matlab) for name, camera in file.cameras.items()),
        *((("cameras", name, "mask"), camera.mask) for name, camera in file.cameras.items()),
    ]
    for i, positions in enumerate(file.photographs.positions):
        key: Key = ("photographs", "positions", i)
        named += [((*key, "path"), positions.path), ((*key, "lever_arms"), positions.lever_arms)]
    for i, points in enumerate(file.control_points.files):
        key = ("control_points", "files", i)
        named += [((*key, "path"), points.path), ((*key, "marks"), points.marks)]
    if file.heights is not None:
        geoid = file.heights.geoid
        named.append((("heights", "grid"), file.heights.grid))
        named.append((("heights", "geoid"), geoid if geoid and Path(geoid).suffix.lower() in GRID_SUFFIXES else None))
    yield from ((key, document.base / name) for key, name in named if name is not None)


def input_files(project: Path) -> dict[str, Path]:
    """Return every file but itself and the photographs that a project file names, by the keys that name it; of a
    camera's mask, say, ``cameras.NAME.mask``. Raises ProjectError where the project file cannot be read."""
    document = Document(project)
    named = _input_files(document, read_entry(document, ProjectFile))
    return {".".join(map(str, key)): path for key, path in named if key != _OWN_KEY}


def check_folders(
    document: Document, file: ProjectFile, photographs: Sequence[PhotographEntry] | None, folder: Path | None
) -> None:
    """Note every arrangement of folders in which something of the user's would be touched.

    ``folder`` holds the photographs. Links count as what they lead to.
    """
    work, results = document.base / file.work, document.base / file.results
    try:
        inputs, pictures = list(_input_files(document, file)), list(_photographs(photographs, folder))
        _check_same(document, work, results, folder)
        _check_results(document, results, [*inputs, *pictures])
        places: list[tuple[Key, str, Path | None]] = [
            (("work",), "the folder of the photographs", folder),
            (("results",), "the folder of results", results),
        ]
        places += [(key, "the file", place) for key, place in inputs]
        places += [(key, "the photograph", place) for key, place in pictures]
        _check_stages(document, work, places)
    except (OSError, RuntimeError) as error:  # a loop of links; which of the two depends on the version of Python
        document.add_error(("work",), f"the folders of the project cannot be distinguished ({error}): name others")


def _photographs(photographs: Sequence[PhotographEntry] | None, folder: Path | None) -> Iterator[tuple[Key, Path]]:
    """Yield a photograph of every folder that has any, and every one that is a link."""
    seen: set[Path] = set()
    for photograph in photographs or ():
        if folder is not None and photograph.name is not None:
            place = folder / photograph.name
            if place.parent not in seen or islink(place):
                seen.add(place.parent)
                yield ("photographs",), place


def _check_same(document: Document, work: Path, results: Path, folder: Path | None) -> None:
    remedy = "give the {} their own"
    if folder is not None and folder.resolve() == work.resolve():
        document.add_error(("work",), f"is the folder of the photographs too: {remedy.format('intermediate results')}")
    if results.resolve() == work.resolve():
        document.add_error(("work",), f"is the folder of the results too: {remedy.format('intermediate results')}")
    if folder is not None and folder.resolve() == results.resolve():
        document.add_error(("results",), f"is the folder of the photographs too: {remedy.format('results')}")


def _check_results(document: Document, results: Path, places: Sequence[tuple[Key, Path]]) -> None:
    """Note inputs that lie where photogram writes its results: one of the same name would be written over."""
    written = {(results / name).resolve() for name in ("", *WRITTEN_IN_RESULTS, *FORMER_FOLDERS)}
    for _, place in places:
        if place.suffix.lower() in _PROJECT_FILES:
            continue  # no result is called so
        for own in dict.fromkeys((place.parent.resolve(), place.resolve().parent)):
            if own in written:
                document.add_error(
                    ("results",),
                    f"photogram writes its results to {own}, where {place.name} lies, which it reads: "
                    "give the results a folder of their own",
                )
                break


def _check_stages(document: Document, work: Path, places: Sequence[tuple[Key, str, Path | None]]) -> None:
    for key, what, place in places:
        if place is None:
            continue
        # a link counts for where it is as well as for what it leads to
        around = stage_folder_around(work, place) or stage_folder_around(work, place.parent)
        if around is not None:
            document.add_error(
                key,
                f"{what} {place} lies in {around}, a folder that photogram makes and removes as it works: "
                "move it, or give another folder under work",
            )
