"""What measured positions, attitudes, control points and their marks say of each other before anything is adjusted."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import Camera, unproject
from photogram.constraints.between_points import gives_scale
from photogram.errors import FrameError, ImageError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import geodetic_from_map
from photogram.gnss import UNKNOWN_M
from photogram.measures.collinearity import collinear
from photogram.project.cross_checks import AreaOfUse
from photogram.project.draft.sites import gap_between_sites_m, group_sites, utm_crs
from photogram.project.findings import Finding
from photogram.project.measured.measured_survey import (
    MeasuredSurvey,
    control_positions,
    foreign_positions,
    frozen_photographs,
    gnss_positions,
    stated_positions,
    usable_survey,
)
from photogram.project.misplaced import other_reading
from photogram.project.project import Project
from photogram.project.validation.control_positions import control_position_findings
from photogram.project.validation.foreign_control import foreign_control
from photogram.wording import some, things

FAR_FOOTPRINTS = 3.0
"""A position farther than this many footprints from all others has nothing in common with them."""

NEAR_M = 100.0
"""Control and photographs closer than this are never said to be far from each other."""

FOREIGN_M = 1000.0
"""If no control point is nearer to a photograph, they belong to different surveys or different CRS."""

NO_BASE, NO_BASE_M = 0.02, 0.5
"""Photographs that lie within this share of the flying height, or this distance, have no base."""

SMALL_ANGLE_DEG = 20.0
"""Gimbals and compasses err by so much, before their stated sigma is added."""

LEAST_ANGLE_DEG, TIMES_TYPICAL = 5.0, 4.0
FEWEST_JUDGED = 12
"""They err by less where most marks show it: by so many times the median of so many marks, but never by less than
this."""

MOST_MARKS = 0.7
"""Of the marks in a photograph, from which its position or attitude is wrong and not they."""

HEIGHT_CONTRADICTION_M, HEIGHT_CONTRADICTION = 20.0, 0.3
LOOKS_DOWN = 0.5
"""Sine of the angle below the horizon from which on an optical axis looks down at what it shows: 30°."""
_SURE_HEIGHT_M = 1.0


# ---- positions -----------------------------------------------------------------------------------------------------


def area_findings(project: Project, gnss_map_m: FloatArray) -> list[Finding]:
    """Return whether the photographs lie where the project's CRS is used."""
    area = AreaOfUse.of(project.crs)
    known = np.flatnonzero(np.isfinite(gnss_map_m).all(axis=1))
    foreign = np.flatnonzero(foreign_positions(project, gnss_map_m))
    if not len(foreign):
        return []
    easting, northing, _ = gnss_map_m[foreign[0]]
    text = f"{len(foreign)} of {len(known)} GNSS positions are outside {area}: found {easting:.0f}, {northing:.0f}"
    if len(foreign) == len(known):
        reading = other_reading(project.crs, gnss_map_m[known], control_positions(project))
        if reading is None:
            longitude, latitude, _ = np.median(geodetic_from_map(project.crs, gnss_map_m[known]), axis=0)
            return [
                Finding("error", "crs", text, f"give the CRS of the site, {utm_crs(longitude, latitude)} for example")
            ]
        text += f"; {reading[0]} they would lie among the control points"
        return [Finding("error", "GNSS positions", text, reading[1])]
    names = some([project.photographs[i].name for i in foreign])
    return [Finding("error", names, text, "remove these photographs, or correct their positions")]


def _for_example(crs: str, gnss_map_m: FloatArray) -> str:
    """Return in words the UTM zone of positions (N, 3) of the map ``crs``, nothing where they have none."""
    try:
        longitude, latitude, _ = np.median(geodetic_from_map(crs, gnss_map_m), axis=0).tolist()
        return f", {utm_crs(longitude, latitude)} for example"
    except FrameError:
        return ""  # beyond where UTM ends, or no place on Earth


def base_findings(survey: MeasuredSurvey) -> list[Finding]:
    """Return whether all photographs were taken from one place: rays from there intersect nowhere."""
    place, height_m = survey.gnss_world_m[survey.positioned], survey.flying_height_m[survey.positioned]
    if len(place) < 2:
        return []
    reach_m = 2.0 * float(np.linalg.norm(place - np.median(place, axis=0), axis=1).max())
    known_m = height_m[np.isfinite(height_m)]
    if reach_m == 0.0 or reach_m > max(NO_BASE * float(np.median(known_m)) if len(known_m) else 0.0, NO_BASE_M):
        return []
    text = f"all {len(place)} GNSS positions lie within {reach_m:.1f} m: rays from one place do not intersect"
    remedy = "a panorama gives no depth: move between exposures by at least a tenth of the object distance"
    return [Finding("warning", "photographs", text, remedy)]


def site_findings(project: Project, survey: MeasuredSurvey) -> list[Finding]:
    """Return the photographs that are too far from the others to show anything of what they show."""
    known = np.flatnonzero(survey.positioned)
    if len(known) < 2:
        return []
    plan = survey.gnss_world_m[known, :2]
    nearest_m = np.asarray(cKDTree(plan).query(plan, k=2)[0])[:, 1]
    footprint = survey.footprint_m[known]
    footprint_m = float(np.nanmedian(footprint)) if np.isfinite(footprint).any() else np.nan
    gap_m = FAR_FOOTPRINTS * footprint_m if footprint_m > 0 else gap_between_sites_m(plan)
    site = group_sites(plan, gap_m)
    names = np.array([project.photographs[i].name for i in known])
    if np.count_nonzero(site == 0) * 2 < len(known):
        text = (
            f"the photographs lie {np.median(nearest_m):.0f} m apart, {things(int(site.max()) + 1, 'group')} with more "
            f"than {gap_m:.0f} m between them"
        )
        remedy = "give photographs of one site that overlap, or each site a project of its own"
        return [Finding("warning", "photographs", text, remedy)]
    findings = []
    home = cKDTree(plan[site == 0])
    for number in range(1, int(site.max()) + 1):
        own = site == number
        distance_m = float(np.min(home.query(plan[own])[0]))
        findings.append(
            Finding(
                "warning",
                some(list(names[own])),
                f"{things(int(own.sum()), 'photograph')} {distance_m:.0f} m from the nearest of the others, "
                "too far to overlap",
                "remove what belongs to another site, or correct the position",
            )
        )
    return findings


def _distance_to_photographs(survey: MeasuredSurvey) -> tuple[FloatArray, FloatArray]:
    """Return of each ground point (P,) how far it is from the nearest photograph in plan, and that one's footprint,
    zero where it is not known. Some photograph must have a position."""
    known = survey.positioned
    distance_m, nearest = cKDTree(survey.gnss_world_m[known, :2]).query(survey.control.position_world_m[:, :2])
    return np.asarray(distance_m), np.nan_to_num(survey.footprint_m[known], nan=0.0)[nearest]


def control_distance_findings(project: Project, survey: MeasuredSurvey) -> list[Finding]:
    """Return the ground points that lie far from every photograph, in plan, and what would put them among them."""
    known, points = survey.positioned, survey.control
    if not known.any() or not len(points):
        return []
    distance_m, footprint_m = _distance_to_photographs(survey)
    limit_m = np.maximum(FAR_FOOTPRINTS * footprint_m, NEAR_M)
    far = distance_m > np.maximum(FOREIGN_M, limit_m)
    foreign = [p for p, is_far in zip(project.control_points, far.tolist(), strict=True) if is_far]
    finding = foreign_control(project, foreign, survey.gnss_map_m[known]) if foreign else None
    if finding is not None:
        return [finding]
    return [
        Finding(
            "warning",
            f"point {points.name[i]}",
            f"{distance_m[i]:.0f} m from the nearest photograph, whose footprint is about {footprint_m[i]:.0f} m wide",
            "check its coordinates",
        )
        for i in np.flatnonzero(distance_m > limit_m)
    ]


def frozen_findings(
    project: Project, tags: Sequence[PhotographTags | None], survey: MeasuredSurvey | None
) -> list[Finding]:
    """Return the photographs whose positions repeat each other; an error where too little else places the block."""
    frozen = np.flatnonzero(frozen_photographs(tags, stated_positions(project, tags)))
    if not len(frozen):
        return []
    placed = survey is not None and max(survey.positioned.sum(), _placing(survey).sum()) >= 3
    text = f"{len(frozen)} photographs have the GNSS position of another time, which is not used"
    remedy = (
        "the receiver had stopped updating, or is slower than the camera: give the positions of the flight under "
        "photographs.positions, or control points"
    )
    names = some([project.photographs[i].name for i in frozen])
    return [Finding("warning" if placed else "error", names, text, remedy)]


# ---- number and arrangement of control -----------------------------------------------------------------------------


def _placing(survey: MeasuredSurvey) -> BoolArray:
    """Return which points (P,) place the block: control in all axes, with a mark, and not far from all photographs."""
    points = survey.control
    marks = np.bincount(points.mark_point, minlength=len(points))
    placing = points.controlled.all(axis=1) & (marks > 0)  # one axis alone gives no starting values
    if not len(points) or not survey.positioned.any():
        return placing
    distance_m, footprint_m = _distance_to_photographs(survey)
    near = distance_m <= np.maximum(FAR_FOOTPRINTS * footprint_m, NEAR_M)
    return placing & near if near.any() else placing


def arrangement_findings(survey: MeasuredSurvey) -> list[Finding]:
    """Return whether control points and GNSS positions together can hold the block."""
    points, positions = survey.control, int(survey.positioned.sum())
    control = _placing(survey)
    count = int(control.sum())
    remedy = "mark at least three control points that are not collinear, or give photographs with GNSS tags"
    if positions < 3 and count < 3:
        text = (
            f"{things(count, 'control point')} with marks and {things(positions, 'GNSS position')}: the datum is "
            "not defined"
        )
        return [Finding("error", "the block", text, remedy)]
    findings = []
    in_line = count >= 3 and collinear(points.position_world_m[control])
    gnss_in_line = positions >= 3 and collinear(survey.gnss_world_m[survey.positioned])
    if in_line and positions < 3:
        text = "are collinear: rotation of the block about their line is not determined"
        findings.append(Finding("error", "control points", text, remedy))
    elif in_line:
        text = "are collinear: rotation about their line is determined by GNSS alone"
        findings.append(Finding("warning", "control points", text, "add a control point off the line"))
    if gnss_in_line and (count < 3 or in_line) and not np.isfinite(survey.rotation).any():
        text = "are collinear and there are no attitudes: rotation about the strip is not determined"
        findings.append(
            Finding("warning", "GNSS positions", text, "add control points off the line, or a second strip")
        )
    return findings


def mark_findings(survey: MeasuredSurvey) -> list[Finding]:
    """Return the ground points that have too few marks for what they are to do, and whether any can be a check."""
    points = survey.control
    marks = np.bincount(points.mark_point, minlength=len(points))
    check = np.array([r == "check" for r in points.role], dtype=bool)
    names = np.array(points.name, dtype=object)
    findings = []
    for mask, number, text, remedy in (
        (
            ~check,
            0,
            "without any mark: they are not used",
            "mark them in three photographs or more, with photogram mark",
        ),
        (~check, 1, "with a single mark, which nothing checks", "mark each in three photographs or more"),
        (check, 0, "without any mark: they test nothing", "mark them in two photographs or more, with photogram mark"),
        (check, 1, "with a single mark: they test nothing", "mark them in two photographs or more"),
    ):
        few = list(names[mask & (marks == number)])
        kind = "check point" if mask is check else "control point"
        if few:
            findings.append(Finding("warning", some(few), f"{things(len(few), kind)} {text}", remedy))
    if not np.any(check & (marks >= 2)):
        text = "none with two marks or more: accuracy will be predicted, not tested"
        findings.append(Finding("warning", "check points", text, "give some surveyed points the role check"))
    return findings


# ---- heights -------------------------------------------------------------------------------------------------------


def height_findings(project: Project, survey: MeasuredSurvey, *, declared: bool) -> list[Finding]:
    """Return where the heights of control points and GNSS positions contradict each other or the flying height; an
    error only where they are ``declared`` to be of one system."""
    points = survey.control
    photograph = points.mark_photograph
    known = survey.positioned[photograph] & (np.nan_to_num(survey.gnss_sigma_m[photograph, 2]) < UNKNOWN_M)
    if not known.any():
        return []
    photograph, point = photograph[known], points.mark_point[known]
    ground_m = np.array([p.position_map_m[2] for p in project.control_points])[point]
    drop_m = survey.gnss_map_m[photograph, 2] - ground_m
    sigma_m = np.hypot(np.nan_to_num(survey.gnss_sigma_m[photograph, 2]), project.gnss_offset_sigma_m[2])
    axis_up = survey.rotation[photograph, 2, 2]
    looks_down = axis_up < -LOOKS_DOWN
    above = (drop_m < 0) & ~(axis_up >= -LOOKS_DOWN)  # who looks sideways sees what is above
    holds = points.controlled[point, 2]  # a check point spoils its own test and nothing else
    sure = declared & above & (drop_m < -3.0 * sigma_m) & looks_down & (sigma_m < _SURE_HEIGHT_M) & holds
    if above.any():
        names = list(dict.fromkeys(points.name[i] for i in point[above]))
        worst = int(np.argmin(drop_m))
        camera = project.photographs[photograph[worst]].name
        text = f"{points.name[point[worst]]} is {-drop_m[worst]:.1f} m above {camera}, which shows it"
        remedy = (
            "declare the height systems under heights; without RTK, heights are off by tens of metres: give "
            "gnss.offset_sigma_m a height component such as 50"
        )
        where = f"{'points' if len(names) > 1 else 'point'} {some(names)}"
        return [Finding("error" if sure.any() else "warning", where, text, remedy)]
    difference_m = drop_m - survey.flying_height_m[photograph]
    limit_m = np.maximum(HEIGHT_CONTRADICTION_M, HEIGHT_CONTRADICTION * survey.flying_height_m[photograph])
    middle_m = float(np.nanmedian(difference_m)) if np.isfinite(difference_m).any() else 0.0
    if abs(middle_m) > max(float(np.nanmax(limit_m)), 3.0 * float(sigma_m.max())):
        text = (
            f"GNSS positions are {np.median(drop_m):.0f} m above the control points, but the photographs were taken "
            f"{np.nanmedian(survey.flying_height_m[photograph]):.0f} m above ground or take-off"
        )
        remedy = (
            "declare the height systems under heights; without RTK give gnss.offset_sigma_m a height component "
            "such as 50"
        )
        return [Finding("warning", "heights", text, remedy)]
    return []


# ---- marks against positions and attitudes -------------------------------------------------------------------------


def _deviations_deg(project: Project, survey: MeasuredSurvey) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return of each mark (M,) the angle between its ray and the way to its point, how far the point is outside the
    picture, and the accepted limit; NaN where it cannot be known. Raises ImageError as unproject does."""
    points = survey.control
    count = len(points.mark_photograph)
    angle, outside, limit = (np.full(count, np.nan) for _ in range(3))
    known = survey.positioned & np.isfinite(survey.rotation).all(axis=(1, 2))
    for i in np.unique(points.mark_photograph):
        if not known[i]:
            continue
        camera, R = project.cameras[project.photographs[i].camera], survey.rotation[i]
        own = np.flatnonzero(points.mark_photograph == i)
        way = points.position_world_m[points.mark_point[own]] - survey.gnss_world_m[i]
        if np.isfinite(survey.flying_height_m[i]) and R[2, 2] < -LOOKS_DOWN:
            # The flying height does not suffer from two height systems; what is seen sideways is not at its end.
            way[:, 2] = -survey.flying_height_m[i]
        distance = np.linalg.norm(way, axis=1)
        way /= np.maximum(distance, 1e-9)[:, None]
        ray = unproject(camera, points.mark_pixel[own]) @ R.T
        angle[own] = np.rad2deg(np.arccos(np.clip(np.sum(ray * way, axis=1), -1.0, 1.0)))
        outside[own] = np.rad2deg(np.arccos(np.clip(way @ R[:, 2], -1.0, 1.0))) - _half_view_deg(camera)
        sigma_m = float(np.nan_to_num(np.hypot(*survey.gnss_sigma_m[i, :2])))
        limit[own] = 3.0 * project.photographs[i].attitude_sigma_deg + np.rad2deg(np.arctan2(3.0 * sigma_m, distance))
    judged = angle[np.isfinite(angle)]
    typical = float(np.median(judged)) if len(judged) >= FEWEST_JUDGED else SMALL_ANGLE_DEG
    return angle, outside, limit + float(np.clip(TIMES_TYPICAL * typical, LEAST_ANGLE_DEG, SMALL_ANGLE_DEG))


def _half_view_deg(camera: Camera) -> float:
    reach = 0.5 * float(np.hypot(camera.width_px, camera.height_px)) / camera.focal_px
    return float(np.rad2deg(np.arctan(reach) if camera.model == "brown" else min(reach, np.pi / 2)))


def view_findings(project: Project, survey: MeasuredSurvey) -> list[Finding]:
    """Return the marks that point elsewhere than positions and attitudes say, by far more than others do."""
    points = survey.control
    try:
        angle, outside, limit = _deviations_deg(project, survey)
    except ImageError as error:
        return [Finding("error", "cameras", str(error))]
    judged = np.isfinite(angle)
    wrong = np.zeros(len(angle), dtype=bool)
    wrong[judged] = angle[judged] > limit[judged]
    several = min(len(np.unique(points.mark_point[wrong])), len(np.unique(points.mark_photograph[wrong]))) >= 3
    if wrong.sum() >= 4 and wrong.sum() * (3 if several else 2) > judged.sum():
        text = (
            f"{int(wrong.sum())} of {int(judged.sum())} disagree with GNSS positions and attitudes by "
            f"{np.median(angle[wrong]):.0f}° (median)"
        )
        remedy = "check attitudes, the pixel size of the marks, and that points and photographs are from the same site"
        return [Finding("warning", "marks", text, remedy)]
    findings = []
    for p in np.unique(points.mark_point[wrong]):
        own = judged & (points.mark_point == p)
        if own.sum() >= 2 and wrong[own].all():
            text = f"all its {int(own.sum())} marks disagree with its position, by {np.median(angle[own]):.0f}°"
            findings.append(Finding("warning", f"point {points.name[p]}", text, "check its position and its name"))
            wrong[own] = False
    for i in np.unique(points.mark_photograph[wrong]):
        own = judged & (points.mark_photograph == i)
        name = project.photographs[i].name
        bad = own & wrong
        if bad.sum() >= 2 and bad.sum() >= MOST_MARKS * own.sum():
            count = f"all its {own.sum()}" if bad.sum() == own.sum() else f"{bad.sum()} of its {own.sum()}"
            text = f"{count} marks disagree with their points, by {np.median(angle[bad]):.0f}°"
            findings.append(Finding("warning", name, text, "check its position, its attitude and its marks"))
            continue
        for m in np.flatnonzero(own & wrong):
            text = f"its mark disagrees with its position, by {angle[m]:.0f}°"
            if outside[m] > limit[m]:
                text = f"cannot be in the photograph: it lies {outside[m]:.0f}° outside, by GNSS position and attitude"
            where = f"point {points.name[points.mark_point[m]]} in {name}"
            findings.append(Finding("warning", where, text, "check the mark, or the photograph"))
    return findings


def geometry_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return everything that this module finds."""
    project = project.surveyed
    if (
        project.crs == NO_CRS
        and not project.control_points
        and not any(p.gnss_map_m is not None or p.file_position is not None for p in project.photographs)
    ):
        scale = "known by its distances" if gives_scale(project.constraints) else "open, since no distances are given"
        return [Finding("note", "the block", f"a free network in a local frame; its scale is {scale}")]
    try:
        findings = area_findings(project, gnss_positions(project, tags))
        survey = usable_survey(project, tags)
    except FrameError as error:
        return [Finding("error", "crs", str(error).removeprefix("crs: "))]
    if survey is None:
        if findings:
            return findings
        text = "neither control points nor GNSS positions: the survey cannot be georeferenced"
        remedy = "give control_points, or photographs with GNSS tags"
        return [*frozen_findings(project, tags, None), Finding("error", "the block", text, remedy)]
    impossible = control_position_findings(project, survey)
    findings += impossible
    if any(finding.severity == "error" for finding in impossible):
        return findings  # what they say of heights and directions means nothing
    distance = control_distance_findings(project, survey)
    findings += [
        *frozen_findings(project, tags, survey),
        *base_findings(survey),
        *site_findings(project, survey),
        *distance,
        *arrangement_findings(survey),
        *mark_findings(survey),
    ]
    if any(finding.severity == "error" for finding in distance):
        return findings  # heights and directions to points of another place mean nothing
    ellipsoidal = [None if t is None else t.height_is_ellipsoidal for t in tags]
    declared = project.heights_are_declared(ellipsoidal, survey.positioned.tolist())
    return [*findings, *height_findings(project, survey, declared=declared), *view_findings(project, survey)]
