"""A small simulated survey, made and adjusted once for all tests, and the command run as a user runs it."""

import json
import os
import re
import shutil
import struct
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import settings
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match
from makers import SharedData, undrawing_unless_all
from pyproj import Transformer
from threadpoolctl import threadpool_limits

from photogram.camera import Camera, Pose, oriented_by
from photogram.cli.main import main
from photogram.errors import AdjustmentError
from photogram.files import npz_json
from photogram.files.portable import try_lock
from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid, cell_steps, verticals
from photogram.pipeline.pipeline import load_project, run_pipeline
from photogram.pipeline.stages.publishing import report_files
from photogram.project.document import Document
from photogram.project.json_schema import project_schema
from photogram.quality.asprs import ReportSettings
from photogram.report.numbers.completion import complete
from photogram.report.printing import browser_options, find_browser
from photogram.report.record.json_schema import report_schema
from photogram.simulation.demonstration import write_demonstration
from photogram.simulation.rendering import render
from photogram.simulation.scene import make_scene
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.surface.dense.lattice import NOTHING_HIDDEN, Crops, GroundCells
from photogram.surface.dense.resolution import choose_views
from photogram.surface.views import Views

# The same examples on every run: a test must not fail by chance.
# To hunt for new ones: pytest --hypothesis-profile=default
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

PLAN = SurveyPlan(
    width_px=400,
    height_px=300,
    focal_px=600.0,
    principal_point_offset_px=(1.0, -0.7),
    calibration_sigmas=(2.0, 1.0, 1.0, 0.004, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    flying_height_m=40.0,
    forward_overlap=0.75,
    side_overlap=0.7,
    strips=2,
    photographs_per_strip=2,
    relief_m=4.0,
    buildings=2,
    trees=6,
    target_radius_m=0.3,
    control_points=8,
    check_points=4,
    control_marks_per_photograph=4,
    mark_sigma_px=0.0,
    whole_pixel_marks=True,
)
SEED = 3
SHARED_DATA = Path(os.environ.get("PHOTOGRAM_SHARED_DATA", Path(__file__).parents[2] / "shared" / "data")).resolve()


FIRST = ("surveys/test_resume.py", "cli/test_packaging.py", "files/", "surveys/", "report/test_viewer_in_browser.py")
"""Files and folders of tests in the order in which workers take them, before all others.

The first one has the adjusted survey made, which compiles most kernels: two minutes where none is kept. What another
worker does meanwhile needs neither. Then what takes longest, so that no worker is left with it at the end.
"""


def _asks_gtsam(path: Path) -> bool:
    return re.search(r"^(?:import gtsam|from referees import)", path.read_text(encoding="utf-8"), re.M) is not None


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Leave out the tests whose referee is GTSAM where it is not installed."""
    without = collection_path.suffix == ".py" and find_spec("gtsam") is None
    return True if without and _asks_gtsam(collection_path) else None


def pytest_report_header() -> list[str]:
    """Say that tests are left out."""
    files = sorted(Path(__file__).parent.rglob("test_*.py")) if find_spec("gtsam") is None else []
    count = sum(map(_asks_gtsam, files))
    return [f"GTSAM is not installed: the {count} files of tests whose referee it is are left out"] if files else []


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, Any, Any]:
    """Skip what compares with GTSAM's engine where it is not installed, once photogram itself says so."""
    try:
        return (yield)
    except AdjustmentError as error:
        if find_spec("gtsam") is None and "needs GTSAM, which is not installed" in str(error):
            pytest.skip(str(error))
        raise


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need data from outside of the repository; for several workers put the files in order."""
    for item in items:
        if "shared_data" in getattr(item, "fixturenames", ()):
            item.add_marker("shared_data")
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=_turn)


def _turn(item: pytest.Item) -> int:
    """Return which of FIRST a test belongs to."""
    name = item.nodeid.removeprefix("tests/")
    return next((turn for turn, first in enumerate(FIRST) if name.startswith(first)), len(FIRST))


@pytest.fixture(scope="session")
def shared_data() -> SharedData:
    """Data from outside of the repository: ``shared_data("dtu_phantom4/images")`` returns the path of a file or folder,
    or skips the test where there is none. See CONTRIBUTING.md."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"there is no {path}: PHOTOGRAM_SHARED_DATA names the folder of the shared data")
        return path

    return find


@dataclass(frozen=True)
class Outcome:
    """How a command ended, and what it said."""

    code: int
    out: str
    err: str


@dataclass(frozen=True)
class SlopingGeoid:
    """A geoid 44 m above the ellipsoid that slopes steeply in both directions, and its grid: 8° to 14° east, 50° to 54°
    north, every quarter of a degree; bilinear interpolation of it is exact."""

    path: str

    @staticmethod
    def height_m(longitude_deg: Any, latitude_deg: Any) -> Any:
        """Return its height above the ellipsoid."""
        return 44.0 + 0.5 * (longitude_deg - 10.0) - 1.25 * (latitude_deg - 52.0)

    def at(self, crs: str, points_map_m: np.ndarray[Any, Any]) -> Any:
        """Return its height at points (N, 2 or more) of a map."""
        geodetic = Transformer.from_crs(crs, "EPSG:4258", always_xy=True)
        return self.height_m(*geodetic.transform(points_map_m[:, 0], points_map_m[:, 1]))

    def write(self) -> None:
        """Write the grid in NOAA's format .gtx."""
        longitude, latitude = np.meshgrid(8.0 + 0.25 * np.arange(25), 50.0 + 0.25 * np.arange(17))
        head = struct.pack(">4d2i", 50.0, 8.0, 0.25, 0.25, 17, 25)
        Path(self.path).write_bytes(head + self.height_m(longitude, latitude).astype(">f4").tobytes())


@dataclass(frozen=True, eq=False)
class PhotographedPlane:
    """Five photographs of a tilted, textured plane from true poses, and a grid over what all of them show.

    ``pictures`` are grey values (height, width) float32 without noise; ``slope`` is the plane's rise in m for a metre
    to the east and to the south.
    """

    frame: LocalFrame
    views: Views
    pictures: tuple[np.ndarray[Any, Any], ...]
    grid: MapGrid
    slope: tuple[float, float]
    per_cell: int = 2
    patch: int = 16

    @property
    def height_m(self) -> np.ndarray[Any, Any]:
        """Return the plane's heights (rows, columns) over the base, float64."""
        foot = verticals(self.frame, self.grid, self.grid.whole).foot_world_m
        return np.asarray(self.slope[0] * foot[..., 0] - self.slope[1] * foot[..., 1])

    @property
    def tilt(self) -> np.ndarray[Any, Any]:
        """Return its rise in m to the next cell to the east and to the south (rows, columns, 2)."""
        rise = np.array(self.slope, np.float32) * np.float32(self.grid.cell_m)
        return np.ascontiguousarray(np.broadcast_to(rise, (self.grid.rows, self.grid.columns, 2)))

    def crops(self, pictures: Sequence[np.ndarray[Any, Any]] | None = None) -> Crops:
        """Return whole pictures, its own where none are given, as the kernels take them."""
        views, shown = self.views, self.pictures if pictures is None else pictures
        size, none = [p.size for p in shown], np.zeros(len(shown), np.int64)
        start = np.concatenate([[0], np.cumsum(size)[:-1]]).astype(np.int64)
        height, width = (np.array([p.shape[k] for p in shown], np.int64) for k in (0, 1))
        return Crops(
            views.cameras, start, none, none, width, height,
            np.concatenate([p.ravel() for p in shown]).astype(np.float32), 1.0,
        )  # fmt: skip

    def ground(self) -> GroundCells:
        """Return the cells of the grid as the kernels take them, each looked up in all photographs that show it."""
        lines = verticals(self.frame, self.grid, self.grid.whole)
        middle = np.ix_(*(np.minimum(np.arange(0, n, self.patch) + self.patch // 2, n - 1) for n in lines.up.shape[:2]))
        place = lines.foot_world_m[middle]
        chosen, _ = choose_views(self.views, place.reshape(-1, 3), len(self.views))
        east, south = cell_steps(self.frame, self.grid)
        of_patches = chosen.reshape(*place.shape[:2], len(self.views))
        return GroundCells(
            lines.foot_world_m,
            lines.up,
            east,
            south,
            self.per_cell,
            of_patches,
            self.patch,
            NOTHING_HIDDEN,
        )


@pytest.fixture(scope="session")
def photographed_plane() -> PhotographedPlane:
    """Photographs of 340 × 280 px, 10 cm on the ground, from 40 m above a plane that is tilted by 10 % and 6 %."""
    camera = Camera("plane", 340, 280, 400.0, np.array([169.0, 141.0]), np.array([-0.03, 0.01, 0.0, 0.0]))
    rng = np.random.default_rng(8)
    poses = []
    for east, north in ((-7.0, 0.5), (-3.5, -4.0), (0.0, 0.0), (3.5, 4.0), (7.0, -0.5)):
        turn = np.radians(rng.normal(0.0, 1.0, 3))
        small = np.array([[1.0, -turn[2], turn[1]], [turn[2], 1.0, -turn[0]], [-turn[1], turn[0], 1.0]])
        rotation, _ = np.linalg.qr(small @ np.diag([1.0, -1.0, -1.0]))
        rotation *= np.sign(np.diag(rotation)) * np.array([1.0, -1.0, -1.0])
        poses.append(Pose(rotation, np.array([east, north, 40.0])))
    slope = 0.10, 0.06
    flat = make_scene(11, 90.0, 0.5, relief_m=0.0, buildings=0, trees=0, finest_wavelength_m=0.3)
    row, column = np.mgrid[: flat.height_m.shape[0], : flat.height_m.shape[1]]
    east, north = flat.west_m + flat.cell_m * column, flat.south_m + flat.cell_m * row
    scene = replace(flat, height_m=(slope[0] * east - slope[1] * north).astype(np.float32))
    coloured = (render(scene, camera, pose, seed=0, noise_dn=0.0) for pose in poses)
    pictures = tuple((rgb @ np.array([0.299, 0.587, 0.114])).astype(np.float32) for rgb in coloured)
    views = Views(np.arange(5), oriented_by([camera], np.zeros(5, np.int64), poses))
    frame = LocalFrame("EPSG:25832", (600000.0, 5800000.0, 100.0), "grid")
    return PhotographedPlane(frame, views, pictures, MapGrid(599992.0, 5800008.0, 0.2, 80, 80), slope)


@pytest.fixture(scope="session")
def sloping_geoid(tmp_path_factory: pytest.TempPathFactory) -> SlopingGeoid:
    """A geoid whose height is known everywhere."""
    geoid = SlopingGeoid(str(tmp_path_factory.mktemp("geoid of the site") / "slope.gtx"))
    geoid.write()
    return geoid


@contextmanager
def _made_once(factory: pytest.TempPathFactory, name: str) -> Iterator[tuple[Path, bool]]:
    """Give a folder that all processes of this test run share, and whether it is still to be made, one at a time."""
    parallel = factory.getbasetemp().name.startswith("popen-")  # a worker of pytest-xdist
    root = factory.getbasetemp().parent if parallel else factory.getbasetemp()
    folder, done = root / name, root / f"{name}.done"
    with (root / f"{name}.lock").open("w") as lock:
        while not try_lock(lock.fileno()):
            time.sleep(0.1)
        yield folder, not done.exists()
        done.touch()


def _edit(project: Path, change: Callable[[dict[str, Any]], object]) -> None:
    values = yaml.safe_load(project.read_text(encoding="utf-8"))
    change(values)
    project.write_text(yaml.safe_dump(values, sort_keys=False, allow_unicode=True), encoding="utf-8")


def _small(values: dict[str, Any]) -> None:
    values["features"] = {"maximum": 800}
    values["matching"] = {"ratio": 0.8}


@pytest.fixture(scope="session", autouse=True)
def reports_follow_their_schema() -> Iterator[None]:
    """Hold every report.json that a test makes within its process against the JSON Schema."""
    validator, write = Draft202012Validator(report_schema()), npz_json.write_json

    def checked(path: Path, value: object) -> None:
        write(path, value)
        if path.name == report_files.NUMBERS:
            fault = best_match(validator.iter_errors(json.loads(path.read_text(encoding="utf-8"))))
            assert fault is None, f"{path}: {fault.json_path}: {fault.message}"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report_files, "write_json", checked)
        yield


@pytest.fixture(scope="session", autouse=True)
def projects_follow_their_schema() -> Iterator[None]:
    """Hold every project.yaml that is accepted within a test's process against the JSON Schema, but for huge ones."""
    validator, raise_errors = Draft202012Validator(project_schema()), Document.raise_errors

    def checked(document: Document) -> None:
        raise_errors(document)
        value = document.value
        if isinstance(value, dict) and "photogram" in value and document.path.stat().st_size < 50_000:
            fault = best_match(validator.iter_errors(value))
            assert fault is None, f"{document.path}: {fault.json_path}: {fault.message}"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Document, "raise_errors", checked)
        yield


@pytest.fixture(scope="session")
def small_plan() -> SurveyPlan:
    """The plan of the small survey."""
    return PLAN


@pytest.fixture(scope="session")
def pristine_survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of four photographs of 400 × 300 px with project.yaml and its truth; not to be written to."""
    with _made_once(tmp_path_factory, "pristine") as (folder, missing):
        if missing:
            project = write_demonstration(folder, SEED, lambda *_: None, PLAN)
            _edit(project, _small)
    return folder


@pytest.fixture(scope="session")
def finished_survey(pristine_survey: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the same survey, adjusted without interruption; not to be written to."""
    with _made_once(tmp_path_factory, "finished") as (folder, missing):
        if missing:
            shutil.copytree(pristine_survey, folder)
            with threadpool_limits(2, "blas"):  # what tests compare with it is made by one thread of BLAS
                run_pipeline(load_project(folder / "project.yaml"))
    return folder


@pytest.fixture
def survey(pristine_survey: Path, tmp_path: Path) -> Path:
    """A copy of the survey, not adjusted, for one test."""
    return Path(shutil.copytree(pristine_survey, tmp_path / "survey"))


@pytest.fixture
def adjusted_survey(finished_survey: Path, tmp_path: Path) -> Path:
    """A copy of the adjusted survey, for one test."""
    return Path(shutil.copytree(finished_survey, tmp_path / "survey"))


@pytest.fixture(scope="session")
def edit() -> Callable[[Path, Callable[[dict[str, Any]], object]], None]:
    """Change the values of a project file: ``edit(project, lambda values: …)``."""
    return _edit


@pytest.fixture
def undrawn() -> Iterator[None]:
    """An empty picture stands for every figure, except with all seeds: see `makers.undrawing`."""
    with undrawing_unless_all():
        yield


@pytest.fixture
def photogram(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """The command line, run within this process: ``photogram("adjust", path)``."""

    def run(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["photogram", *map(str, arguments)])
        capfd.readouterr()
        code = 0
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        said = capfd.readouterr()
        return Outcome(code, said.out, said.err)

    return run


@pytest.fixture(scope="session")
def open_browser(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Any]:
    """A browser without a window for the tests of pages: ``with open_browser(more options, without={…}) as chrome``;
    it notes what its console says and what it asks of the network. Skips where there is none."""

    @contextmanager
    def opened(more: Sequence[str] = (), without: Set[str] = frozenset()) -> Iterator[Any]:
        from selenium.webdriver import Chrome, ChromeOptions
        from selenium.webdriver.chrome.service import Service

        binary, driver = find_browser(), shutil.which("chromedriver")
        if binary is None or driver is None:
            pytest.skip(f"no {'browser' if binary is None else 'chromedriver'} on this machine")
        options = ChromeOptions()
        options.binary_location = binary
        for option in (*browser_options(tmp_path_factory.mktemp("profile")), *more):
            if option not in without:
                options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        chrome = Chrome(options=options, service=Service(driver))
        try:
            chrome.get("about:blank")  # instead of the distribution's start page
            chrome.get_log("performance")
            yield chrome
        finally:
            chrome.quit()

    return opened


@pytest.fixture(scope="session")
def full_report(finished_survey: Path) -> Any:
    """A report with every key that a report may have: that of the small survey and, for what it does not show, figures
    of no survey; completed as for a project with targets."""
    report = json.loads((finished_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    ground_errors = report["diagnosis"]["ground_errors"]
    report |= json.loads((Path(__file__).parent / "data/report_additions.json").read_text(encoding="utf-8"))
    report["diagnosis"]["ground_errors"] = ground_errors
    point = report["control_points"][2]
    point |= {
        "suspect": True,
        "axis_roles": ["control", "control", "check"],
        "chi2": {"value": 201.6, "dof": 2, "p": 1e-9},
        "z": [0.1, -0.2, 14.2],
    }
    point |= {"verdict": "without it the check RMSE falls from 0.31 m to 0.04 m"}
    report["control_points"][-1] |= {"adjusted_map_m": None, "residual_m": None, "sigma_m": None}
    left_out = {"registered": False, "reason": "shares too few tie points", "tie_points": 0, "gnss_residual_m": None}
    report["photographs"]["sim_0099.JPG"] = {"camera": "simulated", **left_out}
    report["block"] |= {"photographs": 5}
    settings = ReportSettings(
        name="Quarry, stage 3",
        client="The owner",
        author="A. Surveyor",
        surveyor="B. Surveyor",
        instrument="GNSS receiver, RTK",
        targets="boards of 40 cm",
        place="Exampleton",
        standard="pec-pcd",
        target_rmse_h_m=0.05,
        target_rmse_v_m=0.02,
        legacy_95=True,
    )
    return complete(report, settings)
