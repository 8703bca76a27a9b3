"""A drafted project as the text of project.yaml, with a comment for every choice that was made."""

from collections import Counter
from collections.abc import Sequence

from photogram.geodesy.crs import NO_CRS, WGS84
from photogram.gnss import Sigma3
from photogram.project.draft.cameras import SIGMA_NAMES, TaggedCamera
from photogram.project.draft.control import ControlFile
from photogram.project.draft.draft import DraftPhotograph, DraftPositions, OtherSite, ProjectDraft
from photogram.project.draft.positions import Gnss
from photogram.project.draft.rigs import rig_lines
from photogram.project.draft.yaml_text import comment, flow, numbers, scalar, sigma3
from photogram.wording import things

ATTITUDE_SIGMA_DEG = 2.0
DEFAULT_CONTROL_SIGMA_M = (0.03, 0.03, 0.05)
DEFAULT_MARK_SIGMA_PX = 1.0


CALIBRATION = (
    "    calibration: auto # parameters that the image geometry determines are estimated, the others stay fixed"
)
ASSUMED = "  gnss_sigma_assumed: true # nobody states it: estimated from the residuals of each flight"

CONTROL_EXAMPLE = [
    "# Ground points are given like this:",
    "#",
    "# control_points:",
    "#   files:",
    "#     - {path: gcp_list.txt, role: control, sigma_m: [0.03, 0.03, 0.05], mark_sigma_px: 1.0}",
]


def flights_comment(flights: int) -> list[str]:
    """Return the comment on the flights of a list of photographs, nothing for one."""
    text = (
        f"{flights} flights: another camera body, a pause of more than ten minutes or a gap in the positions begins "
        "one; each has its own GNSS offset."
    )
    return comment(text, 2) if flights > 1 else []


def list_item(**values: str | None) -> str:
    """Return an item of a list of photographs; keys whose value is None are left out."""
    return f"    - {{{', '.join(f'{key}: {value}' for key, value in values.items() if value is not None)}}}"


def gnss_lines(gnss: Sequence[Gnss | None], offset_sigma_m: Sigma3, reason: str) -> list[str]:
    """Return the block of GNSS, nothing where no photograph has a position."""
    if all(g is None for g in gnss):
        return []
    line = f"  offset_sigma_m: {sigma3(offset_sigma_m)} # easting, northing, height"
    return ["gnss:", *comment(reason, 2), line, ""]


def _camera(camera: TaggedCamera, photographs: int) -> list[str]:
    stated = [(name, sigma) for name, sigma in zip(SIGMA_NAMES, camera.sigmas, strict=True) if sigma > 0.0]
    figures = [f"{name}: {sigma:.3g}" for name, sigma in stated]
    shutter = camera.shutter
    if shutter is None:
        of_shutter = "How the photographs moved is not told: b1 and b2 stand for a rolling shutter."
    else:
        of_shutter = f"{shutter.source[0].upper()}{shutter.source[1:]}."
        figures += [f"readout_s: {shutter.sigma_s:.3g}"] if shutter.sigma_s > 0.0 else []
    readout = [f"    readout_s: {shutter.readout_s:g}"] if shutter is not None and shutter.readout_s else []
    readings = [f"    focal_readings_px: {numbers(camera.readings_px, '.3f')}"] if camera.readings_px else []
    return [
        *comment(f"{photographs} photographs. {camera.reason[0].upper()}{camera.reason[1:]} {of_shutter}", 2),
        f"  {camera.name}:",
        f"    width_px: {camera.width_px}",
        f"    height_px: {camera.height_px}",
        f"    focal_px: {camera.focal_px:.3f}",
        *readings,
        f"    principal_point_px: {numbers(camera.principal_point_px, '.3f')}",
        f"    radial: {numbers(camera.radial, '.9g')} # k1, k2, k3",
        f"    tangential: {numbers(camera.tangential, '.9g')} # p1, p2",
        *readout,
        f"    source: {scalar(camera.source)}",
        CALIBRATION,
        *flow("    sigmas", figures),
    ]


def _item(photograph: DraftPhotograph, common: Sigma3 | None, several_cameras: bool, several_flights: bool) -> str:
    gnss = None if photograph.listed else photograph.gnss
    return list_item(
        name=scalar(photograph.name),
        camera=photograph.camera if several_cameras else None,
        flight=f'"{photograph.flight}"' if several_flights else None,
        gnss_sigma_m=sigma3(gnss.sigma_m) if gnss is not None and gnss.sigma_m != common else None,
    )


def _left_out(reason: str, names: Sequence[str]) -> list[str]:
    return [*comment(f"Left out: {reason}", 4), *(f"    # - {{name: {scalar(name)}}}" for name in names)]


def _other_site(site: OtherSite) -> list[str]:
    where = f"longitude {site.longitude_deg:.5f}, latitude {site.latitude_deg:.5f}"
    photographs = things(len(site.names), "photograph")
    return _left_out(f"another site, {site.distance_m / 1000:.1f} km away at {where}, {photographs}", site.names)


def _gnss_comment(draft: ProjectDraft) -> list[str]:
    without = sum(p.gnss is None for p in draft.photographs)
    if without == len(draft.photographs):
        return comment(
            "The tags give no position that can be used: the photographs are related by image matching alone.", 2
        )
    kinds = ", ".join(f"{number} {kind}" for kind, number in draft.gnss_kinds.items())
    where = "the photographs' own tags"
    if any(file.rows for file in draft.positions):
        where += " and in the file beside them"
    text = f"Positions stand in {where}: {kinds}"
    text += f", {without} without a position" if without else ""
    assumed = ", 2 m in plan and 3 m in height being assumed" if draft.gnss_kinds.get("without stated accuracy") else ""
    heights = f"{draft.heights}. " if draft.heights else ""
    return comment(
        f"{text}{assumed}. {heights}gnss_sigma_m are the standard deviations of easting, northing and height"
        + (", beside each photograph where it has its own." if len(draft.photographs) > 1 else "."),
        2,
    )


def _whose(file: DraftPositions) -> str:
    return ", position_of: camera" if file.is_table else ""


def _positions(draft: ProjectDraft) -> list[str]:
    used = [file for file in draft.positions if not file.error]
    unused = [line for p in draft.positions if p.error for line in comment(f"{p.path} is not used: {p.error}", 2)]
    if not used:
        return unused
    return [
        *unused,
        *comment(
            "Position files take precedence over the tags. DJI's MRK gives the camera's position, lever arm "
            "applied; for a PPK solution name its table here instead, and with position_of: antenna the MRK as "
            "lever_arms.",
            2,
        ),
        "  positions:",
        *(
            f"    - {{path: {scalar(file.path)}{_whose(file)}}} # {things(len(file.rows), 'photograph')}"
            for file in used
        ),
    ]


def _masks(draft: ProjectDraft) -> list[str]:
    masks = draft.masks
    if masks is None:
        return []
    if masks.error:
        return comment(f"{masks.path} is not used: {masks.error}", 2)
    return [f"  masks: {scalar(masks.path)} # of {things(masks.photographs, 'photograph')}; black is left out"]


def _photographs(draft: ProjectDraft, folder: str) -> list[str]:
    sigmas = Counter(p.gnss.sigma_m for p in draft.photographs if p.gnss is not None and not p.listed)
    most = sigmas.most_common(1)
    common = most[0][0] if most and (most[0][1] > 1 or len(draft.photographs) == 1) else None
    one_camera = len(draft.cameras) == 1
    with_attitude = sum(p.has_attitude for p in draft.photographs)
    lines = ["photographs:", f"  folder: {scalar(folder)} # relative to this file", *_masks(draft)]
    if one_camera:
        lines.append(f"  camera: {draft.cameras[0].name}")
    lines += _gnss_comment(draft)
    lines += _positions(draft)
    if common is not None:
        lines.append(f"  gnss_sigma_m: {sigma3(common)}")
    alike = [p.gnss for p in draft.photographs if p.gnss is not None and not p.listed and p.gnss.sigma_m == common]
    if alike and all(gnss.assumed for gnss in alike):
        lines.append(ASSUMED)
    if with_attitude:
        all_of_them = things(len(draft.photographs), "photograph")
        text = f"Yaw, pitch and roll stand in the tags of {with_attitude} of {all_of_them}; 2° is usual."
        lines += [*comment(text, 2), f"  attitude_sigma_deg: {ATTITUDE_SIGMA_DEG}"]
    else:
        lines += comment("The tags give no attitude.", 2)
    lines += flights_comment(draft.flights)
    for warning in draft.warnings:
        lines += comment(f"Warning: {warning}.", 2)
    lines.append("  list:")
    lines += [_item(p, common, not one_camera, draft.flights > 1) for p in draft.photographs]
    for site in draft.other_sites:
        lines += _other_site(site)
    return [*lines, *(line for reason, names in draft.left_out_for.items() for line in _left_out(reason, names))]


def assumed_control(reason: str) -> list[str]:
    """Return the standard deviations of points for which nobody states any, and that they are assumed."""
    return [
        *comment(f"{reason}; these are assumed; enter those of your survey, and remove sigma_assumed:", 6),
        f"      sigma_m: {sigma3(DEFAULT_CONTROL_SIGMA_M)}",
        "      sigma_assumed: true # estimated from what the points scatter by",
    ]


def assumed_marks(table: str) -> list[str]:
    """Return the standard deviation of marks where a ``table`` gives none, and that it is assumed."""
    return [
        f"      mark_sigma_px: {DEFAULT_MARK_SIGMA_PX} # where {table} gives none",
        "      mark_sigma_assumed: true # estimated from what the marks scatter by",
    ]


def _control_file(file: ControlFile, crs: str) -> list[str]:
    lines = [f"    - path: {scalar(file.path)}", f"      role: {file.role}"]
    if file.crs is None and file.geographic:
        lines.append("      crs: EPSG:4326 # longitude and latitude; WGS 84 is assumed")
    elif file.grid == WGS84:
        text = "its longitude and latitude; easting and northing do not lie among the photographs in the map grid"
        lines.append(f"      crs: {WGS84} # {text}")
    elif file.grid is not None:
        lines.append(
            f"      crs: {scalar(file.grid)} # not stated in the file; its points lie among the photographs in it"
        )
    elif file.crs is None:
        lines.append(f"      crs: {scalar(crs)} # not stated in the file")
    if file.columns:
        names = ", ".join(map(scalar, file.columns))
        lines.append(f"      columns: [{names}] # only so its points lie among the photographs")
    if file.marks is not None:
        whose = " # what photogram mark changes; all others are those of the file" if file.has_marks else ""
        whose = " # the file has none: photogram mark writes them" if file.lacks_marks else whose
        lines.append(f"      marks: {scalar(file.marks)}{whose}")
    elif file.lacks_marks:
        lines += comment("The file has no marks in photographs: give a table of them with marks: FILE.csv", 6)
    if file.picture_size_px is not None:
        width, height = file.picture_size_px
        lines.append(f"      picture_size_px: [{width}, {height}] # of the pictures in which the marks were measured")
    if file.sigma_m is not None:
        lines.append(f"      sigma_m: {sigma3(file.sigma_m)} # easting, northing, height, where the file gives none")
    elif not file.has_sigmas:
        lines += assumed_control("The file gives no accuracy")
    return [*lines, *assumed_marks("the file")]


def _control(draft: ProjectDraft) -> list[str]:
    if draft.crs == NO_CRS and not draft.control:
        return [
            *comment(
                "Nothing says where the photographs were taken: they are adjusted as a free network, with relative "
                "precision. A distance gives it a scale, between two points that are marked in the photographs (u "
                "right, v down, in pixels), or between two photographs:"
            ),
            "#",
            "# distances:",
            "#   - {between: [A, B], length_m: 2.000, sigma_m: 0.001}",
            "# control_points:",
            "#   mark_sigma_px: 0.5",
            "#   list:",
            "#     - {name: A, marks: {first.jpg: [1200.5, 800.5], second.jpg: [1350.0, 790.5]}}",
            "#     - {name: B, marks: {first.jpg: [2400.0, 810.0], second.jpg: [2540.5, 805.0]}}",
        ]
    if not draft.control:
        return CONTROL_EXAMPLE
    return ["control_points:", "  files:", *(line for file in draft.control for line in _control_file(file, draft.crs))]


REPORT_EXAMPLE = (
    "# What the report says that no photograph tells. Remove the # signs and the lines that you do not need;",
    "# photogram report makes the page again after a change, in seconds.",
    "# report:",
    "#   name: Quarry north, stage 3 # title",
    "#   client: Example Ltd",
    "#   author: A. Surveyor # stands above the line for the signature",
    "#   place: Exampleton # of the signature",
    "#   surveyor: B. Surveyor # of the ground points",
    "#   instrument: GNSS receiver, RTK, base on the site # that they were surveyed with",
    "#   targets: black and white boards, 40 cm # that they are marked by on the ground",
    "#   target_rmse_h_m: 0.05 # accuracy that was agreed on, in plan",
    "#   target_rmse_v_m: 0.08 # and in height",
    "#   language: en # or de, es, pt, fr: of the first four pages, their pictures and README.txt",
    "#   standard: asprs-2024 # or pec-pcd: whose classes or statements the report has",
)
"""The block of the report, as a comment to fill in."""


def _heights(draft: ProjectDraft) -> list[str]:
    """Return the block of height systems; as a comment where somebody must fill it in."""
    systems = draft.height_systems
    if systems.known and systems.output is not None:
        lines = ["heights:", f"  output: {systems.output} # vertical reference of all results"]
        lines += [f"  gnss: {systems.gnss} # from the tags"] if systems.gnss is not None else []
        lines += [f"  control_points: {systems.control_points}"] if systems.control_points is not None else []
        lines += [f"  geoid: {scalar(systems.geoid)}"] if systems.geoid is not None else []
        return [*lines, ""] if len(lines) > 2 else []
    if draft.crs == NO_CRS or (not draft.control and all(p.gnss is None for p in draft.photographs)):
        return []
    whose = "of the ground points" if draft.control else "in the tags"
    text = (
        f"Nothing says whether the heights {whose} are above the ellipsoid, as GNSS gives them, or above a "
        "geoid. Declare it here and remove the # signs, so that the results name a height system."
    )
    return [
        *comment(text),
        "# heights:",
        "#   output: ellipsoidal # or orthometric: of all results",
        f"#   gnss: ellipsoidal # or orthometric{'; the tags say ellipsoidal' if systems.gnss else ''}",
        *(["#   control_points: orthometric # or ellipsoidal"] if draft.control else []),
        "#   geoid: EGM96 # needed with orthometric: or EPSG:5799, or the path of a grid (.gtx, .tif)",
        "",
    ]


def project_text(draft: ProjectDraft, folder: str) -> str:
    """Return the text of project.yaml; ``folder`` is that of the photographs, as the file is to name it."""
    members = Counter(p.camera for p in draft.photographs)
    left = sum(len(site.names) for site in draft.other_sites) + len(draft.left_out)
    head = f"Written by photogram init from {things(len(draft.photographs), 'photograph')}" + (
        f", {left} left out" if left else ""
    )
    lines = [
        *comment(f"{head}. Edit as needed."),
        "photogram: 1",
        "",
        *comment(f"{draft.crs_name}: {draft.crs_reason}."),
        f"crs: {scalar(draft.crs)}",
        "",
        *_heights(draft),
        "cameras:",
    ]
    for camera in draft.cameras:
        lines += _camera(camera, members[camera.name])
    lines += ["", *_photographs(draft, folder), "", *rig_lines(draft.rigs)]
    lines += gnss_lines([p.gnss for p in draft.photographs], draft.offset_sigma_m, draft.offset_reason)
    return "\n".join([*lines, *_control(draft), "", *REPORT_EXAMPLE, ""])
