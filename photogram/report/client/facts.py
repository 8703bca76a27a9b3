"""What was surveyed, when, by whom and with what, in the client's words."""

from dataclasses import dataclass
from datetime import date
from statistics import median

from photogram.languages.language import ENGLISH, Language
from photogram.report.numbers.overall import length
from photogram.report.numbers.traffic_lights import number
from photogram.report.numbers.wording import fixed, whole
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


def survey_facts(report: Report, scaled: bool, language: Language = ENGLISH) -> list[Fact]:
    """Return the facts of a survey in a language; those with lengths only where it is ``scaled``."""
    survey, block, say = report["survey"], report["block"], language.gettext
    used = say(
        "{photographs}, of which {used} were used",
        photographs=whole(block["photographs"]),
        used=whole(block["registered"]),
    )
    facts = [
        Fact(say("Surveyed for"), survey["client"] or "", "survey.client"),
        Fact(say("Surveyed by"), survey["author"] or "", "survey.author"),
        Fact(say("Ground points surveyed by"), survey.get("surveyor") or "", "survey.surveyor"),
        Fact(say("Ground points surveyed with"), survey.get("instrument") or "", "survey.instrument"),
        Fact(say("Ground points marked by"), survey.get("targets") or "", "survey.targets"),
        Fact(
            say("Date of the photographs"),
            _dates(survey["flown_first"], survey["flown_last"], language),
            "survey.flown_first",
        ),
        Fact(say("Photographs"), used, "block"),
        Fact(language.ngettext("Camera", "Cameras", len(report["cameras"])), ", ".join(report["cameras"]), "cameras"),
    ]
    if scaled:
        facts.append(_distance(report, language))
        gsd = say("{length}: what one pixel covers on the ground", length=length(block["gsd_m"], language))
        facts.append(Fact(say("Ground sampling distance (GSD)"), gsd if block["gsd_m"] else "", "block.gsd_m"))
        facts += _areas(report, language)
        facts.append(Fact(say("Map grid"), _map_grid(report), "crs"))
        facts.append(Fact(say("Heights"), _heights(report, language), "heights"))
    facts.append(Fact(say("Placed by"), _placed_by(report, language), "gnss"))
    return [fact for fact in facts if fact.text]


def _distance(report: Report, language: Language) -> Fact:
    """Return how far the cameras were from what they show: a height where they look down."""
    registered, cameras = oriented(report["photographs"]), report["cameras"]
    seen = [p for p in registered.values() if p["gsd_m"] is not None]
    distances_m = [number(p["gsd_m"]) * cameras[p["camera"]]["focal_px"] for p in seen]
    down = median([-p["rotation_camera_from_map"][2][2] for p in registered.values()] or [0.0]) > LOOKING_DOWN
    title = language.gettext("Height above ground") if down else language.gettext("Distance to the object")
    return Fact(title, f"{fixed(median(distances_m), 0)} m" if distances_m else "", "photographs")


def written_date(day: str, language: Language = ENGLISH) -> str:
    """Write a date of report.json, year-month-day, as one reads it."""
    return language.date(date.fromisoformat(day))


def _dates(first: str | None, last: str | None, language: Language) -> str:
    if first is None:
        return language.gettext("not recorded in the photographs")
    if last in (first, None):
        return written_date(first, language)
    return language.gettext(
        "{first} to {last}", first=written_date(first, language), last=written_date(str(last), language)
    )


def _area(area_m2: float, language: Language) -> str:
    hectares = f" ({language.figure(fixed(area_m2 / _HECTARE_M2, 1))} ha)" if area_m2 >= _HECTARE_M2 else ""
    return f"{whole(area_m2)} m²{hectares}"


def _areas(report: Report, language: Language) -> list[Fact]:
    """Return the ground that is seen twice, and the part of it that has heights."""
    overlap, dense = report["block"]["overlap"], report.get("dense")
    facts = []
    if overlap:
        seen = language.gettext("{area}, seen in two photographs or more", area=_area(overlap["area_m2"], language))
        facts.append(Fact(language.gettext("Area photographed"), seen, "block.overlap.area_m2"))
    if dense is not None:
        measured = _area(dense["areas"]["measured_m2"], language)
        facts.append(Fact(language.gettext("Area with measured heights"), measured, "dense.areas.measured_m2"))
    return facts


def _map_grid(report: Report) -> str:
    name, crs = report["survey"]["crs_name"], report["crs"]
    return f"{name} ({crs})" if name and name != crs and len(crs) < 60 else name or crs


def _heights(report: Report, language: Language) -> str:
    heights = report["heights"]
    if not heights["output"]:
        return language.gettext("as in the data that were given; the project does not name their reference")
    if heights["output"] == "ellipsoidal":
        reference = language.gettext("above the ellipsoid")
    else:
        reference = language.gettext("above sea level (orthometric)")
    if not heights["geoid"]:
        return reference
    return language.gettext("{reference}, by the geoid model {geoid}", reference=reference, geoid=heights["geoid"])


def _placed_by(report: Report, language: Language) -> str:
    """Return in words what ties the survey to the map: control points, and positions of the camera."""
    roles = [p["axis_roles"] for p in report["control_points"]]
    control = sum("control" in axes for axes in roles)
    check = sum("check" in axes and "control" not in axes for axes in roles)
    cameras = report["gnss"]["positions_used"]
    parts = []
    if control:
        parts.append(
            language.ngettext(
                "{n} control point, surveyed on the ground", "{n} control points, surveyed on the ground", control
            )
        )
    if cameras:
        parts.append(
            language.ngettext(
                "{n} position of the camera, measured by satellite (GNSS)",
                "{n} positions of the camera, measured by satellite (GNSS)",
                cameras,
            )
        )
    if not parts:
        return ""
    tested = language.ngettext(
        "{n} check point kept out to test the result", "{n} check points kept out to test the result", check
    )
    return language.clauses([language.listed(parts), *([tested] if check else [])])
