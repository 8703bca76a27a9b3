"""How a map is projected from its ellipsoid, for files that other programs compute with."""

from dataclasses import dataclass

from photogram.errors import FrameError
from photogram.geodesy.crs import metric_crs

_TRANSVERSE_MERCATOR = (
    "Latitude of natural origin",
    "Longitude of natural origin",
    "Scale factor at natural origin",
    "False easting",
    "False northing",
)
"""The parameters of the method as EPSG calls them (Guidance Note 7-2, sec. 3.2.3)."""


@dataclass(frozen=True)
class MapProjection:
    """The projection of a map grid that counts metres: its ``method`` as EPSG calls it, the semi-axes of its ellipsoid,
    m, and of a Transverse Mercator latitude and longitude of its origin, rad, the scale factor there, false easting
    and northing, m; no ``parameters`` of any other method."""

    method: str
    semi_axes_m: tuple[float, float]
    parameters: tuple[float, ...]


def projection_of(crs: str) -> MapProjection:
    """Return the projection of the map grid called ``crs``. Raises FrameError where PROJ does not know it."""
    grid = metric_crs(crs)
    if grid.ellipsoid is None:
        raise FrameError(f"crs: {crs} has no ellipsoid")
    operation = grid.coordinate_operation
    named = {} if operation is None else {p.name: p.value * p.unit_conversion_factor for p in operation.params}
    method = "" if operation is None else str(operation.method_name)
    parameters = tuple(float(named[name]) for name in _TRANSVERSE_MERCATOR if name in named)
    known = method == "Transverse Mercator" and len(parameters) == len(_TRANSVERSE_MERCATOR)
    axes = grid.ellipsoid.semi_major_metre, grid.ellipsoid.semi_minor_metre
    return MapProjection(method, axes, parameters if known else ())
