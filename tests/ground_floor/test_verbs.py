"""Verbs of data types: each leads to a function, draws or writes, and the table has no other."""

import inspect
import re
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from makers import simulated

import photogram as pg
from photogram.files.clouds.points import read_cloud
from photogram.verbs import VERBS

mpl.use("Agg")
CRS = "EPSG:25832"


def cloud() -> pg.PointCloud:
    position = np.array([[600000.0, 5800000.0, 12.0], [600010.0, 5800004.0, 18.0], [600003.0, 5800009.0, 15.0]])
    return pg.PointCloud(position, sigma_m=np.full((3, 3), 0.02))


def raster() -> pg.Raster:
    return pg.Raster(np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 9.0]], np.float32), 600000.0, 5800000.0, 0.5)


@pytest.mark.parametrize("place", VERBS.values())
def test_a_verb_leads_to_a_function(place: str) -> None:
    module, definition = place.split(":")
    assert inspect.isfunction(getattr(import_module(module), definition))


def test_the_table_has_what_types_call_and_nothing_else() -> None:
    texts = [inspect.getsource(import_module(f"photogram.{name}")) for name in ("survey", "results")]
    called = {verb for text in texts for verb in re.findall(r"\bcall\(\"(\w+)\"", text)}
    assert called == set(VERBS)


@pytest.mark.parametrize("name", ["cloud.laz", "cloud.xyz"])
def test_a_cloud_is_written_by_its_suffix(tmp_path: Path, name: str) -> None:
    cloud().write(tmp_path / name, CRS)
    np.testing.assert_allclose(read_cloud(tmp_path / name, CRS).position_map_m, cloud().position_map_m, atol=1e-3)


def test_a_cloud_of_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(pg.ProjectError, match=r"written as \.laz, \.xyz, \.txt or \.csv"):
        cloud().write(tmp_path / "cloud.doc", CRS)
    assert list(tmp_path.iterdir()) == []


def test_a_raster_is_written_and_read_back(tmp_path: Path) -> None:
    raster().write(tmp_path / "dsm.tif", CRS)
    back, crs = pg.read_raster(tmp_path / "dsm.tif")
    np.testing.assert_array_equal(back.values, raster().values)
    assert crs == CRS


def test_summaries_are_tables_of_text() -> None:
    rows = [" ".join(line.split()) for line in (cloud().summary() + "\n" + raster().summary()).splitlines()]
    assert "height 12.000 to 18.000 m" in rows
    assert "sigma, median east, north, up 0.0200, 0.0200, 0.0200 m" in rows
    assert "with data 83.3 %" in rows
    assert "values: least, median, largest 1.000, 4.000, 9.000" in rows


def test_an_adjustment_says_itself_is_drawn_and_written(tmp_path: Path) -> None:
    import matplotlib.pyplot as plt

    plan = pg.SurveyPlan(strips=2, photographs_per_strip=3, control_points=6, check_points=2)
    result = pg.adjust(simulated(plan, tie_points=150).block, pg.AdjustmentSettings())
    assert result.summary().startswith("sigma0")
    assert "redundancy" in result.summary()
    for value, drawn in ((result, "photographs"), (raster(), None), (cloud(), None)):
        figure = plt.figure()
        value.plot()
        axes = figure.axes[0]
        assert axes.get_xlabel() == "easting, m"
        if drawn is not None:
            legend = axes.get_legend()
            assert legend is not None
            assert [text.get_text() for text in legend.get_texts()] == [drawn, "control points", "check points"]
        plt.close(figure)
    result.write(tmp_path / "poses.csv")
    assert len((tmp_path / "poses.csv").read_text(encoding="utf-8").splitlines()) == 1 + len(result.block.photographs)
