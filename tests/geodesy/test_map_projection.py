"""How a map is projected, as files for other programs say it."""

import numpy as np
import pytest

from photogram.errors import FrameError
from photogram.geodesy.map_projection import projection_of


def test_a_transverse_mercator_has_its_parameters() -> None:
    utm = projection_of("EPSG:25832")
    assert utm.method == "Transverse Mercator"
    assert utm.semi_axes_m == pytest.approx((6378137.0, 6356752.314140356), abs=1e-9)
    assert utm.parameters == pytest.approx((0.0, np.radians(9.0), 0.9996, 500000.0, 0.0))


@pytest.mark.parametrize(("crs", "method"), [("EPSG:2056", "Hotine Oblique"), ("EPSG:2229", "Lambert Conic")])
def test_any_other_is_named_alone(crs: str, method: str) -> None:
    projection = projection_of(crs)
    assert projection.method.startswith(method)
    assert projection.parameters == ()


def test_no_map_has_no_projection() -> None:
    with pytest.raises(FrameError):
        projection_of("none")
