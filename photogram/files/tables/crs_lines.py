"""The CRS that a line of a file names: the first one of OpenDroneMap's lists, a remark of other programs' tables."""

import re

_UTM = re.compile(r"'?WGS ?84\s*/?\s*UTM\s*(?:zone\s*)?(\d{1,2})\s*([C-HJ-NP-X])'?", re.IGNORECASE)
"""A zone with N or S of its half of the globe, or with the letter of a latitude band; S is taken for south."""
_WGS84 = re.compile(r"'?WGS ?84'?", re.IGNORECASE)
_NAMED = re.compile(r"epsg:\d{4,6}(\+\d{4,6})?|'?\+proj=.+|(PROJ|GEOG|COMPD_|GEOD)(CS|CRS)?\[.+", re.IGNORECASE)
_GLUED = re.compile(r"(epsg:\d{4,5})(\d{5,8}[.,]\d+\s.+)", re.IGNORECASE)
_ROW = re.compile(r"EPSG:(\d+)\s*[,;]\s*", re.IGNORECASE)
_REMARK = re.compile(r"\s*[#%]\s*Coordinate ?System:\s*((?:PROJCS|GEOGCS|COMPD_CS)\[.+)", re.IGNORECASE)


def crs_of_line(text: str) -> str:
    """Return the CRS that a line is, as pyproj reads it; a text that is none as it stands."""
    utm = _UTM.fullmatch(text)
    if utm and 1 <= int(utm[1]) <= 60:
        north = utm[2].upper() >= "N" and utm[2].upper() != "S"
        return f"EPSG:{326 if north else 327}{int(utm[1]):02d}"
    if _WGS84.fullmatch(text):
        return "EPSG:4326"
    bare = text.strip("'\"")
    return bare.upper() if bare.lower().startswith("epsg:") else bare


def names_crs(text: str) -> bool:
    """Return whether a line is nothing but the name of a CRS."""
    return any(form.fullmatch(text.strip()) for form in (_UTM, _WGS84, _NAMED))


def glued_crs(text: str) -> str | None:
    """Return the CRS at the beginning of a line behind which the first row follows without a separator, else None."""
    match = _GLUED.fullmatch(text.strip())
    return None if match is None else match[1].upper()


def row_crs(text: str) -> str | None:
    """Return the CRS that a program has written before the fields of a row, None where there is none."""
    match = _ROW.match(text)
    return None if match is None else f"EPSG:{match[1]}"


def without_crs(text: str) -> str:
    """Return a row without the CRS before its fields."""
    return _ROW.sub("", text, count=1)


def crs_of_remarks(remarks: tuple[str, ...]) -> str | None:
    """Return the CRS as WKT that a remark above a table names, as Metashape writes it, None where none does."""
    return next((match[1].strip() for remark in remarks if (match := _REMARK.fullmatch(remark))), None)
