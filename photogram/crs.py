"""Coordinate reference systems by name: kinds, height systems, zones, and how products state them."""

from __future__ import annotations

import re

from pyproj import CRS, proj_version_str
from pyproj.exceptions import CRSError

from photogram.errors import FrameError
from photogram.height_systems import DeclaredHeights, HeightSystem, crs_name, full_crs, is_gnss_ellipsoid, vertical_crs

NO_CRS = "none"
"""What stands for the CRS of a survey in a Cartesian system of its own, which no map knows."""

_ZONE = re.compile(r"(.*\bzone )(\d+)(.*)")


def _any_crs(name: str) -> CRS:
    if name == NO_CRS:
        raise FrameError("crs: none: a local frame has no map grid: name the CRS of the site for what needs one")
    try:
        return CRS.from_user_input(name)
    except CRSError as fault:
        raise FrameError(f"crs: {name!r}: not a CRS known to PROJ (expected e.g. EPSG:25832)") from fault


def projected_crs(name: str) -> CRS:
    """Return the CRS called ``name`` (EPSG:25832, a PROJ string, WKT). Raises FrameError unless it is a map grid in
    metres."""
    crs = _any_crs(name)
    horizontal = crs.sub_crs_list[0] if crs.is_compound else crs
    if not horizontal.is_projected:
        raise FrameError(
            f"crs: {name!r} ({crs.name}) is not a projected CRS: choose a map grid in metres, for example the "
            "UTM zone of the site"
        )
    units = {axis.unit_name for axis in horizontal.axis_info}
    if units != {"metre"}:
        raise FrameError(f"crs: {name!r} ({crs.name}) is in {', '.join(sorted(units))}: choose a map grid in metres")
    return horizontal


def vertical_of(name: str) -> str | None:
    """Return the vertical CRS within the map ``name`` (EPSG:25832+5799), None where it has none.

    Raises FrameError as projected_crs, and where its heights are not in metres upwards.
    """
    if name == NO_CRS:
        return None
    projected_crs(name)
    found = height_system_of(name)[1]
    if found is not None:
        vertical_crs(found)
    return found


def height_system_of(name: str) -> tuple[HeightSystem | None, str | None]:
    """Return the system of the heights that a CRS of any kind names, None where it names none, and its vertical CRS
    where it is compound. Raises FrameError where PROJ does not know the CRS."""
    if name == NO_CRS:
        return None, None
    crs = _any_crs(name)
    if crs.is_compound:
        code = crs.sub_crs_list[1].to_epsg()
        return "orthometric", f"EPSG:{code}" if code is not None else str(crs.sub_crs_list[1].to_wkt())
    spatial = any(axis.direction == "up" for axis in crs.axis_info) and is_gnss_ellipsoid(crs)
    return ("ellipsoidal" if spatial else None), None


def plan_of(name: str) -> str:
    """Return the map ``name`` without a vertical part. Raises FrameError as projected_crs."""
    if name == NO_CRS:
        return name
    plan = projected_crs(name)
    return crs_name(plan) if CRS.from_user_input(name).is_compound else name


def neighbouring_zones(name: str) -> tuple[str, ...]:
    """Return the codes of up to three zones on each side of a map grid that is one of several zones, of one datum, the
    nearest first; none of a map without zones, or without a code. Raises FrameError as projected_crs."""
    if name == NO_CRS:
        return ()
    plan = projected_crs(name)
    code, zoned = plan.to_epsg(), _ZONE.fullmatch(plan.name)
    if code is None or zoned is None:
        return ()
    zones = []
    for step in (1, -1, 2, -2, 3, -3):
        try:
            other = _ZONE.fullmatch(projected_crs(f"EPSG:{code + step}").name)
        except FrameError:
            continue  # the codes beside the first and the last zone mean something else, or nothing
        if other is not None and (other[1], other[3]) == (zoned[1], zoned[3]):
            zones.append(f"EPSG:{code + step}")
    return tuple(zones)


def product_crs(crs: str, heights: DeclaredHeights) -> str:
    """Return the CRS of every product: ``crs``, with what the heights are counted from where that is declared."""
    if heights.output is None:
        return crs
    return crs_name(full_crs(projected_crs(crs), heights.output, heights.geoid))


def crs_in_words(crs: str, heights: DeclaredHeights) -> str:
    """Return the CRS of results for people: ``crs``, and what its heights are counted from where that is declared."""
    if heights.output is None:
        return crs
    above = "the ellipsoid" if heights.map_geoid is None else f"the geoid {heights.map_geoid.name}"
    return f"{crs}, heights above {above}"


def written_crs(name: str) -> CRS | None:
    """Return the CRS ``name`` as products carry it, with its vertical axis where it has one, None for a local frame.
    Raises FrameError unless it is a map grid in metres."""
    if name == NO_CRS:
        return None
    plan = projected_crs(name)
    crs = CRS.from_user_input(name)
    return crs if crs.is_compound else plan


def esri_wkt(name: str) -> str:
    """Return the plan of the map ``name`` as a ``.prj`` file holds it: WKT as ESRI writes it, or of the second edition
    where that has no word for it. Raises FrameError as projected_crs."""
    plan = _plan_of(projected_crs(name))
    try:
        return str(plan.to_wkt("WKT1_ESRI"))
    except CRSError:
        return str(plan.to_wkt())


def crs_title(crs: str) -> str:
    """Return what a CRS is called: `ETRS89 / UTM zone 32N` for EPSG:25832. Raises FrameError for an unknown one."""
    if crs == NO_CRS:
        return "local frame"
    return str(projected_crs(crs).name)


def proj_version() -> str:
    """Return the version of PROJ."""
    return str(proj_version_str)


def _plan_of(crs: CRS) -> CRS:
    return (crs.sub_crs_list[0] if crs.is_compound else crs).to_2d()
