"""Parts of the orthophoto by themselves: interpolation, decoded photographs, the files that the stage writes, edited
seams."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
import rasterio
import rasterio.features
import shapely
from hypothesis import given
from hypothesis import strategies as st

from photogram.arrays import ByteArray
from photogram.errors import ProjectError
from photogram.files.maps.seam_files import NamedPolygon, read_seams, write_seams
from photogram.pipeline.pipeline import load_project, open_run
from photogram.pipeline.stages.orthophoto import edited_seams, make_orthophoto
from photogram.pipeline.stages.orthophoto_pieces import CachedPhotographs
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.store.run import Run
from photogram.surface.ortho.orthophoto import OrthophotoSettings
from photogram.surface.ortho.resampling import add_cubic, catmull_rom


@given(st.floats(0.0, 1.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_interpolation_keeps_parabolas(t: float, a: float, b: float, c: float) -> None:
    weight, x = np.empty(4), np.arange(-1.0, 3.0)
    catmull_rom(t, weight)
    assert weight.sum() == pytest.approx(1.0)
    assert weight @ (a + b * x + c * x * x) == pytest.approx(a + b * t + c * t * t, abs=1e-9)


def test_interpolation_runs_along_columns_and_rows() -> None:
    v, u = np.mgrid[0:12, 0:17]
    picture = np.stack([10 * u, 20 * v, 3 * u + 5 * v], axis=2).astype(np.uint8)
    out = np.zeros(3)
    add_cubic(picture, 7.3, 4.6, 2.0, np.empty(4), np.empty(4), out)
    np.testing.assert_allclose(out, 2.0 * np.array([73.0, 92.0, 44.9]))


def test_photographs_are_decoded_once_and_few_are_kept() -> None:
    read: list[int] = []
    start = Barrier(4)

    def decode(number: int) -> ByteArray:
        read.append(number)
        return np.full((2, 2, 3), number, np.uint8)

    held = CachedPhotographs(decode, 2)

    def ask(number: int) -> int:
        start.wait()
        return int(held(number)[0, 0, 0])

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(ask, [7, 7, 7, 7])) == [7, 7, 7, 7]
    assert read == [7]
    assert [int(held(n)[0, 0, 0]) for n in (8, 7, 9, 7, 8)] == [8, 7, 9, 7, 8]
    assert read == [7, 8, 9, 8]


def test_a_photograph_that_cannot_be_read_stops_whoever_asks() -> None:
    def fail(number: int) -> ByteArray:
        raise OSError(f"photograph {number}")

    with pytest.raises(OSError, match="photograph 3"):
        CachedPhotographs(fail, 2)(3)


@pytest.mark.survey
def test_the_stage_writes_an_orthophoto_over_the_surface(adjusted_survey: Path, tmp_path: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    texts: list[str] = []
    (tmp_path / "made").mkdir()
    with open_run(replace(project, orthophoto=OrthophotoSettings(cell_m=0.06))) as run:
        summary = make_orthophoto(run, tmp_path / "made", lambda _done, _total, text: texts.append(text))
        surface = StoredSurface(run).filled()
    assert texts[0] == "seams and exposure"
    with rasterio.open(tmp_path / "made/orthophoto.tif") as dataset:
        assert dataset.count == 4
        alpha, box = dataset.read(4), dataset.bounds
    assert (
        summary["cells"]
        == np.count_nonzero(alpha == 255)
        > 0.5 * np.count_nonzero(np.isfinite(surface.values)) * (surface.cell_m / 0.06) ** 2
    )
    assert box.left <= surface.west_map_m + surface.values.shape[1] * surface.cell_m
    files = [
        "grid.json", "orthophoto.tif", "orthophoto_sigma.tif", "orthophoto_source.tif", "orthophoto_source.tif.aux.xml",
        "outline.gpkg", "rim.json",
    ]  # fmt: skip
    assert sorted(path.name for path in (tmp_path / "made").iterdir()) == files


def make(run: Run, folder: Path) -> None:
    folder.mkdir()
    make_orthophoto(run, folder, lambda *_: None)


@pytest.mark.survey
def test_edited_seams_are_taken_as_they_are(adjusted_survey: Path, tmp_path: Path) -> None:
    """Seams that come back as they were written change next to nothing; a polygon drawn over them is obeyed."""
    project = load_project(adjusted_survey / "project.yaml")
    pictures = []
    settings = OrthophotoSettings(cell_m=0.12, balance=False, feather_cells=0.0)
    with open_run(replace(project, orthophoto=settings)) as run:
        make(run, tmp_path / "own")
    own = tmp_path / "own/outline.gpkg"
    names = [p.name for p in project.photographs]
    seams = read_seams(own, names, project.crs)
    largest = max(seams, key=lambda seam: float(seam.polygon.area))
    other = next(name for name in names if name != largest.photograph)
    drawn = largest.polygon.centroid.buffer(3.0)
    write_seams(tmp_path / "drawn.gpkg", drawn, [NamedPolygon(other, drawn)], project.crs)
    for name, file in (("again", own), ("drawn", tmp_path / "drawn.gpkg")):
        with open_run(replace(project, orthophoto=replace(settings, seams=str(file)))) as run:
            make(run, tmp_path / name)
    for name in ("own", "again", "drawn"):
        with rasterio.open(tmp_path / name / "orthophoto.tif") as dataset:
            pictures.append(dataset.read())
            inside = rasterio.features.geometry_mask([drawn], dataset.shape, dataset.transform, invert=True)
    before, again, changed = pictures
    assert np.mean((before == again).all(axis=0)) > 0.97
    differs = (before != changed).any(axis=0)
    shown = (before[3] > 0) & (changed[3] > 0)
    assert np.mean(differs[inside & shown]) > 0.5 > 0.1 > np.mean(differs[~inside & shown])
    found = {seam.photograph for seam in read_seams(tmp_path / "drawn/outline.gpkg", names, project.crs)}
    assert other in found


@pytest.mark.survey
def test_seams_of_a_photograph_without_a_pose_are_refused(adjusted_survey: Path, tmp_path: Path) -> None:
    project = load_project(adjusted_survey / "project.yaml")
    square = shapely.box(0.0, 0.0, 1.0, 1.0)
    name = project.photographs[0].name
    write_seams(tmp_path / "seams.gpkg", square, [NamedPolygon(name, square)], project.crs)
    edited = replace(project, orthophoto=OrthophotoSettings(seams=str(tmp_path / "seams.gpkg")))
    with pytest.raises(ProjectError, match=rf"seams\.gpkg: {name}: not oriented, nothing can be taken from it"):
        edited_seams(edited, [p.name for p in project.photographs[1:]], project.crs)
    assert edited_seams(project, [], project.crs) is None
