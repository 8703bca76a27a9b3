"""A project that starts from another program's solution as the text of project.yaml."""

from collections import Counter
from collections.abc import Sequence

from photogram.camera import Camera
from photogram.exchange.draft import ImportedDraft
from photogram.geodesy.crs import NO_CRS
from photogram.gnss import Sigma3
from photogram.project.draft.text import (
    ASSUMED,
    CALIBRATION,
    CONTROL_EXAMPLE,
    assumed_control,
    assumed_marks,
    flights_comment,
    gnss_lines,
    list_item,
)
from photogram.project.draft.yaml_text import comment, flow, numbers, scalar, sigma3
from photogram.projection import CAMERA_PARAMETERS
from photogram.wording import things

SOLUTION, POSITIONS, POINTS, MARKS = "solution.npz", "positions.csv", "ground_points.csv", "ground_marks.csv"
"""The files beside a project that it names: the solution, and tables of positions, points and marks."""

_RADIAL, _TANGENTIAL = "k1, k2, k3", "p1, p2"


def imported_text(draft: ImportedDraft, folder: str) -> str:
    """Return the text of project.yaml; ``folder`` is that of the photographs, as the file is to name it."""
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
        f"  solution: {SOLUTION} # as the other program left it, in photogram's form",
        f"  tie_points: {draft.tie_points} # own: key points and matches are photogram's",
        f"  poses: {draft.poses} # own: the orientation is photogram's",
        "",
        "cameras:",
    ]
    for number, (camera, reason) in enumerate(zip(draft.cameras, draft.camera_reasons, strict=True)):
        lines += _camera(camera, reason, draft.program) if members[number] else []
    lines += ["", *_photographs(draft, folder), ""]
    lines += gnss_lines(draft.gnss, draft.offset_sigma_m, draft.offset_reason)
    return "\n".join([*lines, *_control(draft), ""])


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
        CALIBRATION,
        *flow("    sigmas", [f"{key}: free" for key in free]),
    ]


def _photographs(draft: ImportedDraft, folder: str) -> list[str]:
    lines = ["photographs:", f"  folder: {scalar(folder)} # relative to this file"]
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
            f"    - path: {POSITIONS} # {things(len(draft.measured), 'photograph')}",
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
            lines.append(ASSUMED)
    if draft.with_attitude:
        lines.append(f"  attitude_sigma_deg: 2.0 # of yaw, pitch and roll in the tags of {draft.with_attitude}")
    lines += [*flights_comment(draft.flights), "  list:"]
    for photograph in draft.photographs:
        camera = None if one_camera else scalar(draft.cameras[photograph.camera].name)
        flight = f'"{photograph.flight}"' if draft.flights > 1 else None
        lines.append(list_item(name=scalar(photograph.name), camera=camera, flight=flight))
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


def _control(draft: ImportedDraft) -> Sequence[str]:
    if not draft.points:
        return CONTROL_EXAMPLE
    assumed = []
    if any(None in p.sigma_m for p in draft.points):
        assumed = assumed_control("The solution gives no accuracy of some")
    return [
        "control_points:",
        "  files:",
        f"    - path: {POINTS} # {things(len(draft.points), 'point')}, each with its role",
        "      role: control",
        *([f"      crs: {scalar(draft.measured_crs)}"] if draft.measured_crs is not None else []),
        *([f"      marks: {MARKS}"] if draft.marks else []),
        *assumed,
        *assumed_marks("the table"),
    ]
