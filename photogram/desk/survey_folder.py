"""One survey on disk, as the page sees it: its photographs, tables, project file, runs and results."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal, TypeVar

import numpy as np
from typing_extensions import TypedDict

from photogram.background.runs import Runs
from photogram.delivery.names import FILES, USUAL, Product
from photogram.delivery.package import PACKAGE
from photogram.desk.coverage.coverage import Coverage, coverage, gaps_kml
from photogram.desk.coverage.expected_accuracy import ExpectedAccuracy, expected_accuracy, unplaced
from photogram.desk.coverage.tagged_flight import tagged_flight
from photogram.desk.kept_measurements import KeptMeasurements
from photogram.desk.map_layers.asked import Asked
from photogram.desk.map_layers.basemap import Basemap, basemap
from photogram.desk.map_layers.contour_layer import ContourLayer, contour_layer
from photogram.desk.map_layers.kept_comparisons import KeptComparisons
from photogram.desk.map_layers.layers import Layer, layers
from photogram.desk.map_layers.residuals import Residuals, residuals
from photogram.desk.overview import ASSUMED, Overview, assumed_places, overview
from photogram.desk.recent import RUNS, folder_of
from photogram.desk.run_settings import ChoiceView, RunSettings, choices, settings_of, write_settings
from photogram.desk.solutions import SolutionFile, begin_with, solutions_in
from photogram.errors import ExchangeError, ImageError, ProjectError, SettingError, WorkspaceError
from photogram.files.atomic import replacing
from photogram.geodesy.height_systems import HeightSystem
from photogram.languages.language import ENGLISH, Language
from photogram.languages.said import Said
from photogram.pipeline.input_validation import CheckedProject, checked_project
from photogram.pipeline.new_project import init
from photogram.pipeline.photograph_folder import look_into
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.project_file import PROJECT_FILE
from photogram.pipeline.stages.publishing.report_files import NUMBERS, PAGE, VIEW
from photogram.pipeline.view import write_view
from photogram.project.draft.edits import Value, write_values
from photogram.project.project import Project
from photogram.report.client.judgement import judgement_in
from photogram.report.kept_measurements import FILE as MEASUREMENTS
from photogram.report.reading import read_report
from photogram.result_files import ResultFolder, contents_of, rank_of, result_path

TABLES = (".txt", ".csv", ".xml")
"""Of files that may hold ground points or marks, in small letters."""

KnownT = TypeVar("KnownT")

PHOTOGRAPHS = "photographs"

TEXTS = ("name", "client", "author", "place", "surveyor", "instrument", "targets", "language")
"""What a person can say of the report on the page."""
MEASURED = "measurements"
"""Whether the report has them; empty text: no."""

Table = Literal["control", "check", "none"]


class TableFile(TypedDict):
    """A file that may hold ground points."""

    file: str
    """Its name, from the folder of the survey on."""
    use: Table
    """What it is taken for unless a person says otherwise."""


class ProductFile(TypedDict):
    """A file of the results."""

    file: str
    """Its name, from the folder of results on."""
    contents: str
    bytes: int


class FolderView(TypedDict):
    """What lies in the folder of a survey."""

    folder: str
    name: str
    photographs: int
    """In the folder of the photographs; 0 where there are none."""
    in_folders: bool
    """Whether they lie in folders within it."""
    photographs_folder: str
    tables: list[TableFile]
    solutions: list[SolutionFile]
    """Of other programs, with which a project can begin."""
    has_project: bool
    has_points: bool
    problem: str
    """Why the project file, or the folder, cannot be read; empty where it can."""


class DeliveryProduct(TypedDict):
    """A product that can be handed over."""

    name: str
    file: str
    """The one that is opened first."""
    usual: bool
    """Whether it is made where nobody names any."""


class SettingsView(TypedDict):
    """What a run makes, and what each choice is predicted to take."""

    settings: RunSettings
    choices: list[ChoiceView]


class Headline(TypedDict):
    """The report in a sentence or two."""

    grade: str
    sentence: str
    also: str
    to_do: list[str]


class ResultsView(TypedDict):
    """What a survey has made."""

    headline: Headline | None
    products: list[ProductFile]
    report: str | None
    """The page of the report, from the folder of results on."""
    package: str | None
    texts: dict[str, str]
    """What the report says that no photograph tells, see TEXTS."""
    has_measurements: bool
    """Whether something was measured that the report could have."""
    with_measurements: bool
    """Whether it is to have that."""
    missing: list[Said]
    """What a report that is to be signed still lacks, in words."""


@dataclass(frozen=True)
class Beginning:
    """What a project file is to be written with: tables by what they are taken for, and what the tags do not say."""

    tables: Mapping[str, Table]
    crs: str | None = None
    heights: HeightSystem | None = None
    geoid: str | None = None
    focal_px: float | None = None
    recursive: bool = False
    solution: str | None = None
    """Of another program, to go on from; its points are taken, and no tables."""


class SurveyFolder:
    """A folder with a project file, or with photographs and none yet. May be asked from several threads at once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.project_path = self.folder / PROJECT_FILE
        self._lock = Lock()
        self.comparisons = KeptComparisons(self.folder)
        self._runs: dict[Path, Runs] = {}
        self._known: dict[str, tuple[object, Any]] = {}
        self._computing: dict[str, Lock] = {}
        self._folders: dict[str, tuple[object, Path]] = {}

    @property
    def photographs(self) -> Path:
        """The folder of the photographs before there is a project file: a folder of that name, or the folder itself."""
        within = self.folder / PHOTOGRAPHS
        return within if within.is_dir() else self.folder

    def project(self) -> Project:
        """Return the project as its file now stands. Raises ProjectError with every error of the file."""
        return load_project(self.project_path)

    def runs(self) -> Runs:
        """Return the runs of the survey, the same ones for all who ask."""
        work = self._named("work")
        with self._lock:
            return self._runs.setdefault(work, Runs(work / RUNS))

    def view(self) -> FolderView:
        """Return what lies in the folder."""
        has_project, problem, points, count, pictures = self.project_path.is_file(), "", False, 0, self.photographs
        in_folders, solutions = False, list[SolutionFile]()
        try:
            if has_project:
                project = self.project()
                points, count = bool(project.control_points), len(project.photographs)
                pictures = project.photographs[0].path.parent
            else:
                count, in_folders = _photographs_in(pictures)
                solutions = solutions_in(self.folder)
        except (ProjectError, ImageError, ExchangeError) as error:
            problem = str(error)
        return {
            "folder": str(self.folder),
            "name": self.folder.name,
            "photographs": count,
            "in_folders": in_folders,
            "photographs_folder": str(pictures),
            "tables": [] if has_project else self._tables(),
            "solutions": solutions,
            "has_project": has_project,
            "has_points": points,
            "problem": problem,
        }

    def _tables(self) -> list[TableFile]:
        places = dict.fromkeys([self.folder, self.photographs])
        files = sorted(path for place in places for path in place.iterdir() if path.suffix.lower() in TABLES)
        return [
            {
                "file": path.relative_to(self.folder).as_posix(),
                "use": _use_of(path.name.lower()),
            }
            for path in files
            if path.is_file() and not path.name.startswith(".")
        ]

    def add_table(self, name: str, content: bytes) -> None:
        """Put a table beside the photographs, before there is a project. Raises WorkspaceError where its name is none
        of a table, or there is a file of that name."""
        path = self.folder / name
        if Path(name).name != name or not name.isprintable() or path.suffix.lower() not in TABLES:
            raise WorkspaceError(
                Said("{file}: a table of points is a file .csv, .txt or .xml: choose another", file=name)
            )
        if path.exists():
            raise WorkspaceError(
                Said(
                    "{file}: there is a file of that name in {folder} already: rename one of them",
                    file=name,
                    folder=self.folder,
                )
            )
        with replacing(path) as partial:
            partial.write_bytes(content)

    def begin(self, wishes: Beginning) -> None:
        """Write the project file. Raises as ``init``, or ``begin_with`` for a solution, and ProjectError for a table
        that is not in the folder."""
        if wishes.solution is not None:
            begin_with(self.folder, wishes.solution, self.photographs, self.project_path, wishes.crs)
            return
        known = {table["file"] for table in self._tables()}
        for name in wishes.tables:
            if name not in known:
                raise ProjectError(
                    Said(
                        "{file}: no table of {folder}: choose one of those that are listed",
                        file=name,
                        folder=self.folder,
                    )
                )
        chosen = {use: [self.folder / n for n, u in wishes.tables.items() if u == use] for use in ("control", "check")}
        init(
            self.photographs,
            control=chosen["control"],
            check=chosen["check"],
            crs=wishes.crs,
            heights=wishes.heights,
            geoid=wishes.geoid,
            focal_px=wishes.focal_px,
            recursive=wishes.recursive,
            project=self.project_path,
        )

    def overview(self) -> Overview:
        """Return the survey on its map, as its project file now stands."""
        project = self.project()
        return self._once("overview", project, lambda: overview(project, self._checked(project)))

    def basemap(self, tiles: str) -> Basemap | None:
        """Return what puts ``tiles`` under the map. Raises as ``basemap``."""
        shown = self.overview()
        places = [p["position_map_m"] for p in (*shown["photographs"], *shown["points"]) if p["position_map_m"]]
        return basemap(tiles, self.project().crs, np.array(places, dtype=np.float64).reshape(-1, 3))

    def settings(self) -> SettingsView:
        """Return what a run makes, and what each choice is predicted to take."""
        project = self.project()
        return {"settings": settings_of(project), "choices": choices(project, self._checked(project).tags)}

    def choose(self, wanted: RunSettings) -> None:
        """Choose what a run makes. Raises as ``write_settings``."""
        write_settings(self.project_path, wanted)

    def coverage(self) -> Coverage:
        """Return what the photographs cover by their tags. Raises FrameError where positions lie outside the CRS."""
        project = self.project()
        return self._once("coverage", project, lambda: coverage(project, self._checked(project).tags))

    def expected_accuracy(self) -> ExpectedAccuracy:
        """Return what accuracy is to be expected of the flight. Raises FrameError where positions lie outside the
        CRS."""
        project = self.project()

        def expected() -> ExpectedAccuracy:
            flight = tagged_flight(project, self._checked(project).tags)
            return unplaced() if flight is None else expected_accuracy(flight)

        return self._once("expected", project, expected)

    def gaps_kml(self) -> bytes:
        """Return the gaps of the coverage as KML. Raises WorkspaceError where there is none."""
        return gaps_kml(self.coverage(), self.folder.name, self.project().crs)

    def _named(self, key: Literal["work", "results"]) -> Path:
        """Return a folder of the survey as its project file names it. Each part of a raster is asked for by itself, so
        that the file is not read for each."""
        status = self.project_path.stat() if self.project_path.is_file() else None
        version = status and (status.st_mtime_ns, status.st_size)
        with self._lock:
            if key not in self._folders or self._folders[key][0] != version:
                self._folders[key] = version, folder_of(self.folder, key)
            return self._folders[key][1]

    def _checked(self, project: Project) -> CheckedProject:
        """Return what the check of a project finds, and the tags of its photographs, of which none is decoded."""
        return self._once("checked", project, lambda: checked_project(project))

    def _once(self, name: str, project: Project, computed: Callable[[], KnownT]) -> KnownT:
        """Return what is computed of a project, the same until its file, a table beside it or a folder of photographs
        changes."""
        tables = (self.folder / table["file"] for table in self._tables())
        places = {self.project_path, *tables, *(photograph.path.parent for photograph in project.photographs)}
        version = sorted((str(place), place.stat().st_mtime_ns, place.stat().st_size) for place in places)
        with self._computing.setdefault(name, Lock()):
            if name not in self._known or self._known[name][0] != version:
                self._known[name] = version, computed()
            known: KnownT = self._known[name][1]
            return known

    def state_accuracy(self, name: str, sigma_m: Sequence[float]) -> None:
        """State a figure that was assumed (``ASSUMED``): standard deviations of easting, northing and height. Raises
        SettingError for another name or what is no accuracy."""
        if name not in ASSUMED:
            raise SettingError("name", f"{name!r}: nothing that is assumed is called so")
        if len(sigma_m) != 3 or not all(0.0 < value < 1e4 for value in sigma_m):
            raise SettingError(
                "accuracy", Said("three positive lengths in metres are expected: easting, northing, height")
            )
        values = dict[tuple[str | int, ...], Value | None]()
        for place in assumed_places(self.project_path, name) or [ASSUMED[name]]:
            block, key = place[:-1], place[-1]
            values |= {(*block, f"{key}_m"): list(sigma_m), (*block, f"{key}_assumed"): None}
        write_values(self.project_path, values, load_project)

    def say(self, texts: Mapping[str, str]) -> None:
        """Say in the project file what the report says that no photograph tells. Raises SettingError for what is none
        of TEXTS, ProjectError for a language that there is not."""
        for key, text in texts.items():
            if key not in (*TEXTS, MEASURED) or not text.isprintable():
                raise SettingError(key, Said("no line of the report that can be set here"))
        said = self.project().report
        lines: dict[tuple[str | int, ...], Value | None] = {
            ("report", key): text or None
            for key, text in texts.items()
            if key != MEASURED and text != getattr(said, key)
        }
        if MEASURED in texts and said.measurements != bool(texts[MEASURED]):
            lines["report", MEASURED] = True if texts[MEASURED] else None
        write_values(self.project_path, lines, load_project)

    def results(self, language: Language = ENGLISH) -> ResultsView:
        """Return what the survey has made, with its headline in a language. Raises ReportError where its report is
        damaged."""
        project = self.project()
        folder = project.results
        numbers, page = result_path(folder, NUMBERS), result_path(folder, PAGE)
        report = read_report(numbers) if numbers.is_file() else None
        verdict = None if report is None else judgement_in(report, language).verdict
        texts = {key: str(getattr(project.report, key)) for key in TEXTS}
        return {
            "headline": None
            if verdict is None
            else {
                "grade": verdict["grade"],
                "sentence": verdict["sentence"],
                "also": verdict["also"],
                "to_do": list(verdict["to_do"]),
            },
            "products": _products(folder),
            "report": page.relative_to(folder).as_posix() if page.is_file() else None,
            "package": PACKAGE if (folder / PACKAGE).is_file() else None,
            "texts": texts,
            "has_measurements": (self.folder / MEASUREMENTS).is_file(),
            "with_measurements": project.report.measurements,
            "missing": _missing(texts, project),
        }

    def result(self, name: str) -> Path:
        """Return a file of the results by its name from their folder on. Raises WorkspaceError where there is none."""
        results = self._named("results")
        path = (results / name).resolve()
        if not path.is_relative_to(results.resolve()) or not path.is_file():
            raise WorkspaceError(Said("{file}: no file of the results: run the survey first", file=name))
        return path

    def layers(self) -> list[Layer]:
        """Return the rasters that a map can draw."""
        return layers(self._named("results"))

    def residuals(self) -> Residuals:
        """Return what the results say of ground points and suspects. Raises as ``residuals``."""
        return residuals(self._named("results"))

    def measurements(self) -> KeptMeasurements:
        """Return what was measured on the surface, and is kept."""
        project = self.project()
        return KeptMeasurements(self.folder / MEASUREMENTS, project.results, project.crs)

    def compare(self, asked: Asked) -> None:
        """Begin to compare with another surface. Raises as ``KeptComparisons.start``."""
        self.comparisons.start(asked, self.project().results, self.measurements())

    def contours(self, interval_m: float | None) -> ContourLayer:
        """Return the contour lines, of another interval if one is given. Raises as ``contour_layer``."""
        project = self.project()
        return contour_layer(project.results, project.product_crs, interval_m)

    def three_d(self) -> str:
        """Return the page of the 3-D view, from the folder of results on; it is made where it is not there."""
        results = self.project().results
        path = result_path(results, VIEW)
        if not path.is_file():
            write_view(self.project_path)
        return path.relative_to(results).as_posix()

    def start(self) -> None:
        """Start `photogram adjust`, which goes on from what is finished."""
        self.runs().start("adjust", ["adjust", str(self.project_path), "--json"])

    def hand_over(self, products: Sequence[str]) -> None:
        """Start `photogram deliver --zip` with some products. Raises SettingError for one that there is not."""
        known = [product.value for product in Product]
        for name in products:
            if name not in known:
                raise SettingError("products", f"{name!r}: the products are {', '.join(known)}")
        asked = [word for name in products for word in ("--to", name)]
        self.runs().start("deliver", ["deliver", str(self.project_path), "--zip", *asked])


def _photographs_in(folder: Path) -> tuple[int, bool]:
    """Return how many photographs lie in a folder or, where it has none, in those within, and whether they lie there.
    Raises ImageError where there are none at all."""
    try:
        return len(look_into(folder, recursive=False).names), False
    except ImageError:
        return len(look_into(folder, recursive=True).names), True


def _use_of(name: str) -> Table:
    """Return what a table is taken for by its name, in small letters."""
    if name.startswith("check"):
        return "check"
    return "control" if name.startswith(("gcp", "control")) else "none"


def products_of_delivery() -> list[DeliveryProduct]:
    """Return the products that can be handed over."""
    return [{"name": product.value, "file": FILES[product][0], "usual": product in USUAL} for product in Product]


def _products(results: Path) -> list[ProductFile]:
    folder = results / ResultFolder.DELIVERABLES
    if not folder.is_dir():
        return []
    files = sorted((path for path in folder.iterdir() if path.is_file()), key=lambda p: (rank_of(p.name), p.name))
    return [
        {
            "file": path.relative_to(results).as_posix(),
            "contents": Said(contents_of(path.name)),
            "bytes": path.stat().st_size,
        }
        for path in files
    ]


def _missing(texts: Mapping[str, str], project: Project) -> list[Said]:
    roles = {point.role for point in project.control_points}
    wanted = {
        "name": Said("a title"),
        "author": Said("who signs"),
        "client": Said("the client"),
        "surveyor": Said("who surveyed the points"),
        "targets": Said("how the points are marked on the ground"),
    }
    absent = [
        words for key, words in wanted.items() if not texts[key] and (roles or key not in ("surveyor", "targets"))
    ]
    if "check" not in roles:
        absent.append(Said("check points: without them accuracy is predicted and not tested"))
    return absent
