"""A simulated survey on disk as a surveyor brings it home: photographs with their tags, lists of ground points with
their marks, and, beside them, the truth."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from photogram.arrays import ByteArray, FloatArray
from photogram.camera import gimbal_from_rotation
from photogram.files.atomic import make_folder, replacing
from photogram.files.npz_json import fingerprint, write_json
from photogram.files.photographs.images import write_photograph
from photogram.files.photographs.tags import Dewarp, PhotographTags
from photogram.geodesy.frames import geodetic_from_map
from photogram.simulation.simulated_survey import SimulatedSurvey
from photogram.survey import Photograph, Role

SENSOR_WIDTH_MM = 6.17
"""Of a sensor of 1/2.3 inch, whose whole area is 4:3 as the pictures are."""


def photograph_tags(survey: SimulatedSurvey, photograph: Photograph) -> PhotographTags:
    """Return what the drone writes into a photograph, as far as the survey's plan lets it know.

    Sigmas and the kind of solution are written by RTK drones alone. Without GNSS tags no position, attitude or time is
    left, as in pictures that went through another program.
    """
    camera, plan = survey.approximate_camera, survey.plan
    east, north, up = plan.gnss_sigma_m
    known = photograph.gnss_world_m is not None
    lon = lat = height = yaw = pitch = roll = None
    if photograph.gnss_world_m is not None:
        map_m = survey.frame.map_from_world(photograph.gnss_world_m[None])
        lon, lat, height = (float(v) for v in geodetic_from_map(survey.frame.crs, map_m)[0])
    if photograph.attitude_world_from_camera is not None:
        yaw, pitch, roll = gimbal_from_rotation(photograph.attitude_world_from_camera)
    exif = plan.calibration_source == "exif"
    return PhotographTags(
        make="DJI",
        model="SIMULATED",
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_mm=plan.focal_px * SENSOR_WIDTH_MM / camera.width_px if exif else None,
        focal_35mm_mm=plan.focal_35mm_mm if exif else None,
        time=photograph.time,
        longitude_deg=lon,
        latitude_deg=lat,
        height_m=height,
        height_above_take_off_m=photograph.height_above_ground_m,
        gnss_sigma_m=(east, north, up) if known and plan.rtk_flag is not None else None,
        rtk_flag=plan.rtk_flag if known else None,
        velocity_m_s=None if photograph.velocity_world_m_s is None else _north_east_down(photograph.velocity_world_m_s),
        gimbal_yaw_deg=yaw,
        gimbal_pitch_deg=pitch,
        gimbal_roll_deg=roll,
        dewarp=_dewarp(survey) if plan.calibration_source == "maker" else None,
    )


def _north_east_down(velocity_world_m_s: FloatArray) -> tuple[float, float, float]:
    east, north, up = (float(v) for v in velocity_world_m_s)
    return north, east, -up


def _dewarp(survey: SimulatedSurvey) -> Dewarp:
    camera = survey.approximate_camera
    u, v = camera.principal_point_px - np.array([camera.width_px - 1, camera.height_px - 1]) / 2
    k1, k2, k3 = camera.radial[:3]
    p1, p2 = camera.tangential
    return Dewarp("2024-06-01", (camera.focal_px,) * 2, (float(u), float(v)), (k1, k2, k3), (p1, p2))


def truth_record(survey: SimulatedSurvey, names: Mapping[str, str] | None = None) -> dict[str, object]:
    """Return the truth of a survey for JSON, positions in the map; ``names`` are photographs that were renamed."""
    camera, points = survey.truth.camera, survey.control_points
    positions = survey.frame.map_from_world(np.array([pose.position_world_m for pose in survey.truth.poses]))
    ground = survey.frame.map_from_world(survey.truth.control_position_world_m)
    renamed = [(names or {}).get(p.name, p.name) for p in survey.photographs]
    return {
        "simulated": True,
        "seed": survey.seed,
        "made_from": fingerprint(survey.plan, survey.seed),
        "gsd_m": survey.plan.gsd_m,
        "camera": {"name": camera.name, "parameters": camera.parameters.tolist()},
        "positions_map_m": {name: c.tolist() for name, c in zip(renamed, positions, strict=True)},
        "ground_points_map_m": {name: p.tolist() for name, p in zip(points.name, ground, strict=True)},
        "gnss_offset_m": {flight: offset.tolist() for flight, offset in survey.truth.gnss_offset_world_m.items()},
    }


def shuffled_names(survey: SimulatedSurvey) -> dict[str, str]:
    """Return a file name for each photograph that says nothing of its place in the flight."""
    rng = np.random.default_rng([survey.seed, 6])
    numbers = rng.choice(1_000_000, len(survey.photographs), replace=False)
    return {p.name: f"{n:06d}.JPG" for p, n in zip(survey.photographs, numbers, strict=True)}


def _marks(survey: SimulatedSurvey, photographs: Mapping[str, str | None]) -> Iterator[tuple[int, int, str]]:
    """Yield number, point and photograph's name of every mark, without those in photographs whose name is None."""
    points = survey.control_points
    for mark, (photograph, point) in enumerate(zip(points.mark_photograph, points.mark_point, strict=True)):
        original = survey.photographs[photograph].name
        name = photographs.get(original, original)
        if name is not None:
            yield mark, point, name


def write_control_list(path: Path, survey: SimulatedSurvey, role: Role, photographs: Mapping[str, str | None]) -> None:
    """Write the points of one role and their marks as an OpenDroneMap ``gcp_list.txt``: CRS, then x y z u v
    photograph name.

    ``photographs`` are the names of renamed photographs; None for one whose marks are left out.
    """
    points = survey.control_points
    position = survey.frame.map_from_world(points.position_world_m)
    lines = [survey.frame.crs]
    for mark, point, name in _marks(survey, photographs):
        if points.role[point] == role:
            place = " ".join(f"{x:.4f}" for x in position[point])
            pixel = " ".join(f"{x:.3f}" for x in points.mark_pixel[mark])
            lines.append(f"{place} {pixel} {name} {points.name[point]}")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_control_tables(folder: Path, survey: SimulatedSurvey, photographs: Mapping[str, str | None]) -> None:
    """Write all points with their sigmas and roles as ``points.csv``, and their marks as ``marks.csv``; the rest as in
    write_control_list."""
    points = survey.control_points
    position = survey.frame.map_from_world(points.position_world_m)
    rows = ["name,easting,northing,height,sigma_easting,sigma_northing,sigma_height,role"]
    for name, place, sigma, role in zip(points.name, position, points.sigma_m, points.role, strict=True):
        figures = ",".join([*(f"{x:.4f}" for x in place), *(f"{s:g}" for s in sigma)])
        rows.append(f"{name},{figures},{role}")
    marks = ["name,photograph,u,v,sigma"]
    for mark, point, photograph in _marks(survey, photographs):
        u, v = points.mark_pixel[mark]
        marks.append(f"{points.name[point]},{photograph},{u:.3f},{v:.3f},{points.mark_sigma_px[mark]:.4f}")
    for name, lines in (("points.csv", rows), ("marks.csv", marks)):
        with replacing(folder / name) as temporary:
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_survey(
    folder: Path | str,
    survey: SimulatedSurvey,
    pictures: Iterable[tuple[str, ByteArray]],
    *,
    names: Mapping[str, str] | None = None,
    foreign: Mapping[str, ByteArray] | None = None,
) -> None:
    """Write what a surveyor brings home: ``photographs/`` and the ground points twice over, as ``control.txt`` and
    ``check.txt`` (OpenDroneMap's lists) and as ``points.csv`` and ``marks.csv`` (tables); and ``truth.json``.

    ``pictures`` are those of render_photographs, names and pixels (height, width, 3), or as many of them as are wanted.
    ``names`` are other file names, of
    shuffled_names for example. Photographs in ``foreign`` show that picture instead, under their own tags: nothing but
    the picture tells that it is of another site. They carry no marks. Raises WorkspaceError where a file cannot be
    written.
    """
    folder = Path(folder)
    names = names or {}
    foreign = foreign or {}
    photographs = {p.name: p for p in survey.photographs}
    make_folder(folder / "photographs")
    for name, pixels in pictures:
        tags = photograph_tags(survey, photographs[name])
        write_photograph(folder / "photographs" / names.get(name, name), foreign.get(name, pixels), tags)
    marked = {name: None if name in foreign else names.get(name, name) for name in photographs}
    write_control_list(folder / "control.txt", survey, "control", marked)
    write_control_list(folder / "check.txt", survey, "check", marked)
    write_control_tables(folder, survey, marked)
    write_json(folder / "truth.json", truth_record(survey, names))
