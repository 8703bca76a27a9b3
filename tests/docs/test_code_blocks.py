"""Every block of code of every page: it says its language, and what a reader can run gives what the page says."""

import contextlib
import io
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import numpy as np
import pytest
import yaml
from dask.config import config
from pages import PAGES, CodeBlock, blocks, blocks_in, text_of

import photogram as pg
from photogram.adjustment.problem import AdjustmentSettings, minimise, start_state
from photogram.donation.donation import donated, write_donation
from photogram.node.options import OPTIONS
from photogram.pipeline.pipeline import load_project
from photogram.report.numbers.overall import length
from photogram.simulation import simulated_survey
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block

pytestmark = pytest.mark.survey

LANGUAGES = {"csv", "json", "python", "sh", "text", "yaml", "{code-cell}", "{toctree}"}
"""Of blocks; `text` is what a program or a file says, or a drawing, `{code-cell}` runs in test_course.py."""
OWN_TESTS = {"docs/notebook.md"}
"""Pages whose Python runs in a test of their own."""

Names = dict[str, Any]


@pytest.mark.parametrize("page", PAGES)
def test_every_block_says_its_language(page: str) -> None:
    assert [str(block) for block in blocks_in(text_of(page), page) if block.language not in LANGUAGES] == []


def run(block: CodeBlock, names: Names) -> str:
    """Run a block where the reader is, and return what it prints."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(block.code, str(block), "exec"), names)
    return said.getvalue()


def test_the_poses_of_p3p_are_those_on_the_page() -> None:
    (block,) = blocks("python", "docs/assignment.md")
    shown = next(b.code for b in blocks_in(text_of("docs/assignment.md")) if b.language == "text")
    assert run(block, {}) == shown


def test_the_report_is_read(adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(adjusted_survey)
    (block,) = blocks("python", "docs/report.md")
    names: Names = {}
    run(block, names)
    kept = json.loads((adjusted_survey / "results/quality/report.json").read_text(encoding="utf-8"))
    assert names["report"] == kept
    assert kept["check_points"]["rmse_v_m"] > 0.0


def test_a_donated_survey_is_adjusted_again(adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(adjusted_survey)
    write_donation(Path("project_donation.npz.gz"), donated(load_project(Path("project.yaml"))))
    (block,) = blocks("python", "docs/honesty.md")
    again, own = map(float, run(block, {}).split())
    assert again == pytest.approx(own, abs=2e-3)


def test_heights_of_a_plane_are_points_of_the_map(adjusted_survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(adjusted_survey)
    plane = {"origin_map_m": [10.0, 20.0, 30.0], "axes_map": {"x": [0, 1, 0], "y": [0, 0, 1], "z": [1, 0, 0]}}
    Path("results/deliverables/plane.json").write_text(json.dumps(plane), encoding="utf-8")
    (block,) = blocks("python", "docs/file-formats.md")
    names: Names = {}
    run(block, names)
    surface, _ = pg.read_raster("results/deliverables/dsm.tif")
    row, column = np.nonzero(np.isfinite(surface.values))
    assert names["map_m"][:, 0] - 10.0 == pytest.approx(surface.values[row, column])
    assert names["map_m"][:, 1] - 20.0 == pytest.approx(surface.west_map_m + (column + 0.5) * surface.cell_m)
    assert names["map_m"][:, 2] - 30.0 == pytest.approx(surface.north_map_m - (row + 0.5) * surface.cell_m)


def test_a_mask_keeps_key_points_out(survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(survey)
    shutil.copy("photographs/sim_0001.JPG", "photographs/IMG_1.JPG")
    half = np.ones((300, 400), dtype=bool)
    half[:150] = False
    Path("masks").mkdir()
    pg.write_mask("masks/IMG_1_mask.png", half)
    (block,) = blocks("python", "docs/masks.md")
    names: Names = {}
    run(block, names)
    assert len(names["found"].pixel) > 50
    assert names["found"].pixel[:, 1].min() > 149.0
    assert np.array_equal(pg.read_mask("masks/IMG_1_mask.png"), half)


def test_the_surveyed_canopy_is_written(
    small_plan: SurveyPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(simulated_survey, "canopy_plan", lambda: small_plan)
    (block,) = blocks("python", "docs/simulation.md")
    run(block, {})
    for path in ("canopy/points.csv", "canopy_project/project.yaml"):
        assert (tmp_path / path).is_file()


def setting(block: CodeBlock) -> None:
    names: Names = {}
    lines = ["from typing import Annotated", "from photogram.settings.settings import Settings, Within"]
    code = "\n".join([*lines, "from dataclasses import dataclass", "@dataclass(frozen=True)", "class Seams(Settings):"])
    exec(f"{code}\n    {block.code}", names)
    assert names["Seams"]().feather_cells == 4.0
    with pytest.raises(Exception, match="cells"):
        names["Seams"](feather_cells=9.0)


def observation(block: CodeBlock) -> None:
    simulated = simulate_block(SurveyPlan(strips=2, photographs_per_strip=3, control_points=6), seed=1).block
    first, second = simulated.control_points.position_world_m[:2]
    wanted_m = round(float(np.linalg.norm(second - first)), 2) + 0.02
    names: Names = {"block": simulated}
    run(replace(block, code=block.code.replace("12.345", str(wanted_m))), names)
    problem, settings = names["problem"], AdjustmentSettings()
    first, second = minimise(problem, start_state(problem), settings).state.control[:2]
    assert np.linalg.norm(second - first) == pytest.approx(wanted_m, abs=0.002)


def stage(block: CodeBlock) -> None:
    names: Names = {}
    run(block, names)
    assert names["MESH"].products == ("mesh.ply",)


def message(block: CodeBlock) -> None:
    names: Names = {"rmse_m": 0.05, "count": 3}
    run(block, names)
    assert (
        names["language"].gettext("{length} in plan", length=length(0.05, names["language"]))
        == "5,0\u202fcm in der Lage"
    )


def sentence(block: CodeBlock) -> None:
    names: Names = {"n": 2, "folder": "site"}
    run(block, names)
    said = names["Said"]("{folder}: folder not found: choose another", folder="site")
    assert str(said) == "site: folder not found: choose another"


def test_a_client_of_a_node_is_asked_as_the_page_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyODM stands in for itself, with its own signatures; tests/node runs it against a node."""
    pyodm = pytest.importorskip("pyodm")
    node = create_autospec(pyodm.Node, instance=True)
    task = node.create_task.return_value = create_autospec(pyodm.api.Task, instance=True)
    monkeypatch.setattr(pyodm, "Node", create_autospec(pyodm.Node, return_value=node))
    (block,) = blocks("python", "docs/node.md")
    run(block, {"photographs": ["a.jpg", "b.jpg"]})
    files, options, _ = node.create_task.call_args.args
    assert files == ["a.jpg", "b.jpg"]
    assert set(options) <= {option.name for option in OPTIONS}
    task.download_assets.assert_called_once_with("results")


@pytest.mark.parametrize(
    ("number", "check"),
    list(enumerate((setting, observation, stage, message, sentence))),
    ids=["setting", "observation", "stage", "message", "sentence"],
)
def test_what_developers_add_fits(number: int, check: Callable[[CodeBlock], None]) -> None:
    added = blocks("python", "docs/how-to-add.md")
    assert len(added) == 5
    check(added[number])


def test_no_other_page_has_python() -> None:
    tested = {
        "assignment",
        "file-formats",
        "honesty",
        "how-to-add",
        "masks",
        "node",
        "notebook",
        "report",
        "simulation",
    }
    assert {block.page for block in blocks("python")} == {f"docs/{name}.md" for name in tested}


def test_the_settings_of_a_cluster_are_those_of_dask() -> None:
    import distributed  # noqa: F401 - its defaults enter the configuration

    def absent(own: Any, defaults: Any, place: str) -> list[str]:
        if not isinstance(own, dict):
            return []
        return [f"{place}.{key}" for key in own if key not in defaults] + [
            name for key in own if key in defaults for name in absent(own[key], defaults[key], f"{place}.{key}")
        ]

    (block,) = (b for b in blocks("yaml", "docs/cluster.md") if b.code.startswith("distributed:"))
    assert absent(yaml.safe_load(block.code), config, "") == []


def test_the_flight_of_the_page_is_planned(tmp_path: Path, photogram: Callable[..., Any]) -> None:
    (block,) = (b for b in blocks("yaml", "docs/planning.md") if b.code.startswith("# photogram plan"))
    (tmp_path / "flight.yaml").write_text(block.code, encoding="utf-8")
    outcome = photogram("plan", tmp_path / "flight.yaml")
    assert outcome.code == 0, outcome.err
    assert "Predicted accuracy" in outcome.out
