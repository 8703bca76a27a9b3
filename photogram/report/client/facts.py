"""What was surveyed, when, by whom and with what, in the client's words."""

from dataclasses import dataclass
from datetime import date
from statistics import median

from photogram.report.numbers.overall import length
from photogram.report.numbers.traffic_lights import number
from photogram.report.numbers.wording import fixed, plain, whole
from photogram.report.record.report import Report, oriented

LOOKING_DOWN = 0.94
"""Of the downward part of optical axes, from which (20° off the vertical) their distance to the ground is a height."""
_HECTARE_M2 = 10_000.0


@dataclass(frozen=True)
class Fact:
    """Something that the client's part says: what it is, in words, and the key of report.json that it comes from."""

    title: str
    text: str
    key: str


def survey_facts(report: Report, scaled: bool) -> list[Fact]:
    """Return the facts of a survey; those with lengths only where it is ``scaled``."""
    survey, block = report["survey"], report["block"]
    registered = oriented(report["photographs"])
    facts = [
        Fact("Surveyed for", survey["client"] or "", "survey.client"),
        Fact("Surveyed by", survey["author"] or "", "survey.author"),
        Fact("Ground points surveyed by", survey.get("surveyor") or "", "survey.surveyor"),
        Fact("Ground points surveyed with", survey.get("instrument") or "", "survey.instrument"),
        Fact("Ground points marked by", survey.get("targets") or "", "survey.targets"),
        Fact("Date of the photographs", _dates(survey["flown_first"], survey["flown_last"]), "survey.flown_first"),
        Fact("Photographs", f"{whole(block['photographs'])}, of which {whole(block['registered'])} were used", "block"),
        Fact("Camera" if len(report["cameras"]) == 1 else "Cameras", ", ".join(report["cameras"]), "cameras"),
    ]
    if scaled:
        cameras, seen = report["cameras"], [p for p in registered.values() if p["gsd_m"] is not None]
        distances_m = [number(p["gsd_m"]) * cameras[p["camera"]]["focal_px"] for p in seen]
        down = median([-p["rotation_camera_from_map"][2][2] for p in registered.values()] or [0.0]) > LOOKING_DOWN
        title = "Height above ground" if down else "Distance to the object"
        facts.append(Fact(title, f"{fixed(median(distances_m), 0)} m" if distances_m else "", "photographs"))
        gsd = f"{length(block['gsd_m'])}: what one pixel covers on the ground" if block["gsd_m"] else ""
        facts.append(Fact("Ground sampling distance (GSD)", gsd, "block.gsd_m"))
        facts += _areas(report)
        facts.append(Fact("Map grid", _map_grid(report), "crs"))
        facts.append(Fact("Heights", _heights(report), "heights"))
    facts.append(Fact("Placed by", _placed_by(report), "gnss"))
    return [fact for fact in facts if fact.text]


def written_date(day: str) -> str:
    """Write a date of report.json, year-month-day, as one reads it."""
    moment = date.fromisoformat(day)
    return f"{moment.day} {moment:%B} {moment.year}"


def _dates(first: str | None, last: str | None) -> str:
    if first is None:
        return "not recorded in the photographs"
    return written_date(first) if last in (first, None) else f"{written_date(first)} to {written_date(str(last))}"


def _area(area_m2: float) -> str:
    hectares = f" ({fixed(area_m2 / _HECTARE_M2, 1)} ha)" if area_m2 >= _HECTARE_M2 else ""
    return f"{whole(area_m2)} m²{hectares}"


def _areas(report: Report) -> list[Fact]:
    """Return the ground that is seen twice, and the part of it that has heights."""
    overlap, dense = report["block"]["overlap"], report.get("dense")
    facts = []
    if overlap:
        seen = f"{_area(overlap['area_m2'])}, seen in two photographs or more"
        facts.append(Fact("Area photographed", seen, "block.overlap.area_m2"))
    if dense is not None:
        measured = _area(dense["areas"]["measured_m2"])
        facts.append(Fact("Area with measured heights", measured, "dense.areas.measured_m2"))
    return facts


def _map_grid(report: Report) -> str:
    name, crs = report["survey"]["crs_name"], report["crs"]
    return f"{name} ({crs})" if name and name != crs and len(crs) < 60 else name or crs


def _heights(report: Report) -> str:
    heights = report["heights"]
    if not heights["output"]:
        return "as in the data that were given; the project does not name their reference"
    kinds = {"ellipsoidal": "above the ellipsoid", "orthometric": "above sea level (orthometric)"}
    geoid = f", by the geoid model {heights['geoid']}" if heights["geoid"] else ""
    return kinds.get(heights["output"], plain(heights["output"])) + geoid


def _placed_by(report: Report) -> str:
    """Return in words what ties the survey to the map: control points, and positions of the camera."""
    roles = [p["axis_roles"] for p in report["control_points"]]
    control = sum("control" in axes for axes in roles)
    check = sum("check" in axes and "control" not in axes for axes in roles)
    cameras = report["gnss"]["positions_used"]
    parts = []
    if control:
        parts.append(f"{control} control point{'s' if control > 1 else ''}, surveyed on the ground")
    if cameras:
        parts.append(f"{cameras} position{'s' if cameras > 1 else ''} of the camera, measured by satellite (GNSS)")
    tested = f"; {check} check point{'s' if check > 1 else ''} kept out to test the result" if check else ""
    return " and ".join(parts) + tested if parts else ""
