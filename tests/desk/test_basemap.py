"""Tiles under the map: their place, and which addresses are taken."""

from threading import Thread

import numpy as np
import pytest
from loopback import asked
from pyproj import Transformer

from photogram.arrays import FloatArray
from photogram.desk.desk import Desk
from photogram.desk.map_layers.basemap import Basemap, Polynomials, basemap, tile_origin
from photogram.desk.server import DeskServer
from photogram.errors import WorkspaceError

URL = "https://tile.example.org/{z}/{x}/{y}.png"


def at(polynomials: Polynomials, place: FloatArray) -> FloatArray:
    u, v = ((place - polynomials["from_centre"]) / polynomials["from_half"]).T
    powers = np.column_stack([u**0, v, v**2, v**3, u, u * v, u * v**2, u**2, u**2 * v, u**3])
    unit: FloatArray = powers @ np.array(polynomials["coefficients"]).T
    return np.array(polynomials["to_centre"]) + polynomials["to_half"] * unit


@pytest.mark.parametrize(
    ("crs", "middle", "side_m"),
    [
        ("EPSG:25832", (602340.0, 5794120.0), 300.0),
        ("EPSG:32633", (650000.0, 7600000.0), 5000.0),
        ("EPSG:2056", (2600000.0, 1200000.0), 2000.0),
    ],
)
def test_places_are_those_of_a_library_of_projections(crs: str, middle: tuple[float, float], side_m: float) -> None:
    rng = np.random.default_rng(1)
    places = np.array(middle) + side_m * rng.uniform(-0.5, 0.5, (50, 2))
    found = basemap(URL, crs, np.column_stack([places, np.full(50, 100.0)]))
    assert found is not None
    there = np.column_stack(Transformer.from_crs(crs, "EPSG:3857", always_xy=True).transform(*places.T))
    np.testing.assert_allclose(at(found["mercator_from_map"], places), there, atol=0.02)
    np.testing.assert_allclose(at(found["map_from_mercator"], there), places, atol=0.02)
    assert found["mercator_from_map"]["largest_error"] < 0.02
    assert (found["host"], found["url"]) == ("tile.example.org", URL)


def test_without_a_place_or_a_grid_there_is_none() -> None:
    none: Basemap | None = basemap(URL, "EPSG:25832", np.full((2, 3), np.nan))
    assert none is None
    assert basemap(URL, "none", np.zeros((2, 3))) is None


@pytest.mark.parametrize(
    "url",
    ["tile.example.org/{z}/{x}/{y}", "https://tile.example.org/{z}/{x}", "ftp://tile.example.org/{z}/{x}/{y}",
     "https:///{z}/{x}/{y}", "https://a.example; script-src *;/{z}/{x}/{y}", "javascript:{x}{y}{z}"],
)  # fmt: skip
def test_what_is_no_address_of_tiles_is_refused(url: str) -> None:
    with pytest.raises(WorkspaceError, match="no address of tiles"):
        tile_origin(url)


def test_pictures_of_that_server_alone_are_allowed(tmp_path_factory: pytest.TempPathFactory) -> None:
    recent = tmp_path_factory.mktemp("state") / "desk.json"
    for tiles in (None, URL):
        with Desk(recent, tiles) as desk:
            server = DeskServer(desk)
            thread = Thread(target=server.serve)
            thread.start()
            policy = asked(server, "")[1]["Content-Security-Policy"]
            server.stop()
            thread.join(10)
        assert ("tile.example.org" in policy) == (tiles is not None)
        assert "img-src 'self'" in policy
        assert "default-src 'self'" in policy
