"""The command line: what each command says of itself, writes, and returns."""

import json
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from typer.main import get_command

import photogram as package
from photogram.cli import main  # noqa: F401 - its commands register
from photogram.cli.app import app
from photogram.files.clouds.points import write_laz, write_xyz
from photogram.files.maps.rasters import write_raster
from photogram.pipeline.stage_names import STAGE_NAMES
from photogram.report.figures.style import save_picture
from photogram.survey import PointCloud, Raster
from photogram.teaching import figures as study_pictures

Run = Callable[..., Any]


def test_version_is_that_of_the_package(photogram: Run) -> None:
    assert photogram("--version").out == f"photogram {package.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ["init", "check", "adjust", "compare", "demo", "study", "view", "--version"]),
        (("init",), ["PHOTOGRAPHS", "--control", "--check", "--marks", "--crs", "--project", "--picture-size"]),
        (("check",), ["PROJECT", "--photographs"]),
        (("adjust",), ["PROJECT", "--photographs", "--from", "--until", "--quiet", "--json"]),
        (("compare",), ["CLOUDS", "--reference", "--output", "--no-sor", "--method", "--polygons", "--coregister"]),
        (("demo",), ["FOLDER", "--seed"]),
        (("audit",), ["SOLUTION", "--crs", "--check", "--output"]),
        (("deliver",), ["PROJECT", "--to", "dxf", "--output", "--tolerance-m", "--surface-error-m"]),
        (("calibrate-site",), ["PAIRS", "--crs", "--projection", "--scale", "--heights", "--sigma-plan-m", "--unit"]),
        (("export",), ["PROJECT", "--to", "--output", "--photographs"]),
        (("import",), ["SOLUTION", "--photographs", "--crs", "--check", "--project", "--force"]),
        (("study",), ["ransac"]),
        (("schema",), ["report", "events"]),
        (("study", "ransac"), ["PROJECT", "--pair", "--iterations", "--sample-sizes", "--thresholds", "--seed"]),
    ],
)
def test_help_of_every_command(photogram: Run, arguments: tuple[str, ...], words: list[str]) -> None:
    outcome = photogram(*arguments, "--help")
    assert outcome.code == 0
    assert outcome.err == ""
    for word in ("Usage: photogram", *arguments, *words):
        assert word.lower() in outcome.out.lower()


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield every command and every group of commands with its words."""
    yield path, group
    for name, command in getattr(group, "commands", {}).items():
        yield from commands(command, (*path, name))


def squeezed(text: str) -> str:
    """Return what a help text says without the boxes and line breaks that it is laid out with."""
    return re.sub(r"[\s│╭╮╰╯─]+", "", text)


COMMANDS = dict(commands(get_command(app)))


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_help_shows_every_word_that_is_written_for_it(
    photogram: Run, monkeypatch: pytest.MonkeyPatch, path: tuple[str, ...]
) -> None:
    """Rich takes [words] for markup and swallows them."""
    monkeypatch.setenv("COLUMNS", "300")
    shown, command = squeezed(photogram(*path, "--help").out), COMMANDS[path]
    texts = [command.help, *(parameter.help for parameter in command.params)]
    assert all(texts)
    if path == ("adjust",):
        texts += STAGE_NAMES
    assert [text for text in texts if squeezed(text) not in shown] == []


@pytest.mark.parametrize(
    "arguments",
    [
        ("adjsut", "project.yaml"),
        ("adjust", "project.yaml", "--form", "surface"),
        ("adjust", "project.yaml", "another.yaml"),
        ("compare", "cloud.txt"),
        ("compare", "--reference", "surface.tif"),
        ("demo", "--seed", "one"),
        ("study",),
        ("schema", "reports"),
        ("study", "ransac", "project.yaml", "--sample-sizes", "eight"),
        ("study", "ransac", "project.yaml", "--residual", "sampsn"),
    ],
)
def test_wrong_usage_ends_with_2(photogram: Run, arguments: tuple[str, ...]) -> None:
    outcome = photogram(*arguments)
    assert outcome.code == 2
    assert "Usage: photogram" in outcome.err + outcome.out
    assert "Traceback" not in outcome.err


def test_the_project_of_a_folder_needs_no_name(
    adjusted_survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    named = photogram("check", adjusted_survey / "project.yaml")
    assert photogram("check", adjusted_survey).out == named.out
    monkeypatch.chdir(adjusted_survey)
    assert photogram("check").code == named.code
    monkeypatch.chdir(tmp_path)
    outcome = photogram("adjust")
    assert outcome.code == 1
    assert "project.yaml: cannot be read (No such file or directory)" in outcome.err


def test_a_stage_that_does_not_exist(photogram: Run, survey: Path) -> None:
    for option in ("--from", "--until"):
        outcome = photogram("adjust", survey / "project.yaml", option, "surfaces")
        assert outcome.code == 2
        said = " ".join(outcome.err.replace("│", " ").split())
        assert "'surfaces' is not one of 'photographs', 'features', 'pairs', 'matches', 'tie_points'" in said
        assert "Traceback" not in outcome.err


def test_double_v_shows_where_an_error_arose(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "photogram.cli.main", "-vv", "adjust", str(tmp_path / "none.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.startswith("Traceback")
    assert "ProjectError" in done.stderr


def test_photographs_may_lie_in_another_folder(adjusted_survey: Path, photogram: Run) -> None:
    project = adjusted_survey / "project.yaml"
    elsewhere = shutil.move(adjusted_survey / "photographs", adjusted_survey / "card" / "DCIM")
    outcome = photogram("adjust", project, "--until", "comparison")
    assert outcome.code == 1
    assert "--photographs DIR" in outcome.err
    outcome = photogram("adjust", project, "--photographs", elsewhere, "--until", "comparison")
    assert outcome.code == 0, outcome.err
    assert outcome.out.count("up to date") == 15
    assert photogram("adjust", project, "--photographs", adjusted_survey / "nowhere").code == 1


@pytest.mark.usefixtures("undrawn")
def test_adjust_prints_the_essentials_of_the_report(adjusted_survey: Path, photogram: Run) -> None:
    outcome = photogram("adjust", adjusted_survey / "project.yaml")
    assert outcome.code == 0, outcome.err
    report = json.loads((adjusted_survey / "results/quality/report.json").read_text())
    for photograph in report["photographs"].values():
        assert f"{photograph['resection']['gnss_difference_m']:.3f}" in outcome.out
    adjustment, check = report["adjustment"], report["check_points"]
    assert f"{adjustment['tie_points']}, {adjustment['observations']}" in outcome.out
    assert f"{check['rmse_h_m']:.3f}, {check['rmse_v_m']:.3f} m" in outcome.out
    for cloud in report["clouds"].values():
        assert f"{cloud['nmad_m']:.3f}" in outcome.out


# ---- compare -------------------------------------------------------------------------------------------------------


def plane(easting: Any, northing: Any) -> Any:
    return 100.0 + 0.1 * (easting - 602300.0) - 0.05 * (northing - 5794100.0)


@pytest.fixture
def clouds(tmp_path: Path) -> list[Path]:
    """Two clouds of one plane: 0.10 m above it, and 0.05 m below it with noise of 0.02 m and 20 points far above."""
    rng = np.random.default_rng(5)
    first, second = (rng.uniform([602305.0, 5794105.0], [602345.0, 5794135.0], (n, 2)) for n in (2000, 3000))
    above = np.column_stack([first, plane(*first.T) + 0.10])
    below = np.column_stack([second, plane(*second.T) - 0.05 + 0.02 * rng.standard_normal(len(second))])
    below[:20, 2] += 30.0
    write_xyz(tmp_path / "above.txt", PointCloud(above))
    write_laz(tmp_path / "below.laz", PointCloud(below), "EPSG:25832")
    return [tmp_path / "above.txt", tmp_path / "below.laz"]


@pytest.fixture(params=["reference.tif", "reference.txt"])
def reference(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / str(request.param)
    easting, northing = np.meshgrid(602300.25 + 0.5 * np.arange(100), 5794139.75 - 0.5 * np.arange(80))
    if path.suffix == ".tif":
        height = plane(easting, northing).astype(np.float32)
        write_raster(path, Raster(height, 602300.0, 5794140.0, 0.5), "EPSG:25832")
    else:
        points = np.column_stack([easting.ravel(), northing.ravel(), plane(easting, northing).ravel()])
        write_xyz(path, PointCloud(points))
    return path


def test_compare_two_clouds_with_a_reference(
    clouds: list[Path], reference: Path, tmp_path: Path, photogram: Run
) -> None:
    outcome = photogram("compare", *clouds, "--reference", reference, "--output", tmp_path / "out" / "deeper")
    assert outcome.code == 0, outcome.err
    found = json.loads((tmp_path / "out/deeper/comparison.json").read_text())
    assert list(found) == ["above", "below"]
    above, below = (found[name]["cloud_to_surface"] for name in ("above", "below"))
    assert above["mean_m"] == pytest.approx(0.10, abs=1e-3)
    assert above["nmad_m"] < 1e-3
    assert below["mean_m"] == pytest.approx(-0.05, abs=2e-3)
    assert below["std_m"] == pytest.approx(0.02, rel=0.1)
    assert below["nmad_m"] == pytest.approx(0.02, rel=0.1)
    assert found["below"]["removed"] >= 20
    # the nearest of points 0.5 m apart is 0.19 m away in plan on average
    assert 0.15 < found["below"]["cloud_to_cloud"]["mean_m"] < 0.25
    for figure in ("0.1000", "below", "above", "comparison.json"):
        assert figure in outcome.out.replace("\n", "")
    with Image.open(tmp_path / "out/deeper/comparison.png") as picture:
        assert min(picture.size) > 300


def test_compare_without_the_filter_keeps_every_point(clouds: list[Path], tmp_path: Path, photogram: Run) -> None:
    reference = clouds[0]
    assert photogram("compare", clouds[1], "--reference", reference, "--no-sor", "--output", tmp_path).code == 0
    found = json.loads((tmp_path / "comparison.json").read_text())["below"]
    assert found["removed"] == 0
    assert found["cloud_to_surface"]["points"] == 3000
    assert found["cloud_to_surface"]["std_m"] > 1.0
    assert found["cloud_to_surface"]["median_m"] == pytest.approx(-0.15, abs=2e-3)


def test_compare_refuses_two_clouds_of_one_name(clouds: list[Path], tmp_path: Path, photogram: Run) -> None:
    (tmp_path / "other").mkdir()
    again = shutil.copyfile(clouds[0], tmp_path / "other" / clouds[0].name)
    outcome = photogram("compare", clouds[0], again, "--reference", clouds[1], "--output", tmp_path)
    assert outcome.code == 1
    assert "two clouds have the name 'above': rename one" in outcome.err


# ---- study ---------------------------------------------------------------------------------------------------------


def test_study_ransac(adjusted_survey: Path, photogram: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: dict[str, Figure] = {}

    def keep(figure: Figure, path: Path) -> None:
        figures[path.name] = figure
        save_picture(figure, path)

    monkeypatch.setattr(study_pictures, "save_picture", keep)
    project, pair = adjusted_survey / "project.yaml", ("sim_0002.JPG", "sim_0001.JPG")
    options = ("--iterations", "20,200", "--sample-sizes", "8,12", "--thresholds", "1,3", "--pair", *pair)
    outcome = photogram("study", "ransac", project, *options)
    assert outcome.code == 0, outcome.err

    folder = adjusted_survey / "results/technical/study"
    names = ["ransac_iterations_1px.png", "ransac_iterations_3px.png", "ransac_sample_size.png"]
    assert sorted(p.name for p in folder.iterdir()) == ["ransac.json", *names]
    for name in names:
        with Image.open(folder / name) as picture:
            assert min(picture.size) > 300
    found = json.loads((folder / "ransac.json").read_text())
    assert found["pair"] == ["sim_0001.JPG", "sim_0002.JPG"]
    assert (found["iterations"], found["sample_sizes"], found["thresholds_px"]) == ([20, 200], [8, 12], [1.0, 3.0])
    best = np.array(found["best_inliers"])
    assert best.shape == (2, 2, 2)  # sample size, threshold, iterations
    assert (best[..., 1] >= best[..., 0]).all()
    assert 8 <= best.min() <= best.max() <= found["candidates"]
    for s, size in enumerate((8, 12)):
        for t, w in enumerate(found["inlier_fraction"]):
            needed = math.log(1 - 0.99) / math.log(1 - w**size)
            assert found["needed_iterations"][s][t] == pytest.approx(max(1.0, needed), rel=0.5, abs=1.0)

    # the theoretical curve, of the probability that a sample without outliers has been drawn, stands in the picture
    curves = [line for axes in figures[names[0]].axes for line in axes.get_lines() if np.size(line.get_xdata()) == 200]
    n, w = np.arange(1, 201), found["inlier_fraction"][0]
    for size in (8, 12):
        theory = 1 - (1 - w**size) ** n
        assert any(np.allclose(np.asarray(c.get_ydata(), dtype=float), theory, atol=1e-9) for c in curves), size


def test_study_is_the_same_for_the_same_seed(adjusted_survey: Path, photogram: Run) -> None:
    path = adjusted_survey / "results/technical/study/ransac.json"
    options = ("--iterations", "3", "--sample-sizes", "8", "--thresholds", "1")

    def study(seed: int) -> Any:
        assert photogram("study", "ransac", adjusted_survey / "project.yaml", *options, "--seed", seed).code == 0
        return json.loads(path.read_text())

    first = study(1)
    assert study(1) == first
    assert study(2)["best_inliers"] != first["best_inliers"]


@pytest.mark.parametrize(
    ("options", "fragment"),
    [
        (("--pair", "sim_0001.JPG", "sim_0009.JPG"), "the pair sim_0001.JPG sim_0009.JPG is not matched"),
        (("--sample-sizes", "7"), "8"),
        (("--iterations", "0"), "iteration"),
        (("--thresholds=-1",), "threshold"),
        (("--sample-sizes", "8.5"), "whole numbers"),
        (("--ratio", "0"), "--ratio"),
        (("--ratio", "1.5"), "--ratio"),
    ],
)
def test_study_faults(finished_survey: Path, photogram: Run, options: tuple[str, ...], fragment: str) -> None:
    outcome = photogram("study", "ransac", finished_survey / "project.yaml", *options)
    assert outcome.code in (1, 2)
    assert re.search(fragment, outcome.err)
    assert "Traceback" not in outcome.err
