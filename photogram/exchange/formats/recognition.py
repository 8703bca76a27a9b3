"""Whose solution a file or folder is, by what it holds and not by what it is called."""

from pathlib import Path

from photogram.errors import ExchangeError
from photogram.exchange.formats.table import FORMATS, Format
from photogram.files.solutions.solution import ForeignSolution

_HEAD_BYTES = 4096
_DEPTH = 3
"""Folders below the one that is named in which a solution is looked for: sparse/0, opensfm."""


def read_solution(path: Path | str) -> ForeignSolution:
    """Return the solution that a file or folder holds, whosever it is.

    A folder that is none itself may have one in a folder below it. Raises ExchangeError where nothing is recognised or
    several solutions are there, and as the readers do.
    """
    path = Path(path)
    solutions = recognised(path)
    if not solutions:
        names = ", ".join(each.name for each in FORMATS)
        raise ExchangeError(
            f"{path}: holds no solution that photogram knows: name the file or folder of one of {names}"
        )
    if len(solutions) > 1:
        places = ", ".join(f"{place} ({each.name})" for each, place in solutions)
        raise ExchangeError(f"{path}: holds several solutions: name one of {places}")
    (each, place) = solutions[0]
    return each.read(place)


def recognised(path: Path) -> list[tuple[Format, Path]]:
    """Return the solutions that a file or folder holds, with their places: those of the uppermost folder that has any.

    Raises ExchangeError where the path cannot be looked at.
    """
    try:
        if not path.is_dir():
            return _of_file(path)
        level = [path]
        for _ in range(_DEPTH):
            solutions = [one for folder in level for one in _of_folder(folder)]
            if solutions:
                return solutions
            level = [below for folder in level for below in sorted(folder.iterdir()) if below.is_dir()]
    except (OSError, ValueError) as error:
        raise ExchangeError(f"{path}: cannot be read ({error}): check the name and its permissions") from error
    return []


def _of_file(path: Path) -> list[tuple[Format, Path]]:
    if not path.is_file():
        raise ExchangeError(f"{path}: file not found, or not a regular file: check the name")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    return [(each, path) for each in FORMATS if each.is_file(path, head)][:1]


def _of_folder(folder: Path) -> list[tuple[Format, Path]]:
    own = [(each, folder) for each in FORMATS if each.is_folder(folder)]
    if own:
        return own[:1]
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    return [one for path in files for one in _of_file(path)]
