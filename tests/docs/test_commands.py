"""Every command of every page: its arguments are those it has, and it runs on a small simulated survey."""

import re
import shlex
import shutil
import subprocess
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import rasterio
import typer
from changed_surveys import write_polygons
from pages import ROOT, CodeBlock, blocks
from shapely.geometry import box

from photogram.cli.app import app
from photogram.simulation.simulated_survey import SurveyPlan, render_photographs, simulate
from photogram.simulation.survey_files import write_survey

pytestmark = pytest.mark.survey

UNTIL_ENDED = re.compile(r"photogram (desk|serve|mark project\.yaml$)|dask |podman ")
ELSEWHERE = {
    r"project\.psz|reconstruction\.json": "tests/exchange reads what other programs write",
    r"--scheduler": "tests/pipeline has a scheduler",
    r"photogram epochs": "tests/change/test_epochs.py has two days",
    r"photogram demo|pip install|python3 -m venv": "make demo",
}
"""Commands that cannot run on the small survey, and what runs them."""
FRESH = {"README.md", "docs/epochs.md", "docs/marking.md", "docs/whole-surveys.md"}
"""Pages that begin with photographs and points, and no project file."""
OTHERS = {"docs/real-survey.md", "docs/course/index.md", "examples/dtu_phantom4/README.md", "CONTRIBUTING.md"}
"""Pages of surveys that are not here, of the notebooks, and of the tests themselves."""

LINES = [
    pytest.param(line, id=f"{block.page}:{line}")
    for block in blocks("sh")
    for line in block.code.splitlines()
    if line.startswith(("photogram ", ".venv/bin/photogram "))
]


def words(line: str) -> list[str]:
    """Return the words of a command without its comment."""
    return shlex.split(line, comments=True)


@pytest.mark.parametrize("line", LINES)
def test_the_arguments_are_those_of_the_command(line: str) -> None:
    group: Any = typer.main.get_command(app)
    arguments = words(line)[1:]
    while hasattr(group, "resolve_command"):
        context = group.context_class(group)
        _, group, arguments = group.resolve_command(context, arguments)
    until = arguments.index(">") if ">" in arguments else len(arguments)
    with group.make_context("photogram", arguments[:until]) as context:
        assert context.args == []


@pytest.mark.parametrize("block", blocks("sh", "README.md", "CONTRIBUTING.md"), ids=str)
def test_make_and_pytest_find_what_they_are_asked_for(block: CodeBlock) -> None:
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for program, *arguments in map(words, block.code.splitlines()):
        if program == "make":
            assert arguments[0] in targets
        elif program == "pytest":
            assert all((ROOT / path).exists() for path in arguments if path.startswith("tests/"))


class Site:
    """The folder in which the commands of a page run: a survey, and what else they name."""

    def __init__(self, folder: Path, page: str, photogram: Callable[..., Any]) -> None:
        self.folder = folder
        self.page = page
        self.photogram = photogram

    def make_what_is_named(self, line: str) -> None:
        """Make the files and folders that a command names and that are no part of the survey."""
        photographs, results = self.folder / "photographs", self.folder / "results"
        made: dict[str, Callable[[Path], object]] = {
            "DIR": lambda path: shutil.copytree(photographs, path),
            "DIR/points_agisoft.txt": self._text_cloud,
            "FOLDER": lambda path: shutil.copytree(photographs, path),
            "june": lambda path: shutil.copytree(results, path / "results"),
            "may": lambda path: shutil.copytree(results, path / "results"),
            "heaps.gpkg": lambda path: self._polygon(path, -6.0, 6.0),
            "road.gpkg": lambda path: self._polygon(path, 8.0, 14.0),
            "pit.xml": self._design,
            "scan.laz": lambda path: shutil.copy(results / "technical/points_adjusted.laz", path),
            "reference.tif": lambda path: shutil.copy(self.folder / "truth_surface.tif", path),
            "pairs.csv": lambda path: path.write_text(blocks("csv", self.page)[0].code, encoding="utf-8"),
            "sparse/0": lambda path: self.photogram("export", "project.yaml", "--to", "colmap", "--output", path),
            "docs/pictures": lambda path: path.mkdir(parents=True),
        }
        for name, make in made.items():
            if re.search(rf"(?<![\w/]){re.escape(name)}", line) and not (self.folder / name).exists():
                make(self.folder / name)

    @property
    def middle_map_m(self) -> tuple[float, float]:
        """Easting and northing of the middle of the surface."""
        with rasterio.open(self.folder / "results/deliverables/dsm.tif") as surface:
            left, bottom, right, top = surface.bounds
        return (left + right) / 2, (bottom + top) / 2

    def _polygon(self, path: Path, first_m: float, last_m: float) -> None:
        x, y = self.middle_map_m
        write_polygons(path, [box(x + first_m, y - 6.0, x + last_m, y + 6.0)], ["A"])

    def _design(self, path: Path) -> None:
        x, y = self.middle_map_m
        corners = [(y - 5.0, x - 5.0), (y - 5.0, x + 5.0), (y + 5.0, x + 5.0), (y + 5.0, x - 5.0)]
        points = "".join(f'<P id="{k}">{north} {east} 30.0</P>' for k, (north, east) in enumerate(corners, 1))
        path.write_text(
            '<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
            '<Units><Metric linearUnit="meter"/></Units><Surfaces><Surface name="pit"><Definition surfType="TIN">'
            f"<Pnts>{points}</Pnts>"
            "<Faces><F>1 2 3</F><F>1 3 4</F></Faces></Definition></Surface></Surfaces></LandXML>",
            encoding="utf-8",
        )

    def _text_cloud(self, path: Path) -> None:
        shutil.copy(self.folder / "results/technical/points_adjusted.txt", path)


def fresh_site(folder: Path, plan: SurveyPlan) -> None:
    """Write what a surveyor brings home."""
    flown = simulate(replace(plan, calibration_source="exif"), seed=3)
    write_survey(folder, flown, render_photographs(flown))
    (folder / "control.txt").rename(folder / "gcp_list.txt")


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("page", sorted({block.page for block in blocks("sh")} - OTHERS))
def test_the_commands_run(
    page: str,
    finished_survey: Path,
    small_plan: SurveyPlan,
    tmp_path: Path,
    photogram: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = tmp_path / "site"
    if page in FRESH:
        fresh_site(folder, small_plan)
    else:
        shutil.copytree(finished_survey, folder)
    monkeypatch.chdir(folder)
    opened: list[str] = []

    def open_page(address: str) -> bool:
        opened.append(address)
        return True

    monkeypatch.setattr(webbrowser, "open", open_page)
    site = Site(folder, page, photogram)
    for line in (line for block in blocks("sh", page) for line in block.code.splitlines()):
        if not words(line) or UNTIL_ENDED.match(line.partition("  ")[0]) or any(re.search(p, line) for p in ELSEWHERE):
            continue
        program, *arguments = words(line)
        site.make_what_is_named(line)
        if "--export" in arguments:
            Path(arguments[-1]).unlink()
        if program == "photogram":
            if "--pdf" in arguments and not shutil.which("chromium"):
                continue
            outcome = photogram(*arguments[: arguments.index(">") if ">" in arguments else None])
            assert outcome.code == 0, f"{line}\n{outcome.err}"
            assert ("--open" in arguments) == bool(opened)
            opened.clear()
        elif shutil.which(program) and program not in {"make", "pytest"}:
            subprocess.run(line, shell=True, check=True, stdout=subprocess.DEVNULL)
