"""The definition of a local grid as a CRS that PROJ transforms with, both ways.

Without a given map the plan is a *Hotine Oblique Mercator, variant B* (EPSG:9815; IOGP 373-7-2, sec. 3.5.1) whose
initial line is the meridian through the middle of the site: a transverse Mercator there, equal to it to 1 µm within
17 km, whose angle of the rectified grid turns and whose scale factor scales it. So a similarity of the projection is a
projection again, with parameters that GeoTIFF, LAS and ESRI's WKT can hold. On a given map the similarity is an *affine
parametric transformation* (EPSG:9624) that derives a projected CRS, which the second edition of WKT alone knows.
Heights derive by *Vertical Offset and Slope* (EPSG:1046).
"""

import json

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from photogram.arrays import FloatArray
from photogram.errors import FrameError
from photogram.geodesy.crs import MapUnits, metric_crs
from photogram.geodesy.height_systems import geographic_crs
from photogram.local_grids.calibration import HeightFit, PlaneSimilarity

_ARC_SECOND = 4.84813681109536e-06
_DEGREE = 'ANGLEUNIT["degree",0.0174532925199433]'
_METRE = 'LENGTHUNIT["metre",1]'
_UNITS: dict[str, object] = {
    "metre": "metre",
    "foot": {"type": "LinearUnit", "name": "foot", "conversion_factor": 0.3048},
    "US survey foot": {"type": "LinearUnit", "name": "US survey foot", "conversion_factor": 0.304800609601219},
}
UNITS = {
    "m": MapUnits(),
    "ft": MapUnits(0.3048, 0.3048, "foot", "foot"),
    "ftUS": MapUnits(0.30480060960121924, 0.30480060960121924, "US survey foot", "US survey foot"),
}
"""Units of local grids by their symbols."""


def site_map(base: str, middle_deg: FloatArray) -> str:
    """Return the map about the middle of a site, longitude and latitude (2,), on the datum of the CRS ``base``, that a
    local grid is a similarity of: its x and y are 0 at the middle. Raises FrameError where ``base`` has no datum."""
    plain = PlaneSimilarity(np.zeros(2), 0.0, 1.0)
    return str(_oblique("map about a site", base, middle_deg, plain, UNITS["m"]).to_wkt())


def local_grid(
    name: str,
    base: str,
    middle_deg: FloatArray,
    plan: PlaneSimilarity,
    height: HeightFit | None,
    units: MapUnits,
    given_map: str | None = None,
) -> str:
    """Return the WKT, of the second edition, of a local grid called ``name`` with axes in ``units``.

    ``base`` is the CRS on whose datum it lies, ``middle_deg`` (2,) longitude and latitude of the middle of the site,
    where ``plan`` has x = y = 0; with a ``given_map`` x and y are its easting and northing instead. Without ``height``
    it has no vertical part. Raises FrameError where PROJ cannot make it.
    """
    called = name.replace('"', "").strip()
    try:
        if given_map is None:
            crs = _oblique(called, base, middle_deg, plan, units)
        else:
            crs = _derived(called, given_map, plan, units)
        if height is None:
            return str(crs.to_wkt(pretty=True))
        whole = f'COMPOUNDCRS["{called}",{crs.to_wkt()},{_heights(called, height, units)}]'
        return str(CRS.from_wkt(whole).to_wkt(pretty=True))
    except CRSError as error:
        raise FrameError(f"local grid {called}: PROJ cannot make it ({error})") from error


def _axes(units: MapUnits) -> dict[str, object]:
    unit = _UNITS[units.plan]
    east = {"name": "Easting", "abbreviation": "E", "direction": "east", "unit": unit}
    north = {"name": "Northing", "abbreviation": "N", "direction": "north", "unit": unit}
    return {"subtype": "Cartesian", "axis": [east, north]}


def _projected(
    kind: str,
    name: str,
    base: dict[str, object],
    method: tuple[str, int],
    parameters: list[tuple[str, int, float, str]],
    units: MapUnits,
) -> CRS:
    """Return a CRS of PROJ's JSON ``kind`` that a method of EPSG, its name and code, derives from ``base``; parameters
    are name, code, value and unit."""
    rows = [
        {"name": parameter, "value": value, "unit": unit, "id": {"authority": "EPSG", "code": code}}
        for parameter, code, value, unit in parameters
    ]
    return CRS.from_json_dict(
        {
            "type": kind,
            "name": name,
            "base_crs": {key: value for key, value in base.items() if key != "$schema"},
            "conversion": {
                "name": "site calibration",
                "method": {"name": method[0], "id": {"authority": "EPSG", "code": method[1]}},
                "parameters": rows,
            },
            "coordinate_system": _axes(units),
        }
    )


def _oblique(name: str, base: str, middle_deg: FloatArray, plan: PlaneSimilarity, units: MapUnits) -> CRS:
    lon, lat = middle_deg.tolist()
    east, north = plan.origin_m.tolist()
    geographic = json.loads(geographic_crs(CRS.from_user_input(base)).to_json())
    parameters = [
        ("Latitude of projection centre", 8811, lat, "degree"),
        ("Longitude of projection centre", 8812, lon, "degree"),
        ("Azimuth at projection centre", 8813, 0.0, "degree"),
        ("Angle from Rectified to Skew Grid", 8814, float(-np.rad2deg(plan.rotation_rad)), "degree"),
        ("Scale factor at projection centre", 8815, plan.scale, "unity"),
        ("Easting at projection centre", 8816, east, "metre"),
        ("Northing at projection centre", 8817, north, "metre"),
    ]
    method = ("Hotine Oblique Mercator (variant B)", 9815)
    return _projected("ProjectedCRS", name, geographic, method, parameters, units)


def _in_metres(parameter: dict[str, object]) -> dict[str, object]:
    """Return a parameter of a projection with metres where it is a length: the base of a derived CRS states no axes,
    and PROJ takes the unit of its false origin for theirs."""
    unit = parameter.get("unit")
    if isinstance(unit, dict) and unit.get("type") == "LinearUnit":
        return parameter | {"value": float(str(parameter["value"])) * float(unit["conversion_factor"]), "unit": "metre"}
    return parameter


def _derived(name: str, given_map: str, plan: PlaneSimilarity, units: MapUnits) -> CRS:
    """Return a similarity of a map. Raises FrameError for axes in feet: PROJ 9.5 takes the constants of the affine
    transformation for metres and converts its result to no other unit."""
    if units.plan_m != 1.0:
        raise FrameError(
            f"local grid {name}: PROJ does not compute a grid in {units.plan} that derives from a given map: calibrate "
            "without a map, or give local coordinates in metres"
        )
    base = json.loads(metric_crs(given_map).to_json())
    base["conversion"]["parameters"] = [_in_metres(p) for p in base["conversion"]["parameters"]]
    c, s = float(plan.scale * np.cos(plan.rotation_rad)), float(plan.scale * np.sin(plan.rotation_rad))
    east, north = plan.origin_m.tolist()
    parameters = [
        ("A0", 8623, east, "metre"),
        ("A1", 8624, c, "unity"),
        ("A2", 8625, -s, "unity"),
        ("B0", 8639, north, "metre"),
        ("B1", 8640, s, "unity"),
        ("B2", 8641, c, "unity"),
    ]
    return _projected("DerivedProjectedCRS", name, base, ("Affine parametric transformation", 9624), parameters, units)


def _heights(name: str, height: HeightFit, units: MapUnits) -> str:
    lon, lat = height.middle_deg.tolist()
    north, east = height.slope_north / _ARC_SECOND, height.slope_east / _ARC_SECOND
    second = f'ANGLEUNIT["arc-second",{_ARC_SECOND}]'
    unit = _METRE if units.height_m == 1.0 else f'LENGTHUNIT["{units.height}",{units.height_m:.15g}]'
    return (
        f'VERTCRS["{name} height",BASEVERTCRS["Ellipsoid (metre)",VDATUM["Ellipsoid"]],'
        'DERIVINGCONVERSION["site calibration, heights",METHOD["Vertical Offset and Slope",ID["EPSG",1046]],'
        f'PARAMETER["Ordinate 1 of evaluation point",{lat:.15g},{_DEGREE},ID["EPSG",8617]],'
        f'PARAMETER["Ordinate 2 of evaluation point",{lon:.15g},{_DEGREE},ID["EPSG",8618]],'
        f'PARAMETER["Vertical Offset",{height.offset_m:.15g},{_METRE},ID["EPSG",8603]],'
        f'PARAMETER["Inclination in latitude",{north:.15g},{second},ID["EPSG",8730]],'
        f'PARAMETER["Inclination in longitude",{east:.15g},{second},ID["EPSG",8731]],'
        'PARAMETER["EPSG code for Horizontal CRS",4326,ID["EPSG",1037]]],'
        f'CS[vertical,1],AXIS["local height (H)",up,{unit}]]'
    )
