"""docs/notebook.md, run as a reader would, cell by cell."""

import ast
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from pages import blocks

import photogram as pg

PAGE = "docs/notebook.md"

pytestmark = pytest.mark.survey


def run_cell(code: str, names: dict[str, Any]) -> object:
    """Run one cell and return what a notebook would show of it: the value of its last line, if that is one."""
    tree = ast.parse(code)
    last = tree.body[-1]
    if not isinstance(last, ast.Expr):
        exec(compile(tree, PAGE, "exec"), names)
        return None
    tree.body.pop()
    exec(compile(tree, PAGE, "exec"), names)
    return eval(compile(ast.Expression(last.value), PAGE, "eval"), names)


def test_the_page_runs_and_its_numbers_are_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = [block.code for block in blocks("python", PAGE)]
    names: dict[str, Any] = {}
    with mpl.rc_context({"backend": "agg"}):
        shown = [run_cell(code, names) for code in cells]
        plt.close("all")
    checked, found = (value for value in shown if hasattr(value, "_repr_html_"))
    assert isinstance(checked, pg.Findings)
    assert checked.ready
    assert isinstance(found, pg.Adjustment)
    assert found.converged
    assert "<td>sigma0</td>" in found._repr_html_()

    assert (tmp_path / "residuals.png").stat().st_size > 10_000
    block = found.block
    for number, pose in enumerate(block.poses):
        assert pose is not None
        rows = block.tie_points.photograph == number
        points = block.tie_points.position_world_m[block.tie_points.point[rows]]
        projected = pg.project_points(block.cameras[0], pose, points)
        assert projected - block.tie_points.pixel[rows] == pytest.approx(found.estimates.residual_px[rows], abs=1e-6)

    assert 0.0 < names["sigma_m"] < names["apart_m"]
    flown = names["flown"]
    true_m = dict(zip(flown.control_points.name, flown.truth.control_position_world_m, strict=True))
    length_m = np.linalg.norm(true_m["C02"] - true_m["C01"])
    assert abs(np.linalg.norm(names["line"]) - length_m) < 4 * names["sigma_m"]

    own = names["own"]
    assert own.converged
    assert len(own.block.tie_points) > 300
    assert own.sigma0 == pytest.approx(1.0, abs=0.1)
    assert np.abs(names["error_m"] / names["predicted_m"]).max() < 4.0
