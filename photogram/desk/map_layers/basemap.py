"""A map of somebody else under that of the survey, in tiles of the Web Mercator projection, where the user names one.

A site is small: between its grid and the tiles' projection go polynomials of the third degree, fitted to places around
it, so that the page needs no library of projections.
"""

from urllib.parse import urlsplit

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.errors import WorkspaceError
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import geodetic_from_map

EARTH_RADIUS_M = 6378137.0
"""Of the sphere of Web Mercator (EPSG:3857)."""
AROUND = 3.0
"""How far polynomials are fitted from the middle of the site, in half its longer side."""
LEAST_HALF_M = 100.0

_SAMPLES = 13  # along each side
_DEGREE = 3


class Polynomials(TypedDict):
    """Two polynomials of the third degree: of coordinates less ``from_centre``, over ``from_half``; their values times
    ``to_half`` and ``to_centre`` are the others. Their coefficients are of 1, y, y², y³, x, xy, xy², x², x²y, x³."""

    from_centre: list[float]
    from_half: float
    to_centre: list[float]
    to_half: float
    coefficients: list[list[float]]
    largest_error: float
    """Of them at the places they were fitted to."""


class Basemap(TypedDict):
    """Tiles under the map."""

    url: str
    """With {x}, {y} and {z}."""
    host: str
    mercator_from_map: Polynomials
    map_from_mercator: Polynomials


def tile_origin(url: str) -> str:
    """Return scheme and host of the address of tiles. Raises WorkspaceError where it is none."""
    parts = urlsplit(url)
    whole = all(f"{{{name}}}" in url for name in "xyz")
    if (
        parts.scheme not in ("http", "https")
        or not parts.hostname
        or not whole
        or any(c in parts.netloc for c in " ;,'\"")
    ):
        raise WorkspaceError(
            f"{url}: no address of tiles: give one such as https://tile.example.org/{{z}}/{{x}}/{{y}}.png"
        )
    return f"{parts.scheme}://{parts.netloc}"


def basemap(url: str, crs: str, places_map_m: FloatArray) -> Basemap | None:
    """Return the tiles at ``url`` for a survey in ``crs`` around places (N, 2 or 3), None where there are no places or
    the survey has no map grid. Raises WorkspaceError as ``tile_origin``, FrameError where places lie outside the
    CRS."""
    places = places_map_m[np.isfinite(places_map_m[:, :2]).all(axis=1)]
    if crs == NO_CRS or not len(places):
        return None
    low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    half = AROUND * max(0.5 * float(np.max(high - low)), LEAST_HALF_M)
    step = np.linspace(-half, half, _SAMPLES)
    place = 0.5 * (low + high) + np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    geodetic = np.radians(geodetic_from_map(crs, np.column_stack([place, np.zeros(len(place))]))[:, :2])
    north = np.log(np.tan(0.25 * np.pi + 0.5 * geodetic[:, 1]))
    mercator = EARTH_RADIUS_M * np.column_stack([geodetic[:, 0], north])
    return {
        "url": url,
        "host": str(urlsplit(tile_origin(url)).hostname),
        "mercator_from_map": _fitted(place, mercator),
        "map_from_mercator": _fitted(mercator, place),
    }


def _powers(unit: FloatArray) -> FloatArray:
    return np.column_stack(
        [unit[:, 0] ** i * unit[:, 1] ** j for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    )


def _fitted(source: FloatArray, target: FloatArray) -> Polynomials:
    (from_centre, from_half), (to_centre, to_half) = _scale(source), _scale(target)
    powers = _powers((source - from_centre) / from_half)
    coefficients = np.linalg.lstsq(powers, (target - to_centre) / to_half, rcond=None)[0]
    error = to_half * np.abs(powers @ coefficients - (target - to_centre) / to_half)
    return {
        "from_centre": from_centre.tolist(),
        "from_half": from_half,
        "to_centre": to_centre.tolist(),
        "to_half": to_half,
        "coefficients": coefficients.T.tolist(),
        "largest_error": float(error.max()),
    }


def _scale(place: FloatArray) -> tuple[FloatArray, float]:
    low, high = place.min(axis=0), place.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.max(high - low))
