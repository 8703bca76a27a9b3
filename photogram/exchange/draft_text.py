"""A project that starts from another program's solution as the text of project.yaml."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from photogram.camera import Camera
from photogram.exchange.draft import ImportedDraft, ImportedPhotograph
from photogram.geodesy.crs import NO_CRS
from photogram.gnss import Sigma3
from photogram.project.draft.text import DEFAULT_CONTROL_SIGMA_M, DEFAULT_MARK_SIGMA_PX
from photogram.project.draft.yaml_text import comment, flow, numbers, scalar, sigma3
from photogram.projection import CAMERA_PARAMETERS
from photogram.wording import things

SOLUTION, POSITIONS, POINTS, MARKS = "solution.npz", "positions.csv", "ground_points.csv", "ground_marks.csv"
_RADIAL, _TANGENTIAL = "k1, k2, k3", "p1, p2"


@dataclass(frozen=True)
class ImportedFiles:
    """The files that a project names, as it names them: the folder of the photographs, the solution, and tables of
    positions, points and marks."""

    photographs: str
    solution: str = SOLUTION
    positions: str = POSITIONS
    points: str = POINTS
    marks: str = MARKS


def imported_text(draft: ImportedDraft, files: ImportedFiles) -> str:
    """Return the text of project.yaml."""
    members = Counter(p.camera for p in draft.photographs)
    head = f"Written by photogram import from {things(len(draft.photographs), 'photograph')} of {draft.program}"
    lines = [
        *comment(f"{head}. Edit as needed."),
        "photogram: 1",
        "",
        *comment(f"{draft.crs_name}: {draft.crs_reason}."),
        f"crs: {scalar(draft.crs)}",
        "",
        *_heights(draft),
        "start:",
        f"  solution: {scalar(files.solution)} # as the other program left it, in photogram's form",
        f"  tie_points: {draft.tie_points} # own: key points and matches are photogram's",
        f"  poses: {draft.poses} # own: the orientation is photogram's",
        "",
        "cameras:",
    ]
    for number, (camera, reason) in enumerate(zip(draft.cameras, draft.camera_reasons, strict=True)):
        lines += _camera(camera, reason, draft.program) if members[number] else []
    lines += ["", *_photographs(draft, files), ""]
    if any(g is not None for g in draft.gnss):
        lines += [
            "gnss:",
            *comment(draft.offset_reason, 2),
            f"  offset_sigma_m: {sigma3(draft.offset_sigma_m)} # easting, northing, height",
            "",
        ]
    return "\n".join([*lines, *_control(draft, files), ""])


def _heights(draft: ImportedDraft) -> list[str]:
    if draft.crs == NO_CRS or (not draft.points and all(g is None for g in draft.gnss)):
        return []
    return [
        *comment(
            "All heights are taken to count from one surface. Where GNSS heights are above the ellipsoid and those of "
            "the points above a geoid, declare it here and remove the # signs:"
        ),
        "# heights:",
        "#   output: orthometric",
        "#   gnss: ellipsoidal",
        "#   control_points: orthometric",
        "#   geoid: EGM96",
        "",
    ]


def _camera(camera: Camera, reason: str, program: str) -> list[str]:
    free = dict.fromkeys(
        p.sigma_key for p, sigma in zip(CAMERA_PARAMETERS, camera.sigmas.tolist(), strict=True) if sigma > 0.0
    )
    fisheye = camera.model == "fisheye"
    terms = camera.radial if fisheye or camera.radial[3] else camera.radial[:3]
    return [
        *comment(f"{reason[0].upper()}{reason[1:]}", 2),
        f"  {scalar(camera.name)}:",
        f"    width_px: {camera.width_px}",
        f"    height_px: {camera.height_px}",
        *(["    model: fisheye"] if fisheye else []),
        f"    focal_px: {camera.focal_px:.12g}",
        f"    principal_point_px: {numbers(camera.principal_point_px.tolist(), '.12g')}",
        f"    radial: {numbers(terms.tolist(), '.12g')} # {_RADIAL}{', k4' if len(terms) > 3 else ''}",
        *([] if fisheye else [f"    tangential: {numbers(camera.tangential.tolist(), '.12g')} # {_TANGENTIAL}"]),
        *([f"    affinity: {numbers(camera.affinity.tolist(), '.12g')} # b1, b2"] if camera.affinity.any() else []),
        f"    source: {scalar(f'estimated by {program}')}",
        "    calibration: auto # parameters that the image geometry determines are estimated, the others stay fixed",
        *flow("    sigmas", [f"{key}: free" for key in free]),
    ]


def _photographs(draft: ImportedDraft, files: ImportedFiles) -> list[str]:
    lines = ["photographs:", f"  folder: {scalar(files.photographs)} # relative to this file"]
    one_camera = len(draft.cameras) == 1
    if one_camera:
        lines.append(f"  camera: {scalar(draft.cameras[0].name)}")
    common = _common_sigma(draft)
    if draft.crs == NO_CRS:
        lines += comment("No position is used in a local frame.", 2)
    elif draft.measured:
        lines += [
            *comment(f"Positions as {draft.program} was given them; the tags give those of other photographs.", 2),
            "  positions:",
            f"    - path: {scalar(files.positions)} # {things(len(draft.measured), 'photograph')}",
            "      position_of: camera # or antenna, where no lever arm was applied",
            *([f"      crs: {scalar(draft.measured_crs)}"] if draft.measured_crs is not None else []),
        ]
    elif any(g is not None for g in draft.gnss):
        lines += comment("Positions stand in the photographs' own tags.", 2)
    else:
        lines += comment("Neither the solution nor the tags give positions.", 2)
    if common is not None:
        lines.append(f"  gnss_sigma_m: {sigma3(common)}")
        if all(g is None or g.assumed for g in draft.gnss):
            lines.append("  gnss_sigma_assumed: true # nobody states it: estimated from the residuals of each flight")
    if draft.has_attitude:
        lines.append(f"  attitude_sigma_deg: 2.0 # of yaw, pitch and roll in the tags of {draft.has_attitude}")
    if draft.flights > 1:
        text = f"{draft.flights} flights, separated by pauses of more than ten minutes; each has its own GNSS offset."
        lines += comment(text, 2)
    lines.append("  list:")
    for photograph in draft.photographs:
        camera = None if one_camera else draft.cameras[photograph.camera].name
        lines.append(_item(photograph, camera, draft.flights > 1))
    for missing in draft.left_out:
        lines += [*comment(f"Not there: {missing.reason}", 4), f"    # - {{name: {scalar(missing.name)}}}"]
    return lines


def _common_sigma(draft: ImportedDraft) -> Sigma3 | None:
    """Return the sigmas of positions for which no table states any."""
    sigmas = Counter(
        g.sigma_m
        for p, g in zip(draft.photographs, draft.gnss, strict=True)
        if g is not None and (p.name not in draft.measured or draft.measured[p.name][1] is None)
    )
    return sigmas.most_common(1)[0][0] if sigmas else None


def _item(photograph: ImportedPhotograph, camera: str | None, several_flights: bool) -> str:
    parts = [f"name: {scalar(photograph.name)}"]
    if camera is not None:
        parts.append(f"camera: {scalar(camera)}")
    if several_flights:
        parts.append(f'flight: "{photograph.flight}"')
    return f"    - {{{', '.join(parts)}}}"


def _control(draft: ImportedDraft, files: ImportedFiles) -> Sequence[str]:
    if not draft.points:
        return [
            "# Ground points are given like this:",
            "#",
            "# control_points:",
            "#   files:",
            "#     - {path: gcp_list.txt, role: control, sigma_m: [0.03, 0.03, 0.05], mark_sigma_px: 1.0}",
        ]
    whole = all(None not in p.sigma_m for p in draft.points)
    return [
        "control_points:",
        "  files:",
        f"    - path: {scalar(files.points)} # {things(len(draft.points), 'point')}, each with its role",
        "      role: control",
        *([f"      crs: {scalar(draft.measured_crs)}"] if draft.measured_crs is not None else []),
        *([f"      marks: {scalar(files.marks)}"] if draft.marks else []),
        *(
            []
            if whole
            else [
                *comment("The solution gives no accuracy of some; these are assumed; enter those of your survey:", 6),
                f"      sigma_m: {sigma3(DEFAULT_CONTROL_SIGMA_M)}",
            ]
        ),
        f"      mark_sigma_px: {DEFAULT_MARK_SIGMA_PX} # where the table gives none",
    ]
