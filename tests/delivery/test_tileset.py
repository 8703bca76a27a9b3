"""3D Tiles as other programs read them, against the surface and the orthophoto that they were made of."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from pyproj import Transformer
from pyproj.transformer import TransformerGroup
from surface_files import CELL_M, COLOUR, COLUMNS, DIFFERENCE, HOUSE, ROWS, UNSEEN_COLUMNS, surface_on, write_surface

from photogram.delivery.survey_contents import SurveyContents
from photogram.delivery.tiles.quadtree import Quadtree, Tile, sampled
from photogram.delivery.tiles.tileset import TILESET, write_tileset
from photogram.files.maps.rasters import open_raster
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.height_systems import Geoid, HeightSystem
from photogram.survey import Raster

from delivered import handed_over  # isort: skip

WEST, NORTH, BASE = 602_300.0, 5_794_160.0, 110.0
CRS = "EPSG:25832"
SIDE, ERROR_M = 32, 0.02
ORIGIN = (602_320.0, 5_794_140.0, 110.0)
GROUND = ("orthophoto", "walls", "surface without an orthophoto")
"""Materials of what is surface, unlike skirts."""


def survey_on(folder: Path, frame: LocalFrame | None = None) -> SurveyContents:
    top, orthophoto, _ = write_surface(folder, surface_on(WEST, NORTH, BASE), CRS)
    frame = LocalFrame(CRS, ORIGIN) if frame is None else frame
    system: HeightSystem = "ellipsoidal" if frame.geoid is None else "orthometric"
    return replace(handed_over(CRS), top=top, orthophoto=orthophoto, frame=frame, height_system=system)


@dataclass(frozen=True, eq=False)
class Opened:
    """A tile as the viewer has it."""

    node: dict[str, Any]
    level: int
    parts: dict[str, trimesh.Trimesh]
    """By the names of their materials; along east, north and up."""

    @property
    def box(self) -> np.ndarray:
        """Lower and upper corner (2, 3) of its bounding volume."""
        middle, axes = (np.array(self.node["boundingVolume"]["box"][a:b]) for a, b in ((0, 3), (3, 12)))
        half = axes.reshape(3, 3)
        assert (half == np.diag(np.diag(half))).all()
        return np.array([middle - np.diag(half), middle + np.diag(half)])


def opened(folder: Path) -> tuple[dict[str, Any], list[Opened]]:
    """Return tileset.json and its tiles, each after the one above it."""
    tileset = json.loads((folder / TILESET).read_text(encoding="utf-8"))

    def below(node: dict[str, Any], level: int) -> Iterator[Opened]:
        scene = trimesh.load_scene(folder / node["content"]["uri"], process=False, merge_primitives=False)
        parts = {mesh.visual.material.name: mesh for mesh in scene.dump()}
        for mesh in parts.values():  # a viewer turns y up into z up
            x, y, z = np.asarray(mesh.vertices).T
            mesh.vertices = np.column_stack([x, -z, y])
        yield Opened(node, level, parts)
        for child in node.get("children", ()):
            yield from below(child, level + 1)

    return tileset, list(below(tileset["root"], 0))


def on_map(tileset: dict[str, Any], enu_m: np.ndarray) -> np.ndarray:
    """Return points of a tile in the map, with ellipsoidal heights: by PROJ, from the root's transform."""
    root = np.array(tileset["root"]["transform"]).reshape(4, 4).T
    geocentric = enu_m @ root[:3, :3].T + root[:3, 3]
    east, north, height = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True).transform(*geocentric.T)
    plan = Transformer.from_crs("EPSG:4326", CRS, always_xy=True).transform(east, north)
    return np.column_stack([*plan, height])


def cell_of(place_map_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return (NORTH - place_map_m[:, 1]) / CELL_M - 0.5, (place_map_m[:, 0] - WEST) / CELL_M - 0.5


@pytest.fixture
def small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("photogram.delivery.tiles.tileset.SIDE", SIDE)


@pytest.mark.usefixtures("small_tiles")
def test_every_content_is_there_and_lies_in_its_volume(tmp_path: Path) -> None:
    holds, lacks = write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    assert lacks == ()
    assert holds == f"surface in {len(tiles)} tiles, 4 levels of detail, cells of 0.25 m at best"
    assert tileset["asset"]["version"] == "1.1"
    named = [tile.node["content"]["uri"] for tile in tiles]
    assert sorted([*named, TILESET]) == sorted(path.name for path in (tmp_path / "tiles").iterdir())
    assert {tile.level for tile in tiles} == {0, 1, 2, 3}
    assert tileset["geometricError"] > tiles[0].node["geometricError"]
    for tile in tiles:
        corners = np.vstack([mesh.vertices for mesh in tile.parts.values()])
        assert (corners >= tile.box[0] - 1e-4).all()
        assert (corners <= tile.box[1] + 1e-4).all()
        assert tile.node["refine"] == "REPLACE"
        for child in tile.node.get("children", ()):
            own = next(other for other in tiles if other.node is child)
            assert (own.box[0] >= tile.box[0] - 1e-9).all()
            assert (own.box[1] <= tile.box[1] + 1e-9).all()
            assert child["geometricError"] <= tile.node["geometricError"] / 2


@pytest.mark.usefixtures("small_tiles")
def test_vertices_are_cells_of_the_surface_on_the_globe(tmp_path: Path) -> None:
    write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    surface = surface_on(WEST, NORTH, BASE).values
    axes = np.array(tileset["root"]["transform"]).reshape(4, 4).T[:3, :3]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    for tile in tiles:
        stride = 2 ** (3 - tile.level)
        for name in set(tile.parts) & set(GROUND):
            place = on_map(tileset, np.asarray(tile.parts[name].vertices))
            row, column = cell_of(place)
            assert np.abs(row - row.round()).max() * CELL_M < 0.001
            assert np.abs(column - column.round()).max() * CELL_M < 0.001
            row, column = row.round().astype(int), column.round().astype(int)
            assert np.abs(place[:, 2] - surface[row, column]).max() < 0.001
            assert not (row % stride).any()
            assert not (column % stride).any()


@pytest.mark.usefixtures("small_tiles")
def test_ground_that_coarse_levels_miss_is_shown_by_finer_ones(tmp_path: Path) -> None:
    """A tile without heights of its own has an error all the same, or nobody would look below it."""
    survey, surface = survey_on(tmp_path), surface_on(WEST, NORTH, BASE)
    patch = surface.values[97:102, 65:70].copy()
    surface.values[:] = np.nan
    surface.values[97:102, 65:70] = patch
    write_surface(tmp_path, surface, CRS)
    write_tileset(tmp_path / "tiles" / TILESET, survey, ERROR_M)
    node, levels = json.loads((tmp_path / "tiles" / TILESET).read_text(encoding="utf-8"))["root"], []
    while "children" in node:
        (child,) = node["children"]
        levels.append("content" in node)
        assert child["geometricError"] < node["geometricError"]
        node = child
    assert levels == [False, False, True]
    assert "content" in node


def differences(tileset: dict[str, Any], tile: Opened, surface: Raster, stride: int) -> np.ndarray:
    """Return by how much the mesh of a tile lies above every ``stride``-th cell: triangle by triangle, by the plane
    through its corners."""
    off = []
    for name in set(tile.parts) & set(GROUND):
        mesh = tile.parts[name]
        place = on_map(tileset, np.asarray(mesh.vertices))
        row, column = cell_of(place)
        corners = np.column_stack([row.round() / stride, column.round() / stride, place[:, 2]])[mesh.faces]
        for corner in corners:
            (low_r, low_c), (high_r, high_c) = (np.floor(f(corner[:, :2], axis=0)) for f in (np.min, np.max))
            r, c = (v.reshape(-1) for v in np.mgrid[low_r : high_r + 1, low_c : high_c + 1])
            weight = np.linalg.solve(np.vstack([corner[:, :2].T, np.ones(3)]), np.vstack([r, c, np.ones(len(r))]))
            inside = (weight >= -1e-9).all(axis=0)
            r, c = (v[inside].astype(int) * stride for v in (r, c))
            on = (r < ROWS) & (c < COLUMNS)
            height = (corner[:, 2] @ weight[:, inside])[on]
            off.append(np.column_stack([r[on], c[on], height - surface.values[r[on], c[on]]]))
    every = np.vstack(off)
    _, first = np.unique(every[:, :2], axis=0, return_index=True)
    known = every[first, 2]
    return np.asarray(known[np.isfinite(known)])


@pytest.mark.usefixtures("small_tiles")
def test_stated_errors_are_measured_against_the_next_finer_level(tmp_path: Path) -> None:
    write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    surface = surface_on(WEST, NORTH, BASE)
    for tile in tiles:
        off = np.abs(differences(tileset, tile, surface, max(1, 2 ** (2 - tile.level))))
        said = tile.node["extras"]["vertical"]
        assert np.percentile(off, 95) == pytest.approx(said["off_95_m"], abs=0.002)
        assert off.max() == pytest.approx(said["greatest_m"], abs=0.01)
        assert tile.node["geometricError"] >= said["off_95_m"] - 1e-4
        if tile.level == 3:
            assert off.max() < ERROR_M + 0.001
    assert tiles[0].node["extras"]["vertical"]["greatest_m"] > 1.0, "a wall between two cells of the root"


@pytest.mark.usefixtures("small_tiles")
def test_no_gap_opens_between_tiles_of_any_levels(tmp_path: Path) -> None:
    """Along every border that two tiles share, the skirt of the higher one reaches the lower one or passes it."""
    write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    edges: dict[tuple[int, int], list[tuple[int, np.ndarray]]] = {}
    for number, tile in enumerate(tiles):
        if "skirts" not in tile.parts:
            continue
        place = on_map(tileset, np.asarray(tile.parts["skirts"].vertices))
        cells = np.column_stack([*cell_of(place), place[:, 2]])
        tops, bottoms = cells.reshape(2, -1, 2, 3)  # two by two an edge
        np.testing.assert_allclose(tops[..., :2], bottoms[..., :2], atol=0.01)
        for top, bottom in zip(tops, bottoms, strict=True):
            axis = 0 if abs(top[0, 0] - top[1, 0]) < 0.1 else 1
            along = sorted(zip(top[:, 1 - axis].round(), top[:, 2], bottom[:, 2], strict=True))
            edges.setdefault((axis, round(top[0, axis])), []).append((number, np.array(along)))
    met = set()
    for border in edges.values():
        for i, (one, a) in enumerate(border):
            for other, b in border[:i]:
                start, end = max(a[0, 0], b[0, 0]), min(a[1, 0], b[1, 0])
                if one == other or start >= end:
                    continue
                for at in np.linspace(start, end, 9):
                    (top_a, low_a), (top_b, low_b) = ([np.interp(at, e[:, 0], e[:, k]) for k in (1, 2)] for e in (a, b))
                    assert (low_a if top_a > top_b else low_b) <= min(top_a, top_b) + 1e-4
                met.add((tiles[one].level, tiles[other].level))
    assert {(a, b) for a, b in met if a != b} >= {(2, 1), (3, 1), (3, 2)}


@pytest.mark.usefixtures("small_tiles")
def test_pictures_walls_and_what_is_not_shown(tmp_path: Path) -> None:
    write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    walls = np.vstack([
        on_map(tileset, np.asarray(t.parts["walls"].vertices)) for t in tiles if t.level == 3 and "walls" in t.parts
    ])  # fmt: skip
    row, column = cell_of(walls)
    for cells, span in ((row, HOUSE[0]), (column, HOUSE[1])):
        assert (cells.min().round(), cells.max().round()) == (span.start - 1, span.stop)
    for tile in tiles:
        _, column = cell_of(on_map(tileset, np.asarray(tile.parts["orthophoto"].vertices)))
        assert column.max() < COLUMNS - UNSEEN_COLUMNS + 2 ** (3 - tile.level)
        material = tile.parts["orthophoto"].visual.material
        picture = np.asarray(material.baseColorTexture.convert("RGB"), dtype=int)
        assert np.abs(picture - COLOUR).max() <= DIFFERENCE
        uv = np.asarray(tile.parts["orthophoto"].visual.uv)
        assert uv.min() >= -1e-6
        assert uv.max() <= 1 + 1e-6
    content = (tmp_path / "tiles/0_0_0.glb").read_bytes()
    gltf = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    assert gltf["extensionsUsed"] == ["KHR_materials_unlit"]
    unlit = {material["name"] for material in gltf["materials"] if "extensions" in material}
    assert unlit == {"orthophoto", "skirts"} & {material["name"] for material in gltf["materials"]}
    grey = replace(survey_on(tmp_path), orthophoto=None)
    _, lacks = write_tileset(tmp_path / "grey" / TILESET, grey, ERROR_M)
    assert lacks == ("Orthophoto: there is none, so the surface is grey.",)
    assert set(opened(tmp_path / "grey")[1][0].parts) <= {"surface without an orthophoto", "walls"}


@pytest.mark.usefixtures("small_tiles")
def test_heights_above_a_geoid_become_ellipsoidal(tmp_path: Path, sloping_geoid: Any) -> None:
    frame = LocalFrame(CRS, ORIGIN, geoid=Geoid(grid=sloping_geoid.path))
    write_tileset(tmp_path / "tiles" / TILESET, survey_on(tmp_path, frame), ERROR_M)
    tileset, tiles = opened(tmp_path / "tiles")
    surface = surface_on(WEST, NORTH, BASE).values
    place = on_map(tileset, np.asarray(tiles[0].parts["orthophoto"].vertices))
    row, column = (v.round().astype(int) for v in cell_of(place))
    raised = place[:, 2] - surface[row, column]
    np.testing.assert_allclose(raised, sloping_geoid.at(CRS, place), atol=0.001)
    assert raised.min() > 40


@pytest.mark.usefixtures("small_tiles")
def test_the_same_survey_gives_the_same_bytes(tmp_path: Path) -> None:
    survey = survey_on(tmp_path)
    for name in ("a", "b"):
        write_tileset(tmp_path / name / TILESET, survey, ERROR_M)
    written = [{path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("a", "b")]
    assert written[0] == written[1]


@pytest.mark.filterwarnings("ignore:Best transformation:UserWarning")
def test_what_cannot_stand_on_the_globe_is_refused_in_a_sentence(tmp_path: Path) -> None:
    survey, path = survey_on(tmp_path), tmp_path / "tiles" / TILESET
    surface = replace(survey, top=None, absent={"surface": "surface.enabled is false"})
    assert write_tileset(path, surface, None) == ("", ("Surface: surface.enabled is false.",))
    nowhere = replace(survey, crs=NO_CRS, frame=LocalFrame.local())
    assert write_tileset(path, nowhere, None) == ("", ("Place on Earth: crs: none, and 3D Tiles stand on the globe.",))
    unnamed = replace(survey, height_system="orthometric")
    holds, (reason,) = write_tileset(path, unnamed, None)
    assert (holds, reason.split(":")[0]) == ("", "Heights above the ellipsoid")
    assert "names no geoid" in reason
    undeclared = replace(survey, height_system=None)
    _, (warned,) = write_tileset(tmp_path / "undeclared" / TILESET, undeclared, 0.5)
    assert "does not declare its height system" in warned
    assert not path.parent.exists()
    target = f"{CRS}+7837"
    if TransformerGroup("EPSG:4937", target, always_xy=True, allow_ballpark=False).transformers:
        pytest.skip("PROJ has the grid of DHHN2016 here")
    lacking = replace(survey, frame=LocalFrame(CRS, ORIGIN, geoid=Geoid("EPSG:7837")), height_system="orthometric")
    holds, (reason,) = write_tileset(path, lacking, None)
    assert holds == ""
    assert reason.startswith("Heights above the ellipsoid: ")
    assert "PROJ lacks its grid" in reason
    assert not path.parent.exists()


def test_tiles_of_all_levels_share_their_borders(tmp_path: Path) -> None:
    top, _, _ = write_surface(tmp_path, surface_on(WEST, NORTH, BASE), CRS)
    tree = Quadtree(open_raster(top).grid, 2, 20)
    assert tree.depth == 2
    assert [tree.stride(level) for level in range(3)] == [8, 4, 2]
    assert [child.name for child in tree.children(Tile(0, 0, 0))] == [
        "1_0_0.glb",
        "1_1_0.glb",
        "1_0_1.glb",
        "1_1_1.glb",
    ]
    assert not tree.holds(Tile(2, 4, 0)), "160 columns of cells are four tiles"
    values, surface = sampled(open_raster(top), (40, 40), 4, (21, 21)), surface_on(WEST, NORTH, BASE).values
    np.testing.assert_array_equal(values, surface[40:121:4, 40:121:4])
    beyond = sampled(open_raster(top), (80, 0), 4, (21, 41))
    assert np.isnan(beyond[11:]).all()
    np.testing.assert_array_equal(beyond[:11], surface[80::4, ::4])
