"""Whether the heights of a survey are declared, and whether what is declared can be true.

Pure functions on the project, the photographs' tags and the marks; `photogram check` shows what they find, and
`photogram adjust` stops where heights contradict each other by a geoid height, before hours of work.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from photogram.arrays import FloatArray
from photogram.errors import FrameError, ImageError, ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.height_systems import Geoid, HeightSystem
from photogram.project.findings import Finding, Severity
from photogram.project.measured.measured_block import PhotographNote, measured_arrays
from photogram.project.measured.measured_survey import MeasuredSurvey, usable_survey
from photogram.project.project import Project
from photogram.project.validation.control_positions import control_position_findings
from photogram.project.validation.height_shift import HeightEvidence, HeightShift, height_shift
from photogram.project.validation.image_scale import ScaleFit, fit_scales
from photogram.survey import Block, Role
from photogram.wording import some

SURE_SIGMA_M = 1.0
"""GNSS heights that are worse, of a single receiver or a barometer, prove nothing: they err by tens of metres."""

LEAST_M, SIGMAS = 5.0, 4.0
"""A contradiction below these is no matter of height systems: geoid heights are tens of metres on most of the Earth,
and do not depend on the flight. What is smaller is an offset, judged by its own sigma."""

_NEAR_GEOID_M = 3.0
_TIE_COST, _TIE_SHARE = 3.0, 0.02
_OPEN_SHIFTS_M = np.arange(-60.0, 61.0, 10.0)
_Who = Literal["control", "GNSS"]
_ROLES: tuple[Role, ...] = ("control", "check")


# ---- what there is to compare --------------------------------------------------------------------------------------


def _evidence_of_survey(project: Project, survey: MeasuredSurvey, role: Role) -> HeightEvidence:
    return HeightEvidence(
        project.cameras,
        np.array([p.camera for p in project.photographs], dtype=np.int64),
        survey.gnss_world_m,
        survey.gnss_sigma_m,
        survey.rotation,
        np.deg2rad([p.attitude_sigma_deg for p in project.photographs]),
        survey.control.with_role(role),
    )


def _evidence_of_block(block: Block, role: Role) -> HeightEvidence:
    return HeightEvidence(
        block.cameras,
        block.camera_of,
        *measured_arrays(block.photographs),
        np.array([np.nan if p.attitude_sigma_rad is None else p.attitude_sigma_rad for p in block.photographs]),
        block.control_points.with_role(role),
    )


def _sure(evidence: HeightEvidence) -> HeightEvidence:
    """Return the evidence without the photographs whose GNSS heights prove nothing."""
    with np.errstate(invalid="ignore"):
        poor = ~(evidence.gnss_sigma_m[:, 2] < SURE_SIGMA_M)
    return replace(evidence, gnss_world_m=np.where(poor[:, None], np.nan, evidence.gnss_world_m))


def _shift(project: Project, evidence: HeightEvidence) -> HeightShift | None:
    """Return the contradiction of the heights, the offset between GNSS and control counted in its sigma."""
    sure = _sure(evidence)
    known = np.isfinite(sure.gnss_world_m).all(axis=1)
    if not known.any() or not len(sure.points.mark_photograph):
        return None
    try:
        shift = height_shift(sure)
    except ImageError:
        return None  # a lens that cannot be undone at a mark: the marks' own check says so
    if shift is None:
        return None
    spread_m = float(np.hypot(project.gnss_offset_sigma_m[2], np.median(sure.gnss_sigma_m[known, 2])))
    return replace(shift, sigma_m=float(np.hypot(shift.sigma_m, spread_m)))


def _limit_m(shift: HeightShift) -> float:
    return max(LEAST_M, SIGMAS * shift.sigma_m)


# ---- contradictions ------------------------------------------------------------------------------------------------


def site_geoid_height_m(project: Project, place_map_m: FloatArray) -> float | None:
    """Return the height of the project's geoid above the ellipsoid at a position (3,), else of EGM96; None where
    PROJ has no grid of either."""
    for geoid in dict.fromkeys((project.heights.geoid, Geoid("EPSG:5773"))):
        try:
            if geoid is not None:
                frame = LocalFrame(project.crs, (0.0, 0.0, 0.0), "grid", geoid)
                return float(frame.geoid_height_m(place_map_m[None])[0])
        except FrameError:
            continue
    return None


def _suspects(
    control: HeightSystem | None, gnss: HeightSystem | None, gnss_is_proved: bool
) -> list[tuple[_Who, HeightSystem | None, HeightSystem, int]]:
    """Return who may be of another system than declared: who, declared as, looking like, and how many geoid heights
    control points then seem to lie too low."""
    suspects: list[tuple[_Who, HeightSystem | None, HeightSystem, int]] = []
    parties: tuple[tuple[_Who, HeightSystem | None, int], ...] = (("control", control, 1), ("GNSS", gnss, -1))
    for who, declared, geoid_heights in parties if not gnss_is_proved else parties[:1]:
        if declared == "orthometric":
            suspects.append((who, declared, "ellipsoidal", -geoid_heights))
        else:
            suspects.append((who, declared, "orthometric", geoid_heights))
    return suspects


def _contradiction(
    project: Project, shift: HeightShift, role: Role, gnss: HeightSystem | None, proved: bool, geoid_m: float | None
) -> tuple[Finding, bool]:
    """Return the finding for a shift that heights of one system cannot have, and whether it is the geoid's height."""
    own = [p.heights for p in project.control_points if p.role == role]
    control = own[0] if len(set(own)) == 1 else None
    side = "below" if shift.shift_m > 0 else "above"
    size = abs(shift.shift_m)
    noun = "control heights" if role == "control" else "heights of the check points"
    fact = f"{size:.1f} m {side} where their marks and the GNSS heights put them"
    possible = _suspects(control, gnss, proved)
    if geoid_m is not None:
        near_m = max(_NEAR_GEOID_M, 3.0 * shift.sigma_m)
        likely = [p for p in possible if abs(shift.shift_m - p[3] * geoid_m) < near_m]
        why = f"the geoid lies {abs(geoid_m):.1f} m {'above' if geoid_m > 0 else 'below'} the ellipsoid here"
    else:
        likely = possible
        why = "tens of metres, as between ellipsoidal and orthometric heights"
    # where somebody declared them wrongly a person has to say what is right; otherwise the photographs do
    severity: Severity = "error" if control is not None and gnss is not None else "warning"
    used = ""
    if severity == "warning":
        used = "; the adjustment estimates the difference, and the results have the heights of the control points"
        if role == "check":
            used = "; check points are compared in plan alone"
    if not likely:
        text = f"{noun} lie {fact}, which no height system explains: {why}{used}"
        return Finding(severity, "heights", text, "check the heights of the control points and of the GNSS base"), False
    who, declared, looks, _ = likely[0]
    named = project.heights.geoid.name if project.heights.geoid is not None else "of the survey under heights.geoid"
    key = "heights.control_points" if who == "control" else "heights.gnss"
    remedy = f"write {key}: {looks}" + (f" with the geoid {named}" if looks == "orthometric" else "")
    although = f"although declared {declared}" if declared is not None else "and are not declared"
    if who == "control":
        text = f"{noun} look {looks} {although}: they lie {fact}; {why}{used}"
    else:
        text = f"GNSS heights look {looks} {although}: {noun} lie {fact}; {why}{used}"
    if len(likely) > 1:
        other, _, looks, _ = likely[1]
        remedy += f", or {'heights.gnss' if other == 'GNSS' else 'heights.control_points'}: {looks} if those are"
    return Finding(severity, "heights", text, remedy), geoid_m is not None


# ---- scales that look like a shift ---------------------------------------------------------------------------------


def _scale_fits(project: Project, evidence: HeightEvidence) -> list[ScaleFit]:
    """Return the common scales of the marks' coordinates that make them agree best with the GNSS positions.

    Where GNSS heights prove nothing, every shift of the heights is left open to them.
    """
    sure = _sure(evidence)
    marked = sure.gnss_world_m[np.unique(evidence.points.mark_photograph)]
    is_sure = bool(np.isfinite(marked).all(axis=1).any()) and project.gnss_offset_sigma_m[2] < SURE_SIGMA_M
    try:
        return fit_scales(sure if is_sure else evidence, np.zeros(1) if is_sure else _OPEN_SHIFTS_M)
    except ImageError:
        return []  # a lens that cannot be undone at a mark: the marks' own check says so


def _tie(shift: HeightShift, fit: ScaleFit) -> float:
    """Return by how much two robust costs may differ and still explain the marks equally well."""
    return max(_TIE_COST, _TIE_SHARE * (fit.cost_without - shift.cost))


def _is_plausible(evidence: HeightEvidence, fit: ScaleFit) -> bool:
    """Return whether the stated focal lengths of the marked cameras allow a scale, where it is one of these."""
    cameras = (evidence.cameras[int(c)] for c in np.unique(evidence.camera_of[evidence.points.mark_photograph]))
    return fit.kind != "focal length" or any(
        abs(fit.scale - 1.0) * camera.focal_px < SIGMAS * camera.sigmas[0] for camera in cameras
    )


def _in_words(evidence: HeightEvidence, fit: ScaleFit) -> str:
    """Return what a scale means for the cameras whose photographs are marked."""
    cameras = [evidence.cameras[int(c)] for c in np.unique(evidence.camera_of[evidence.points.mark_photograph])]
    if fit.kind == "focal length":
        if len(cameras) > 1:
            return f"focal lengths of {fit.scale:.2f} times the stated ones"
        return (
            f"a focal length of about {fit.scale * cameras[0].focal_px:.0f} px, stated are {cameras[0].focal_px:.0f} px"
        )
    if len({(c.width_px, c.height_px) for c in cameras}) > 1:
        return f"marks measured in images of {fit.scale:.2f} times the size of the photographs"
    width, height = cameras[0].width_px, cameras[0].height_px
    size = f"{fit.scale * width:.0f} × {fit.scale * height:.0f} px"
    return f"marks measured in images of about {size}, the photographs are {width} × {height} px"


def _scale_finding(
    evidence: HeightEvidence, role: Role, fits: Sequence[ScaleFit], shift: HeightShift | None
) -> Finding:
    """Return the finding for marks that a common scale explains, and a shift of heights as well where it is given."""
    readings = [_in_words(evidence, fit) for fit in fits]
    if shift is not None:
        side = "higher" if shift.shift_m > 0 else "lower"
        readings.append(f"heights that are {abs(shift.shift_m):.1f} m {side}")
    text = f"the marks of the {role} points agree with the GNSS positions only with {'; or '.join(readings)}"
    remedy = "check picture_size_px of the marks, and focal_px of the camera"
    return Finding("warning", "marks", text, remedy + (", and the height systems" if shift else ""))


def _of_role(
    project: Project, evidence: HeightEvidence, frame: LocalFrame, role: Role, tags: Sequence[bool | None]
) -> tuple[HeightShift | None, list[Finding]]:
    """Return the shift of the points of one role, None where it cannot be told, and what is wrong with it."""
    shift, fits = _shift(project, evidence), _scale_fits(project, evidence)
    if shift is None or abs(shift.shift_m) <= _limit_m(shift):
        better = [
            fit for fit in fits if fit.significant and (shift is None or fit.cost < shift.cost + _tie(shift, fit))
        ]
        return shift, [_scale_finding(evidence, role, better, None)] if better else []
    systems = set(project.gnss_systems(tags))
    gnss = next(iter(systems)) if len(systems) == 1 else None
    # what the tags themselves call ellipsoidal is not suspected, as long as it is taken as that
    proved = gnss == "ellipsoidal" and set(tags) == {True} and all(p.gnss_map_m is None for p in project.photographs)
    known = np.isfinite(evidence.gnss_world_m).all(axis=1)
    middle = frame.map_from_world(np.median(evidence.gnss_world_m[known], axis=0)[None])[0]
    finding, of_geoid = _contradiction(project, shift, role, gnss, proved, site_geoid_height_m(project, middle))
    as_good = [fit for fit in fits if fit.cost <= shift.cost + _tie(shift, fit)]
    if finding.severity == "warning":  # what nobody declares is likelier than a focal length far off its own sigma
        as_good = [fit for fit in as_good if _is_plausible(evidence, fit)]
    better = [fit for fit in as_good if fit.cost < shift.cost - _tie(shift, fit)]
    if better or (as_good and not of_geoid):
        return shift, [_scale_finding(evidence, role, better or as_good, None if better else shift)]
    return shift, [finding]


def _of_both_roles(
    project: Project, evidence: Mapping[Role, HeightEvidence], frame: LocalFrame, tags: Sequence[bool | None]
) -> tuple[HeightShift | None, list[Finding]]:
    """Return the shift of the control points, or of check points where these alone tell it, None where neither do, and
    what is wrong with the heights of both. Where control and GNSS agree, check points that do not spoil their own test
    alone."""
    shift, findings = _of_role(project, evidence["control"], frame, "control", tags)
    agree = shift is not None and not findings
    of_checks, wrong = _of_role(project, evidence["check"], frame, "check", tags)
    both = findings + [replace(f, severity="warning") if agree else f for f in wrong]
    return (of_checks if shift is None and not findings else shift), both


def shift_of_block(project: Project, block: Block, role: Role, tags: Sequence[bool | None]) -> float:
    """Return how much higher the ground points of a role would have to lie for their marks to agree with the GNSS
    heights, m; 0 where they agree, or nothing tells, or something else may be wrong with the marks."""
    shift, findings = _of_role(project, _evidence_of_block(block, role), block.frame, role, tags)
    return shift.shift_m if shift is not None and any(f.where == "heights" for f in findings) else 0.0


def stop_at_contradictions(project: Project, block: Block, tags: Sequence[PhotographNote]) -> None:
    """Raise ProjectError where the heights of control points and GNSS contradict each other as two height systems do,
    and neither a focal length nor a picture size would explain it.

    ``tags`` are what the first stage has noted of the photographs, ``block`` what it has measured.
    """
    project, block = project.surveyed, block.surveyed
    ellipsoidal = [t["height_is_ellipsoidal"] for t in tags]
    evidence = {role: _evidence_of_block(block, role) for role in _ROLES}
    for finding in _of_both_roles(project, evidence, block.frame, ellipsoidal)[1]:
        if finding.severity == "error":
            raise ProjectError(f"{project.path}: {finding}")


# ---- declarations --------------------------------------------------------------------------------------------------


def _undeclared(project: Project, tags: Sequence[bool | None], positioned: Sequence[bool]) -> list[str]:
    """Return in words whose height system is not declared."""
    missing = []
    systems = [s for s, known in zip(project.gnss_systems(tags), positioned, strict=True) if known]
    if None in systems:
        number = f"{systems.count(None)} of {len(systems)} GNSS positions"
        missing.append("the GNSS positions" if set(systems) == {None} else number)
    for role, noun in (("control", "control point"), ("check", "check point")):
        own = [p for p in project.control_points if p.role == role]
        bare = [p.name for p in own if p.heights is None]
        if bare:
            missing.append(f"the {noun}s" if len(bare) == len(own) else f"the {noun}s {some(bare)}")
    return missing


def _declaration_findings(
    project: Project, survey: MeasuredSurvey, tags: Sequence[bool | None], shift: HeightShift | None
) -> list[Finding]:
    """Return what is not declared, and what becomes of it."""
    missing = _undeclared(project, tags, survey.positioned.tolist())
    if not missing and project.heights.output is not None:
        return []
    if not missing:
        text = "the vertical reference of the results is not declared"
        remedy = "write heights: ellipsoidal, or heights: {output: orthometric, geoid: …}"
        return [Finding("warning", "heights", text, remedy)]
    agree = shift is not None and abs(shift.shift_m) <= _limit_m(shift)
    text = f"not declared whether the heights of {', '.join(missing)} are above the ellipsoid or a geoid"
    if agree and shift is not None:
        text += f"; GNSS and ground points agree to {_limit_m(shift):.0f} m, according to the marks: they are used so"
    elif survey.positioned.any() and any(p.controlled[2] for p in project.control_points):
        text += "; the adjustment decides whether GNSS and control points agree"
    remedy = (
        "write heights: ellipsoidal if all are, else heights: {output: …, gnss: …, control_points: …, geoid: …}, each "
        "ellipsoidal or orthometric"
    )
    return [Finding("warning", "heights", text, remedy)]


def _against_tags(project: Project, tags: Sequence[bool | None]) -> list[Finding]:
    """Return whether the tags say something else than what is declared."""
    declared = project.heights.gnss
    names = [
        p.name
        for p, t in zip(project.photographs, tags, strict=True)
        if t is not None and p.gnss_map_m is None and declared is not None and t != (declared == "ellipsoidal")
    ]
    if not names:
        return []
    says = "near sea level" if declared == "ellipsoidal" else "ellipsoidal"
    text = f"according to the tags the heights are {says}, but heights.gnss declares them {declared}"
    return [Finding("warning", some(names), text, "check heights.gnss; remove it to follow the tags")]


def height_system_findings(project: Project, tags: Sequence[PhotographTags | None]) -> list[Finding]:
    """Return what is not declared of the heights, and what is declared and cannot be true."""
    try:
        survey = usable_survey(project, tags)
    except FrameError:
        return []  # the geometry's own check says so
    if survey is None or any(f.severity == "error" for f in control_position_findings(project, survey)):
        return []  # heights of points that lie elsewhere say nothing of a system
    ellipsoidal = [None if t is None else t.height_is_ellipsoidal for t in tags]
    evidence = {role: _evidence_of_survey(project, survey, role) for role in _ROLES}
    shift, findings = _of_both_roles(project, evidence, survey.frame, ellipsoidal)
    if not findings:
        findings += _declaration_findings(project, survey, ellipsoidal, shift)
    return [*findings, *_against_tags(project, ellipsoidal)]
