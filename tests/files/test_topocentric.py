"""East, north and up at an origin, as PROJ has them."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer

from photogram.files.exchange.opensfm.topocentric import geodetic_from_topocentric, topocentric_from_geodetic

ORIGINS = [(50.1, 8.7, 120.0), (-33.9, 151.2, -30.0), (0.0, -180.0, 0.0), (89.9, 45.0, 3000.0)]


@pytest.mark.parametrize("origin", ORIGINS)
def test_both_ways_agree_with_proj(origin: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(4)
    enu = rng.normal(0, 3000, (200, 3))
    lat, lon, height = origin
    proj = Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0={height}"
    )
    geodetic = geodetic_from_topocentric(origin, enu)
    back = np.column_stack(proj.transform(*np.deg2rad(geodetic[:, :2]).T, geodetic[:, 2], radians=True))
    assert np.abs(back - enu).max() < 1e-7
    assert np.abs(topocentric_from_geodetic(origin, geodetic) - enu).max() < 2e-8
