"""A rendered survey of a master and the bands of a multispectral camera, on disk with its project file: each band with
a grey function, a lens and a place on the body of its own."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from lib.simulated.bands import FOCAL, NOMINAL_M, NOMINAL_SIGMA, SYNCHRONOUS
from lib.simulated.two_cameras import companion_camera, rigid_poses

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.constraints.rigs import RelativePose
from photogram.files.atomic import make_folder, replacing
from photogram.files.photographs.images import write_photograph
from photogram.simulation.rendering import render
from photogram.simulation.simulated_survey import SimulatedSurvey, simulate
from photogram.simulation.survey_files import photograph_tags, write_control_list
from photogram.simulation.survey_plan import SurveyPlan

GREYS = (((-0.2, -0.5, -0.1), 200.0), ((0.9, -0.6, 0.1), 120.0), ((-0.6, 0.2, 0.9), 60.0), ((0.2, 0.2, -0.9), 170.0))
"""What a band makes of red, green and blue: their weights, and what is added."""


@dataclass(frozen=True, eq=False)
class BandSurvey:
    """What was written, and the truth: the survey of the master; of each band camera, poses and relative pose."""

    survey: SimulatedSurvey
    cameras: tuple[Camera, ...]
    poses: tuple[tuple[Pose, ...], ...]
    relative: tuple[RelativePose, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the bands' cameras."""
        return tuple(camera.name for camera in self.cameras)


def _camera_lines(name: str, camera: Camera) -> list[str]:
    f, u, v, k1, k2, k3, _, p1, p2 = (float(value) for value in camera.parameters[:9])
    sf, su, _, sk1, sk2, _, _, sp1, _ = (float(value) for value in camera.sigmas[:9])
    return [
        f"  {name}:",
        f"    width_px: {camera.width_px}",
        f"    height_px: {camera.height_px}",
        f"    focal_px: {f:.6f}",
        f"    principal_point_px: [{u:.6f}, {v:.6f}]",
        f"    radial: [{k1:.9f}, {k2:.9f}, {k3:.9f}]",
        f"    tangential: [{p1:.9f}, {p2:.9f}]",
        f"    sigmas: {{focal_px: {sf:g}, principal_point_px: {su:g}, k1: {sk1:g}, k2: {sk2:g}, "
        f"p1: {sp1:g}, p2: {sp1:g}}}",
    ]


def _project(survey: SimulatedSurvey, known: list[Camera], files: list[tuple[str, str]]) -> str:
    plan, master = survey.plan, "colour"
    companions = [
        f"      - {{camera: {camera.name}, offset_m: [{x:g}, {y:g}, {z:g}], offset_sigma_m: {NOMINAL_SIGMA[3]:g}, "
        f"rotation_deg: [0, 0, 0], rotation_sigma_deg: {np.degrees(NOMINAL_SIGMA[0]):g}, products: false}}"
        for camera, (x, y, z) in zip(known, NOMINAL_M, strict=False)
    ]
    lines = [
        "photogram: 1",
        f"crs: {survey.frame.crs}",
        "cameras:",
        *_camera_lines(master, survey.approximate_camera),
        *(line for camera in known for line in _camera_lines(camera.name, camera)),
        "photographs:",
        "  folder: photographs",
        f"  gnss_sigma_m: {list(plan.gnss_sigma_m)}",
        "  list:",
        *(f"    - {{name: {name}, camera: {camera}}}" for name, camera in files),
        "rigs:",
        f"  - master: {master}",
        "    exposures: name",
        r"    name_pattern: 'SIM_(\d+)_\d'",
        f"    sigma_m: {SYNCHRONOUS[3]:g}",
        f"    sigma_deg: {np.degrees(SYNCHRONOUS[0]):.4g}",
        "    companions:",
        *companions,
        "gnss:",
        f"  offset_sigma_m: {list(plan.gnss_offset_sigma_m)}",
        "control_points:",
        f"  sigma_m: {list(plan.control_sigma_m)}",
        f"  mark_sigma_px: {plan.stated_mark_sigma_px:g}",
        "  files:",
        "    - path: control.txt",
        "    - {path: check.txt, role: check}",
    ]
    return "\n".join([*lines, ""])


def write_band_survey(folder: Path, plan: SurveyPlan, seed: int, bands: int = 4) -> BandSurvey:
    """Render a master in colour and so many ``bands`` of it, four at most, and write them with a project file.

    Lenses are known as the plan states, relative poses as on the drawing of the camera (NOMINAL_SIGMA). Raises
    ValueError as ``simulate`` does, and WorkspaceError where a file cannot be written.
    """
    survey, rng = simulate(plan, seed), np.random.default_rng([seed, 17])
    count, cameras, known, poses, relative = len(survey.truth.poses), [], [], [], []
    make_folder(folder / "photographs")
    names = {p.name: f"SIM_{i:03d}_0.JPG" for i, p in enumerate(survey.photographs)}
    files = [(name, "colour") for name in names.values()]
    tags = [photograph_tags(survey, photograph) for photograph in survey.photographs]
    for i, pose in enumerate(survey.truth.poses):
        pixels = render(survey.scene, survey.truth.camera, pose, seed=1000 * seed + i, exposure=i)
        write_photograph(folder / "photographs" / files[i][0], pixels, tags[i])
    for number in range(bands):
        true, approximate = companion_camera(
            survey.truth.camera, survey.approximate_camera, rng, f"band{number + 1}", FOCAL[number]
        )
        place = RelativePose(np.array(NOMINAL_M[number]), np.eye(3)).moved(NOMINAL_SIGMA * rng.standard_normal(6))
        own = rigid_poses(survey.truth.poses, place, SYNCHRONOUS * rng.standard_normal((count, 6)))
        weights, added = GREYS[number]
        for i, carried in enumerate(own):
            seed_of_noise = 1000 * seed + 100 * (number + 1) + i
            colour = render(survey.scene, true, carried, seed=seed_of_noise, exposure=i).astype(np.float64)
            grey: FloatArray = np.clip(np.rint(colour @ np.array(weights) + added), 0, 255)
            name = f"SIM_{i:03d}_{number + 1}.JPG"
            picture = np.repeat(grey.astype(np.uint8)[..., None], 3, axis=2)
            write_photograph(folder / "photographs" / name, picture, replace(tags[i], dewarp=None))
            files.append((name, true.name))
        cameras.append(true)
        known.append(approximate)
        poses.append(own)
        relative.append(place)
    write_control_list(folder / "control.txt", survey, "control", names)
    write_control_list(folder / "check.txt", survey, "check", names)
    with replacing(folder / "project.yaml") as partial:
        partial.write_text(_project(survey, known, files), encoding="utf-8")
    return BandSurvey(survey, tuple(cameras), tuple(poses), tuple(relative))
