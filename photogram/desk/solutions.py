"""Solutions of other programs that lie in a folder, and a survey that begins with one."""

from pathlib import Path

from typing_extensions import TypedDict

from photogram.errors import ProjectError
from photogram.exchange.formats.recognition import recognised
from photogram.exchange.solution_import import import_solution
from photogram.languages.said import Said


class SolutionFile(TypedDict):
    """A solution of another program."""

    file: str
    """Its file or folder, from the folder of the survey."""
    program: str


def solutions_in(folder: Path) -> list[SolutionFile]:
    """Return the solutions in a folder. Raises ExchangeError where it cannot be looked through."""
    return [{"file": place.relative_to(folder).as_posix(), "program": each.name} for each, place in recognised(folder)]


def begin_with(folder: Path, solution: str, photographs: Path, project: Path, crs: str | None) -> None:
    """Write the project file of a survey that goes on from a solution in its folder. Raises as ``import_solution``, and
    ProjectError for a solution that is not in the folder."""
    if solution not in {found["file"] for found in solutions_in(folder)}:
        raise ProjectError(
            Said("{file}: no solution in {folder}: choose one of those that are listed", file=solution, folder=folder)
        )
    import_solution(folder / solution, photographs=photographs, project=project, crs=crs)
