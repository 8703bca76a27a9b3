"""Height systems: what heights are counted from, and the geoid between them.

An ellipsoidal height h is above the ellipsoid of GNSS (GRS 80, which WGS 84 shares to 0.1 mm); an orthometric height H
is above a geoid, or above the zero of a national levelling network. Their difference N = h − H, the geoid height, comes
from a grid through PROJ (Heiskanen & Moritz 1967, eq. 4-25). Heights of a local grid are above an inclined plane
instead, which its vertical CRS defines ("Vertical Offset and Slope", EPSG:1046; IOGP 373-7-2, sec. 4.6.3).
"""

import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import PurePath
from typing import Any, Literal

import numpy as np
from pyproj import CRS, Transformer
from pyproj.aoi import AreaOfInterest
from pyproj.crs import CompoundCRS, GeographicCRS
from pyproj.database import get_units_map
from pyproj.datadir import get_user_data_dir
from pyproj.exceptions import CRSError, ProjError
from pyproj.transformer import TransformerGroup

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.wording import shortened

HeightSystem = Literal["ellipsoidal", "orthometric"]

GEOID_MODELS = {"EGM84": "EPSG:5798", "EGM96": "EPSG:5773", "EGM2008": "EPSG:3855"}
"""Global geoids by the names that people write, and their vertical CRS."""

_SHORTEST_UNIT_M, _LONGEST_UNIT_M = 0.1, 2.0
_AROUND_DEG = 0.01
_STAND_IN = 5773
"""A vertical CRS, any one, that stands in a GeoTIFF until its key is changed."""

_PLANE_METHOD = 1046
_EVALUATION_LATITUDE, _EVALUATION_LONGITUDE = 8617, 8618
_OFFSET = 8603
_SLOPE_LATITUDE, _SLOPE_LONGITUDE = 8730, 8731
_ARC_SECOND = 4.84813681109536e-06

_SEMI_MAJOR_M, _SEMI_MINOR_M = 6378137.0, 6356752.3141
_SAME_ELLIPSOID_M = 0.01


@dataclass(frozen=True)
class Geoid:
    """The surface under orthometric heights: a vertical CRS that PROJ knows (``EPSG:5773``), a file with its grid, or
    both: then the CRS names it and the file gives its heights."""

    vertical: str | None = None
    grid: str | None = None

    def __post_init__(self) -> None:
        if self.vertical is None and self.grid is None:
            raise ValueError("a geoid needs a vertical CRS or a grid")

    @property
    def crs(self) -> CRS:
        """The vertical CRS of heights above it. Raises FrameError where PROJ does not know it."""
        if self.vertical is not None:
            return vertical_crs(self.vertical)
        name = PurePath(str(self.grid)).name.replace('"', "")
        return CRS.from_wkt(
            f'VERTCRS["height above geoid {name}",VDATUM["geoid {name}"],CS[vertical,1],'
            'AXIS["gravity-related height (H)",up,LENGTHUNIT["metre",1]]]'
        )

    @property
    def unit_m(self) -> float:
        """The unit of the heights that its vertical CRS counts, in metres."""
        return float(self.crs.axis_info[0].unit_conversion_factor)

    @property
    def is_plane(self) -> bool:
        """Whether it is the inclined plane under the heights of a local grid, no geoid."""
        return _is_plane(self.crs)

    @property
    def name(self) -> str:
        """What to call it in a sentence."""
        if self.vertical is None:
            return PurePath(str(self.grid)).name
        if self.is_plane:
            return f"of {self.crs.name}"
        code = f" ({self.vertical})" if self.vertical.upper().startswith("EPSG:") else ""
        return f"{self.crs.name.removesuffix(' height')}{code}"


@dataclass(frozen=True)
class DeclaredHeights:
    """Height systems of a survey; None where not declared."""

    output: HeightSystem | None = None
    """Of the map: of every ``_map_m`` and every product."""
    gnss: HeightSystem | None = None
    """Of all GNSS positions."""
    gnss_given: HeightSystem | None = None
    """Of those in the project file."""
    control_points: HeightSystem | None = None
    """Of ground points whose file does not declare one."""
    geoid: Geoid | None = None
    """The geoid, given where two systems differ or one is orthometric."""
    reference: HeightSystem | None = None
    """Of the reference of the comparison."""

    @property
    def map_geoid(self) -> Geoid | None:
        """The geoid under the heights of the map, None where they are ellipsoidal or not declared."""
        return self.geoid if self.output == "orthometric" else None

    def of_tags(self, height_is_ellipsoidal: bool | None) -> HeightSystem | None:
        """Return the system of a height in a photograph's tags: as declared, else as the tags themselves say."""
        if self.gnss is not None or height_is_ellipsoidal is None:
            return self.gnss
        return "ellipsoidal" if height_is_ellipsoidal else "orthometric"

    def sign_to_map(self, given: HeightSystem | None) -> float:
        """Return by how many geoid heights a height of the system ``given`` is raised to be one of the map: −1, 0 or 1.

        0 where a system is not declared, and where tags speak of sea level and no geoid is named.
        """
        if self.geoid is None or given is None or self.output is None:
            return 0.0
        return float((given == "orthometric") - (self.output == "orthometric"))


UNDECLARED = DeclaredHeights()
"""Of a survey whose project says nothing of heights."""


def vertical_crs(name: str) -> CRS:
    """Return the vertical CRS called ``name``. Raises FrameError unless PROJ knows it as one of heights in metres or
    feet."""
    try:
        crs = CRS.from_user_input(name)
    except CRSError as error:
        raise FrameError(
            f"{shortened(name)!r}: not a geoid known to PROJ: write {', '.join(GEOID_MODELS)}, a vertical CRS such "
            "as EPSG:5773, or the path of a grid (.gtx or .tif)"
        ) from error
    if not crs.is_vertical or crs.is_compound:
        raise FrameError(
            f"{shortened(name)!r} ({crs.name}) is not a vertical CRS: write EPSG:5773 or EPSG:5799, for example"
        )
    axis = crs.axis_info[0]
    if axis.direction != "up" or not _SHORTEST_UNIT_M <= axis.unit_conversion_factor <= _LONGEST_UNIT_M:
        raise FrameError(
            f"{shortened(name)!r} ({crs.name}) is not of heights in metres or feet, upwards: choose one that is"
        )
    if str(crs.type_name) == "Derived Vertical CRS" and not _is_plane(crs):
        raise FrameError(f"{crs.name} is derived by another method than Vertical Offset and Slope (EPSG:1046)")
    return crs


def in_metres(crs: CRS) -> CRS:
    """Return a plan with metres for the unit of its axes, all else as it was; PROJ converts the false origin with it.

    The name stays; a code that meant another unit is left out.
    """
    if crs.axis_info[0].unit_conversion_factor == 1.0:
        return crs
    return _in_unit(crs.to_2d(), "metre")


def _without_transformation(whole: Any) -> Any:  # noqa: ANN401 - PROJJSON
    """Return the map grid in the PROJJSON of one, which a transformation to another datum may be bound to."""
    return whole.get("source_crs", whole)


def _in_unit(crs: CRS, unit: object) -> CRS:
    """Return a map grid whose axes are all in a unit of PROJJSON."""
    whole = json.loads(crs.to_json())
    inner = _without_transformation(whole)
    for axis in inner["coordinate_system"]["axis"]:
        axis["unit"] = unit
    for part in (whole, inner):
        part.pop("id", None)
        if unit == "metre" and "name" in part:
            part["name"] = f"{part['name']}, in metres"
    return CRS.from_json_dict(whole)


def _is_plane(vertical: CRS) -> bool:
    operation = vertical.coordinate_operation
    return operation is not None and str(operation.method_code) == str(_PLANE_METHOD)


@lru_cache(maxsize=16)
def _plane_transformer(vertical: str) -> Transformer:
    """Return longitude, latitude (degrees) and ellipsoidal height to the same with the height above the plane that the
    vertical CRS, as WKT, defines."""
    operation = CRS.from_wkt(vertical).coordinate_operation
    if operation is None:
        raise ValueError("a vertical CRS that derives from nothing")
    value = {int(p.code): p.value * p.unit_conversion_factor for p in operation.params if str(p.code).isdigit()}
    try:
        lat, lon = np.rad2deg([value[_EVALUATION_LATITUDE], value[_EVALUATION_LONGITUDE]])
        north, east = (value.get(slope, 0.0) / _ARC_SECOND for slope in (_SLOPE_LATITUDE, _SLOPE_LONGITUDE))
        return Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
            f"+step +proj=vertoffset +a={_SEMI_MAJOR_M} +b={_SEMI_MINOR_M} +lat_0={lat:.15g} +lon_0={lon:.15g} "
            f"+dh={value[_OFFSET]:.15g} +slope_lat={north:.15g} +slope_lon={east:.15g} "
            "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
        )
    except (KeyError, ProjError) as error:
        raise FrameError("the height plane of the local grid lacks its offset or its evaluation point") from error


def is_gnss_ellipsoid(crs: CRS) -> bool:
    """Return whether the ellipsoid of a CRS is that of GNSS, to 1 cm: GRS 80 or WGS 84."""
    shape = crs.ellipsoid
    return shape is not None and (
        abs(shape.semi_major_metre - _SEMI_MAJOR_M) < _SAME_ELLIPSOID_M
        and abs(shape.semi_minor_metre - _SEMI_MINOR_M) < _SAME_ELLIPSOID_M
    )


def _missing_grids(group: TransformerGroup) -> str:
    grids = {grid.short_name: grid.url for operation in group.unavailable_operations for grid in operation.grids}
    if not grids:
        return ""
    name, url = next(iter(grids.items()))
    others = f" (or {', '.join(list(grids)[1:])})" if len(grids) > 1 else ""
    return f"PROJ lacks its grid {name}{others}: {how_to_fetch(name, url, 'heights.grid')}"


def how_to_fetch(grid: str, url: str, key: str) -> str:
    """Return how to get a file of a grid that PROJ lacks, from ``url`` where that is known, or to do without by a key
    of the project file."""
    return (
        f"fetch it with `projsync --file {grid}`, copy {url or 'it'} to {get_user_data_dir()}, set PROJ_NETWORK=ON, or "
        f"give a file that you have as {key}"
    )


def check_grid_path(what: str, grid: str) -> None:
    """Raise FrameError where PROJ cannot read the path of a grid: ``what`` it is the grid of."""
    if any(character in grid for character in ',"'):
        raise FrameError(f"{what} {grid}: its path has a comma or a quote, which PROJ cannot read: rename")


def around(place_deg: tuple[float, float]) -> AreaOfInterest:
    """Return the area around a longitude and latitude for which PROJ is to choose."""
    longitude, latitude = place_deg
    return AreaOfInterest(
        longitude - _AROUND_DEG, latitude - _AROUND_DEG, longitude + _AROUND_DEG, latitude + _AROUND_DEG
    )


@lru_cache(maxsize=16)
def _vertical_transformer(source: str, geoid: Geoid, place: tuple[float, float]) -> Transformer:
    """Return longitude, latitude (degrees) and ellipsoidal height to the same with the height above the geoid.

    ``source`` is a geographic CRS as WKT, ``place`` a longitude and latitude for which PROJ is to choose.
    """
    if geoid.grid is not None:
        check_grid_path("geoid grid", geoid.grid)
        try:
            return Transformer.from_pipeline(
                "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
                f'+step +inv +proj=vgridshift +grids="{geoid.grid}" +multiplier=1 '
                "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
            )
        except ProjError as error:
            raise FrameError(
                f"geoid grid {geoid.grid}: PROJ cannot read it: give a grid of geoid heights, .gtx or .tif"
            ) from error
    plan, vertical = CRS.from_wkt(source), geoid.crs
    target = CompoundCRS(f"{plan.name} + {vertical.name}", [plan.to_2d(), vertical])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of grids that are missing: said below, with what to do
        group = TransformerGroup(
            plan.to_3d(),
            target,
            always_xy=True,
            allow_ballpark=False,
            area_of_interest=around(place),
        )
    if not group.transformers:
        why = _missing_grids(group) or (
            f"PROJ has no transformation to it from {plan.name}: choose a crs of the same region, or give the "
            "geoid's file as heights.grid"
        )
        raise FrameError(f"geoid {geoid.name}: {why}")
    return group.transformers[0]


@lru_cache(maxsize=16)
def _to_gnss(source: str) -> Transformer:
    return Transformer.from_crs(CRS.from_wkt(source), "EPSG:4326", always_xy=True)


def geographic_crs(crs: CRS) -> CRS:
    """Return the geographic CRS that a map grid is projected from, longitude and latitude in degrees.

    Some count in grads (NTF (Paris), under Lambert zones of France): theirs comes back in degrees of the same datum and
    prime meridian. Raises FrameError where there is no geodetic datum.
    """
    geodetic = crs.geodetic_crs
    if geodetic is None or geodetic.datum is None:
        raise FrameError(f"crs: {crs.name} has no geodetic datum")
    plan = geodetic.to_2d()
    if all(axis.unit_name == "degree" for axis in plan.axis_info):
        return plan
    return GeographicCRS(f"{plan.name} in degrees", geodetic.datum)


def geoid_height_m(crs: CRS, geoid: Geoid, longitude_latitude_deg: FloatArray) -> FloatArray:
    """Return the height (N,) of a geoid above the ellipsoid of GNSS at longitudes and latitudes (N, 2) in the datum of
    ``crs``, bilinear in its grid; NaN outside the grid.

    Raises FrameError where PROJ does not know the geoid or lacks its grid; the message names the file.
    """
    source = geographic_crs(crs)
    places = np.asarray(longitude_latitude_deg, dtype=np.float64).reshape(-1, 2)
    if not len(places):
        return np.zeros(0)
    if not is_gnss_ellipsoid(crs):
        places = np.column_stack(_to_gnss(source.to_wkt()).transform(places[:, 0], places[:, 1]))
        source = CRS("EPSG:4326")
    if geoid.vertical is not None and geoid.grid is None and geoid.is_plane:
        level = _plane_transformer(geoid.crs.to_wkt()).transform(places[:, 0], places[:, 1], np.zeros(len(places)))[2]
        return np.where(np.isfinite(level), -np.asarray(level), np.nan)
    finite = places[np.isfinite(places).all(axis=1)]
    if not len(finite):
        return np.full(len(places), np.nan)
    east, north = np.median(finite, axis=0).tolist()
    transformer = _vertical_transformer(source.to_wkt(), geoid, (round(east, 1), round(north, 1)))
    unit_m = geoid.unit_m if geoid.grid is None else 1.0
    height = unit_m * np.asarray(transformer.transform(places[:, 0], places[:, 1], np.zeros(len(places)))[2])
    return np.where(np.isfinite(height), -height, np.nan)


def full_crs(plan: CRS, output: HeightSystem | None, geoid: Geoid | None) -> CRS:
    """Return the CRS of products: that of the plan alone where the heights are not declared, with a third axis where
    they are ellipsoidal, in the unit of the plan, compound with the vertical CRS of the geoid where they are
    orthometric."""
    if output is None:
        return plan.to_2d()
    if output == "ellipsoidal":
        full = plan.to_3d()
        metric = plan.axis_info[0].unit_conversion_factor == 1.0
        axes = _without_transformation(json.loads(plan.to_json()))["coordinate_system"]["axis"]
        return full if metric else _in_unit(full, axes[0]["unit"])
    if geoid is None:
        raise ValueError("orthometric heights need a geoid")
    vertical = geoid.crs
    codes = [plan.to_epsg(), vertical.to_epsg()]
    if None not in codes:
        return CRS.from_user_input(f"EPSG:{codes[0]}+{codes[1]}")
    return CompoundCRS(f"{plan.name} + {vertical.name}", [plan.to_2d(), vertical])


def crs_name(crs: CRS) -> str:
    """Return a CRS as text that PROJ reads back to the same: its EPSG code or codes, else WKT."""
    code = crs.to_epsg()
    if code is not None and CRS.from_epsg(code) == crs:
        return f"EPSG:{code}"
    parts: Sequence[Any] = crs.sub_crs_list
    codes = [part.to_epsg() for part in parts]
    if len(codes) == 2 and None not in codes:
        return f"EPSG:{codes[0]}+{codes[1]}"
    return str(crs.to_wkt())


def first_wkt(crs: CRS) -> str:
    """Return a CRS in the first edition of WKT (OGC 01-009), as LAS 1.4 asks for.

    That edition knows no map grid with a third axis: ellipsoidal heights stand there as a vertical CRS on the datum
    "Ellipsoid" of type 2002, which PROJ and GDAL read back as what it was. It knows no height plane either: the heights
    of a local grid are a vertical CRS of their own there; and a plan that derives from a map grid is written in the
    second edition, which LAS 1.5 allows.
    """
    if len(crs.axis_info) == 3 and not crs.is_compound:
        plan, unit = crs.to_2d(), crs.axis_info[2]
        return (
            f'COMPD_CS["{plan.name} + ellipsoidal height",{plan.to_wkt("WKT1_GDAL")},'
            f'VERT_CS["Ellipsoid ({unit.unit_name})",VERT_DATUM["Ellipsoid",2002],{_first_unit(unit)},'
            'AXIS["Ellipsoidal height",UP]]]'
        )
    try:
        return str(crs.to_wkt("WKT1_GDAL"))
    except CRSError:
        if not crs.is_compound:
            return str(crs.to_wkt())
    plan, vertical = crs.sub_crs_list
    try:
        first = plan.to_wkt("WKT1_GDAL")
    except CRSError:
        return str(crs.to_wkt())
    name = vertical.name.replace('"', "")
    return (
        f'COMPD_CS["{plan.name} + {name}",{first},VERT_CS["{name}",VERT_DATUM["{name}",2005],'
        f'{_first_unit(vertical.axis_info[0])},AXIS["Gravity-related height",UP]]]'
    )


def _first_unit(axis: Any) -> str:  # noqa: ANN401 - pyproj's Axis
    factor = axis.unit_conversion_factor
    return f'UNIT["{axis.unit_name}",{"1" if factor == 1.0 else format(factor, ".15g")}]'


def geotiff_crs(crs: CRS) -> tuple[CRS, int | None]:
    """Return a CRS as GDAL can write it into a GeoTIFF, and the code that its VerticalGeoKey has to be given then.

    GDAL writes no map grid with a third axis. A compound CRS with some vertical CRS makes the keys, and the code of the
    geographic CRS with three axes, in the place of that vertical CRS, says that heights are ellipsoidal. Of a map
    without a code, of which GDAL does not read it, or in feet, which that code is not, they become a vertical CRS
    called "ellipsoidal height", without code. Of a local grid it is the plan; see ``auxiliary_wkt``.
    """
    if auxiliary_wkt(crs) is not None:
        return crs.sub_crs_list[0] if crs.is_compound else crs, None
    if crs.is_compound:
        return _by_codes_of_parts(crs), None
    if len(crs.axis_info) != 3 or crs.ellipsoid is None or crs.geodetic_crs is None:
        return crs, None
    name, unit = crs_name(crs.to_2d()), crs.axis_info[2]
    plan, code = CRS.from_user_input(name), crs.geodetic_crs.to_3d().to_epsg()
    if name.startswith("EPSG:") and code is not None and unit.unit_conversion_factor == 1.0:
        return CompoundCRS(f"{plan.name}, ellipsoidal height", [plan, CRS.from_epsg(_STAND_IN)]), code
    ellipsoid = crs.ellipsoid.name.replace('"', "")
    length = f'LENGTHUNIT["{unit.unit_name}",{unit.unit_conversion_factor:.15g}]'
    vertical = CRS.from_wkt(
        f'VERTCRS["ellipsoidal height ({ellipsoid})",VDATUM["{ellipsoid} ellipsoid"],CS[vertical,1],'
        f'AXIS["ellipsoidal height (h)",up,{length}]]'
    )
    return CompoundCRS(f"{plan.name} + {vertical.name}", [plan, vertical]), None


def _by_codes_of_parts(crs: CRS) -> CRS:
    """Return a compound CRS whose parts have their codes: one that has a code itself, EPSG:7416 for example, is written
    without those of its parts, of which a GeoTIFF has keys."""
    codes = [part.to_epsg() for part in crs.sub_crs_list]
    return crs if None in codes else CompoundCRS(crs.name, [CRS.from_epsg(code) for code in codes])


def gdal_wkt(crs: CRS) -> str:
    """Return a CRS of ``geotiff_crs`` as the WKT that GDAL makes keys of.

    GDAL tells units by their codes, and takes that of a height for metres without one; PROJ leaves the codes of units
    out.
    """
    text = str(crs.to_wkt("WKT2_2019"))
    unit = crs.axis_info[-1]
    if not crs.is_compound or unit.unit_conversion_factor == 1.0:
        return text
    code = get_units_map(category="linear")[unit.unit_name].code
    place = text.rindex(f'LENGTHUNIT["{unit.unit_name}",')
    end = text.index("]", place)
    return text if text[end - 1] == "]" else f'{text[:end]},ID["EPSG",{code}]{text[end:]}'


def auxiliary_wkt(crs: CRS) -> str | None:
    """Return the WKT of a CRS that the keys of a GeoTIFF cannot hold whole, a local grid's, None of all others."""
    parts: Sequence[Any] = crs.sub_crs_list if crs.is_compound else [crs]
    return str(crs.to_wkt()) if any(str(part.type_name).startswith("Derived") for part in parts) else None
