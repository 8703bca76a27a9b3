"""The built-in simulated survey: photographs, project file and truth written to a folder, and the result judged by
that truth."""

from pathlib import Path
from typing import Any

import numpy as np

from photogram.errors import ProjectError
from photogram.files.atomic import make_folder, replacing
from photogram.files.maps.rasters import write_raster
from photogram.files.npz_json import fingerprint, read_json, write_json
from photogram.files.photographs.images import write_photograph
from photogram.projection import PARAMETER_NAMES, PARAMETERS, USUAL
from photogram.simulation.simulated_survey import (
    SimulatedSurvey,
    SurveyPlan,
    demonstration_plan,
    render_photographs,
    simulate,
    truth_surface,
)
from photogram.simulation.survey_files import photograph_tags, truth_record
from photogram.wording import Progress

TRUTH_CELL_M = 0.1


def _numbers(values: np.ndarray[Any, np.dtype[np.float64]], digits: int) -> str:
    return "[" + ", ".join(f"{v:.{digits}f}" for v in values) + "]"


def _sigma(value: float) -> str:
    return "free" if np.isinf(value) else f"{value:g}"


def _gnss_lines(plan: SurveyPlan) -> list[str]:
    if not plan.gnss_tags:
        return ["  # the photographs have no position or attitude in their tags"]
    if plan.rtk_flag is not None:
        return ["  # GNSS positions, their sigmas and the gimbal attitude are in the photographs' tags"]
    sigma = _numbers(np.array(plan.gnss_sigma_m), 3)
    return [
        "  # GNSS positions and the gimbal attitude are in the photographs' tags, the sigmas are not",
        f"  gnss_sigma_m: {sigma}",
    ]


_SPARSE = (
    "# Disabled to keep the demonstration quick: remove these two lines, or run `photogram demo --dense`.",
    "dense: {enabled: false}",
    "orthophoto: {enabled: false}",
)


def _coarse_cells(plan: SurveyPlan) -> tuple[str, ...]:
    return (
        "# Coarse cells are quick; without these two lines they are 2 GSD and 1 GSD.",
        f"surface: {{cell_m: {4 * plan.gsd_m:.2f}}}",
        f"orthophoto: {{cell_m: {2 * plan.gsd_m:.2f}}}",
    )


def _project_text(survey: SimulatedSurvey, dense: bool) -> str:
    camera = survey.approximate_camera
    points = survey.control_points
    plan = survey.plan
    sigma = camera.sigmas
    stated = [k for k in range(3, PARAMETERS) if USUAL[k] or sigma[k] > 0]
    sigmas = ", ".join(f"{PARAMETER_NAMES[k]}: {_sigma(sigma[k])}" for k in stated)
    radial = camera.radial if camera.radial[3] else camera.radial[:3]
    lines = [
        f"# Simulated survey, seed {survey.seed}: written by `photogram demo`; its truth is known.",
        "photogram: 1",
        "report: {name: Simulated survey of photogram demo, target_rmse_h_m: 0.05, target_rmse_v_m: 0.05}",
        f"crs: {survey.frame.crs}",
        "heights: ellipsoidal # of the control points, the GNSS positions and all results",
        "cameras:",
        f"  {camera.name}:",
        f"    width_px: {camera.width_px}",
        f"    height_px: {camera.height_px}",
        *([f"    model: {camera.model}"] if camera.model != "brown" else []),
        f"    focal_px: {camera.focal_px:.4f}",
        f"    principal_point_px: {_numbers(camera.principal_point_px, 4)}",
        f"    radial: {_numbers(radial, 8)}",
        f"    tangential: {_numbers(camera.tangential, 8)}",
        *([f"    affinity: {_numbers(camera.affinity, 4)}"] if camera.affinity.any() else []),
        "    # prior sigmas of the laboratory calibration; 0 keeps a parameter fixed",
        f"    sigmas: {{focal_px: {_sigma(sigma[0])}, principal_point_px: {_sigma(sigma[1])}, {sigmas}}}",
        "photographs:",
        "  folder: photographs",
        f"  camera: {camera.name}",
        f"  attitude_sigma_deg: {plan.attitude_sigma_deg:g}",
        *_gnss_lines(plan),
        "  list:",
        *(f'    - {{name: {p.name}, flight: "{p.flight}"}}' for p in survey.photographs),
        "gnss:",
        f"  offset_sigma_m: {_numbers(np.array(plan.gnss_offset_sigma_m), 3)}",
        "control_points:",
        f"  sigma_m: {_numbers(np.array(plan.control_sigma_m), 4)}",
        f"  mark_sigma_px: {plan.stated_mark_sigma_px:.4f}",
        "  list:",
    ]
    position_map_m = survey.frame.map_from_world(points.position_world_m)
    for g, name in enumerate(points.name):
        marks = np.flatnonzero(points.mark_point == g)
        digits = 0 if plan.whole_pixel_marks else 3
        seen = ", ".join(
            f"{survey.photographs[points.mark_photograph[m]].name}: {_numbers(points.mark_pixel[m], digits)}"
            for m in marks
        )
        lines += [
            f"    - name: {name}",
            f"      role: {points.role[g]}",
            f"      position_m: {_numbers(position_map_m[g], 4)}",
            f"      marks: {{{seen}}}",
        ]
    lines += [
        "features:",
        "  maximum: 2500",
        *(_coarse_cells(plan) if dense else _SPARSE),
        "comparison:",
        "  reference: truth_surface.tif",
        "",
    ]
    return "\n".join(lines)


def write_demonstration(
    folder: Path,
    seed: int,
    progress: Progress,
    plan: SurveyPlan | None = None,
    *,
    dense: bool = True,
) -> Path:
    """Simulate the demonstration survey, or another ``plan``, and write photographs, project.yaml and its truth.

    ``dense``: whether its project asks for a dense surface and an orthophoto. Returns the project file. What an earlier
    run with the same seed and plan has written is kept, unless its project leaves out what is asked for now. Raises
    ProjectError where the folder has a project file that is none of a demonstration.
    """
    plan = plan or demonstration_plan()
    project, truth = folder / "project.yaml", folder / "truth.json"
    made = truth.is_file() and project.is_file() and read_json(truth).get("made_from") == fingerprint(plan, seed)
    if made and not (dense and _SPARSE[1] in project.read_text(encoding="utf-8")):
        return project
    if project.exists() and not truth.is_file():
        raise ProjectError(f"{project}: a project file exists already: give another folder")
    return write_survey(folder, simulate(plan, seed), progress, dense=dense)


def write_survey(
    folder: Path, survey: SimulatedSurvey, progress: Progress, *, dense: bool = True, noise_dn: float = 2.0
) -> Path:
    """Write the photographs of a survey, with noise of ``noise_dn`` grey values, its project.yaml, which is returned,
    and its truth; ``dense`` as in ``write_demonstration``."""
    project, truth = folder / "project.yaml", folder / "truth.json"
    make_folder(folder / "photographs")
    count = len(survey.photographs)
    for done, (photograph, (name, pixels)) in enumerate(
        zip(survey.photographs, render_photographs(survey, noise_dn=noise_dn), strict=True)
    ):
        progress(done, count, name)
        write_photograph(folder / "photographs" / name, pixels, photograph_tags(survey, photograph))
    write_raster(folder / "truth_surface.tif", truth_surface(survey, TRUTH_CELL_M), survey.frame.crs)
    with replacing(project) as temporary:
        temporary.write_text(_project_text(survey, dense), encoding="utf-8")
    write_json(truth, truth_record(survey))
    progress(count, count, "")
    return project
