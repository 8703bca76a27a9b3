"""model.glb as another program reads it, against the surface and the orthophoto that it was made of."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import trimesh
from delivered import CELL, NORTH, WEST, handed_over, hill
from rasterio.transform import from_origin

from photogram.delivery.model.glb_model import write_model
from photogram.delivery.survey_contents import SurveyContents
from photogram.files.maps.rasters import write_raster
from photogram.grid import MapGrid
from photogram.report.view.drawn_surface import STEEPEST_DEG
from photogram.survey import Raster

ERROR_M = 0.05
PIXEL = CELL / 2
WALL_M = 8.0
HOUSE = slice(120, 160), slice(60, 110)
"""Cells of a house on the hill, with upright walls."""
UNSEEN_COLUMNS = 40
"""Of the east of the surface, which the orthophoto does not show."""


def with_a_house() -> Raster:
    surface = hill()
    surface.values[HOUSE] += WALL_M
    return surface


def colours(east: np.ndarray, north: np.ndarray) -> np.ndarray:
    """Colours (…, 3) of the ground, smooth, so that JPEG hardly changes them."""
    x, y = (east - WEST) / 60.0, (NORTH - north) / 50.0
    return np.stack([40 + 160 * x, 220 - 170 * y, 90 + 60 * x * y], axis=-1)


def survey_on(folder: Path, crs: str = "EPSG:25832", *, coloured: bool = True) -> SurveyContents:
    """Return what is handed over of a house on a hill, with its rasters in a folder."""
    surface, top, orthophoto = with_a_house(), folder / "dsm_filled.tif", folder / "orthophoto.tif"
    write_raster(top, surface, crs)
    rows, columns = (2 * n for n in surface.values.shape)
    grid = MapGrid(WEST, NORTH, PIXEL, rows, columns)
    east, north = grid.centres_map_m(grid.whole)
    shown = np.zeros((4, rows, columns), dtype=np.uint8)
    shown[:3] = np.moveaxis(colours(*np.meshgrid(east, north)), 2, 0).round()
    shown[3, :, : columns - 2 * UNSEEN_COLUMNS] = 255
    profile = {"driver": "GTiff", "dtype": "uint8", "count": 4, "height": rows, "width": columns, "crs": crs}
    with rasterio.open(orthophoto, "w", transform=from_origin(WEST, NORTH, PIXEL, PIXEL), **profile) as dataset:
        dataset.write(shown)
    return replace(handed_over(crs), top=top, orthophoto=orthophoto if coloured else None)


def opened(path: Path) -> tuple[dict[str, trimesh.Trimesh], dict[str, Any]]:
    """Return the meshes of a GLB by the names of their materials, and what its asset says of it."""
    scene = trimesh.load_scene(path, process=False, merge_primitives=False)
    meshes = {mesh.visual.material.name: mesh for mesh in scene.dump()}
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    assert (content[:4], int.from_bytes(content[8:12], "little")) == (b"glTF", len(content))
    return meshes, json.loads(content[20 : 20 + length])["asset"]["extras"]


def on_map(mesh: trimesh.Trimesh, extras: dict[str, Any]) -> np.ndarray:
    x, y, z = np.asarray(mesh.vertices, dtype=np.float64).T
    return np.asarray(extras["origin_map_m"] + np.column_stack([x, -z, y]))


def test_vertices_are_cells_of_the_surface_and_the_mesh_is_within_its_error(tmp_path: Path) -> None:
    holds, lacks = write_model(tmp_path / "model.glb", survey_on(tmp_path), ERROR_M)
    assert lacks == ()
    meshes, extras = opened(tmp_path / "model.glb")
    assert set(meshes) == {"orthophoto", "walls"}
    assert f"surface of {sum(len(mesh.faces) for mesh in meshes.values())} triangles, within 0.0" in holds
    assert extras["crs"] == "EPSG:25832"
    assert extras["greatest_vertical_error_m"] <= ERROR_M + 1e-4
    surface = with_a_house().values
    for mesh in meshes.values():
        place = on_map(mesh, extras)
        column, row = (place[:, 0] - WEST) / CELL - 0.5, (NORTH - place[:, 1]) / CELL - 0.5
        assert np.abs(column - column.round()).max() * CELL < 0.001
        assert np.abs(row - row.round()).max() * CELL < 0.001
        assert np.abs(place[:, 2] - surface[row.round().astype(int), column.round().astype(int)]).max() < 0.001


def test_what_has_no_height_or_no_picture_is_not_drawn(tmp_path: Path) -> None:
    write_model(tmp_path / "model.glb", survey_on(tmp_path), ERROR_M)
    meshes, extras = opened(tmp_path / "model.glb")
    for mesh in meshes.values():
        place = on_map(mesh, extras)
        middle = place[mesh.faces].mean(axis=1)
        assert place[:, 0].max() < WEST + 60.0 - UNSEEN_COLUMNS * CELL
        assert not ((middle[:, 0] < WEST + 28 * CELL) & (middle[:, 1] > NORTH - 18 * CELL)).any()


def test_walls_are_a_grey_part_of_their_own_and_normals_point_upwards(tmp_path: Path) -> None:
    write_model(tmp_path / "model.glb", survey_on(tmp_path), ERROR_M)
    meshes, extras = opened(tmp_path / "model.glb")
    for name, steep in (("orthophoto", False), ("walls", True)):
        place, faces = on_map(meshes[name], extras), meshes[name].faces
        across = np.cross(place[faces[:, 1]] - place[faces[:, 0]], place[faces[:, 2]] - place[faces[:, 0]])
        slope_deg = np.degrees(np.arccos(across[:, 2] / np.linalg.norm(across, axis=1)))
        assert ((slope_deg > STEEPEST_DEG - 0.1) if steep else (slope_deg < STEEPEST_DEG + 0.1)).all()
    assert meshes["orthophoto"].vertex_normals[:, 1].min() > 0.3, "glTF is y-up"
    assert meshes["walls"].visual.material.baseColorTexture is None
    rows, columns = HOUSE
    around = on_map(meshes["walls"], extras)
    assert around[:, 0].min() == pytest.approx(WEST + columns.start * CELL, abs=CELL)
    assert around[:, 1].max() == pytest.approx(NORTH - rows.start * CELL, abs=CELL)


def test_the_picture_lies_where_the_orthophoto_does(tmp_path: Path) -> None:
    write_model(tmp_path / "model.glb", survey_on(tmp_path), ERROR_M)
    meshes, extras = opened(tmp_path / "model.glb")
    mesh = meshes["orthophoto"]
    place, picture = on_map(mesh, extras), np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"), dtype=float)
    # trimesh counts v from below
    column = np.clip(mesh.visual.uv[:, 0] * picture.shape[1], 0, picture.shape[1] - 1).astype(int)
    row = np.clip((1.0 - mesh.visual.uv[:, 1]) * picture.shape[0], 0, picture.shape[0] - 1).astype(int)
    inner = place[:, 0] < WEST + 60.0 - (UNSEEN_COLUMNS + 16) * CELL  # JPEG blurs the rim by a block
    off = picture[row, column] - colours(place[:, 0], place[:, 1])
    assert np.abs(off[inner]).max() < 4.0


def test_a_survey_without_orthophoto_is_grey_and_one_without_surface_not_written(tmp_path: Path) -> None:
    survey = survey_on(tmp_path, coloured=False)
    _, lacks = write_model(tmp_path / "model.glb", survey, ERROR_M)
    assert lacks == ("Orthophoto: there is none, so the surface is grey.",)
    meshes, _ = opened(tmp_path / "model.glb")
    assert set(meshes) == {"surface without an orthophoto", "walls"}
    absent = replace(survey, top=None, absent={"surface": "surface.enabled is false"})
    assert write_model(tmp_path / "none.glb", absent, ERROR_M) == ("", ("Surface: surface.enabled is false.",))
    assert not (tmp_path / "none.glb").exists()


def test_the_same_survey_gives_the_same_bytes_and_an_error_out_of_reach_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey = survey_on(tmp_path)
    for name in ("a.glb", "b.glb"):
        write_model(tmp_path / name, survey, ERROR_M)
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()
    monkeypatch.setattr("photogram.delivery.model.glb_model.MOST_VERTICES", 400)
    _, lacks = write_model(tmp_path / "c.glb", survey, ERROR_M)
    (coarser,) = lacks
    assert coarser.startswith("Heights within 0.05 m: that takes more than 400 vertices: give a larger")
