"""The survey as it was measured: photographs, ground points and cameras in one frame, before anything is oriented.

`photogram check` and `photogram adjust` both assemble it here, from the same notes on the photographs.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from photogram.arrays import FloatArray, IntArray
from photogram.camera import rotation_from_gimbal
from photogram.constraints.rigs import Companion
from photogram.errors import ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import LocalFrame
from photogram.project.measured.measured_positions import MeasuredPosition, PositionNote, position_note
from photogram.project.project import Project, ProjectPhotograph, in_world
from photogram.project.rigs.grouping import Grouped, grouped, measured_by_master
from photogram.survey import Block, ControlPoints, Photograph, TiePoints

NO_TIE_POINTS = TiePoints(
    *(np.zeros(0, dtype=np.int64),) * 3,
    np.zeros((0, 2)),
    np.zeros(0),
    np.zeros((0, 3)),
    np.zeros((0, 3), dtype=np.uint8),
)

AROUND_M = 10.0
"""The origin of a frame may lie so far beside the survey: it is rounded to as much."""


class PhotographNote(PositionNote):
    """What project, files of positions and tags say of a photograph, as the first stage stores it."""

    name: str
    """Name of the photograph."""
    height_is_ellipsoidal: bool | None
    """Whether its tags call their height ellipsoidal, None where they do not say."""
    attitude_deg: list[float] | None
    """Yaw, pitch and roll of the gimbal, None where one is missing."""
    time: str | None
    """Time of exposure in ISO 8601, None where the tags tell none."""
    velocity_m_s: list[float] | None
    """Velocity along true north, true east and down, m/s, None where the tags tell none."""
    capture: str | None
    """Identifier of the exposure that cameras on one body share, None where the tags tell none."""
    height_above_ground_m: float | None
    """Flying height above ground, or above the place of take-off, None where it is not known."""


@dataclass(frozen=True, eq=False)
class MeasuredPhotographs:
    """What is known of the photographs before anything is oriented, in the world of ``frame``.

    ``original`` (F,) is the index of the photograph of which each is a copy, its own where it is none.
    """

    frame: LocalFrame
    photographs: tuple[Photograph, ...]
    original: IntArray


def _gimbal_deg(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[float, float, float] | None:
    """Return yaw, pitch and roll of a photograph: the project's before its tags', None where one is missing."""
    if photograph.attitude_deg is not None or tags is None:
        return photograph.attitude_deg
    yaw, pitch, roll = tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg
    return None if yaw is None or pitch is None or roll is None else (yaw, pitch, roll)


def photograph_note(
    photograph: ProjectPhotograph, tags: PhotographTags | None, position: MeasuredPosition | None
) -> PhotographNote:
    """Return what project and tags say of a photograph beside its ``position``, as it is stored; ``tags`` are None
    where they cannot be read."""
    angles = _gimbal_deg(photograph, tags)
    return {
        "name": photograph.name,
        **position_note(position),
        "height_is_ellipsoidal": None if tags is None else tags.height_is_ellipsoidal,
        "attitude_deg": None if angles is None else list(angles),
        "time": None if tags is None or tags.time is None else tags.time.isoformat(),
        "velocity_m_s": None if tags is None or tags.velocity_m_s is None else list(tags.velocity_m_s),
        "capture": None if tags is None else tags.capture,
        "height_above_ground_m": photograph.height_above_ground_m
        or (None if tags is None else tags.height_above_take_off_m),
    }


def _placing_map_m(project: Project, notes: Sequence[PhotographNote]) -> FloatArray:
    """Return the positions (N, 3) in the map that say where the survey is; NaN for what is no control."""
    # not the check points: they take no part in anything, the origin of the frame included
    positions = [p.control_map_m for p in project.control_points if p.role == "control"]
    positions += [np.array(note["gnss_map_m"]) for note in notes if note["gnss_map_m"] is not None]
    return np.array(positions).reshape(-1, 3)


def survey_frame(project: Project, notes: Sequence[PhotographNote]) -> LocalFrame | None:
    """Return the frame in which a survey is adjusted, None where neither control points nor GNSS positions say where it
    is. Raises FrameError as LocalFrame does."""
    positions = _placing_map_m(project, notes)
    known = np.isfinite(positions)
    if not known.any(axis=0).all():
        return LocalFrame.local() if project.crs == NO_CRS and not known.any() else None
    middle = np.nanmean(positions, axis=0)
    return LocalFrame.near(
        project.crs, np.where(known, positions, middle), project.world_kind, project.heights.map_geoid
    )


def is_amid(origin_map_m: Sequence[float] | FloatArray, project: Project, notes: Sequence[PhotographNote]) -> bool:
    """Return whether a frame of this origin (3,) serves the survey: whether it lies among control and GNSS positions,
    or not more than AROUND_M beside them."""
    positions = _placing_map_m(project, notes)
    if not np.isfinite(positions).any(axis=0).all():
        return False
    low, high = np.nanmin(positions, axis=0) - AROUND_M, np.nanmax(positions, axis=0) + AROUND_M
    origin = np.asarray(origin_map_m)
    return bool(np.all((low <= origin) & (origin <= high)))


def measured_arrays(photographs: Sequence[Photograph]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return GNSS positions (F, 3) in the world, their sigmas (F, 3), and attitudes (F, 3, 3), world from camera; NaN
    where there is none."""
    nowhere, unturned = np.full(3, np.nan), np.full((3, 3), np.nan)
    world = [nowhere if p.gnss_world_m is None else p.gnss_world_m for p in photographs]
    sigma = [nowhere if p.gnss_sigma_m is None else p.gnss_sigma_m for p in photographs]
    attitude = [unturned if (R := p.attitude_world_from_camera) is None else R for p in photographs]
    return np.array(world).reshape(-1, 3), np.array(sigma).reshape(-1, 3), np.array(attitude).reshape(-1, 3, 3)


def measured_photographs(
    project: Project, notes: Sequence[PhotographNote], frame: LocalFrame | None = None
) -> MeasuredPhotographs:
    """Return the photographs as their notes (``photograph_note``) give them, in ``frame``, else in that of the survey.

    Raises ProjectError where nothing says where the survey is, FrameError where a position lies outside the CRS.
    """
    frame = frame or survey_frame(project, notes)
    if frame is None:
        raise ProjectError(
            f"{project.path}: neither control points nor GNSS positions: the survey cannot be georeferenced; "
            "give control_points, photographs with GNSS tags, or crs: none for a free network"
        )
    nowhere = (np.nan,) * 3
    stated_map_m = np.array([note["gnss_map_m"] or nowhere for note in notes], dtype=np.float64).reshape(-1, 3)
    photographs = tuple(
        _photograph(source, frame, world_m if np.isfinite(world_m).all() else None, note)
        for source, world_m, note in zip(project.photographs, in_world(frame, stated_map_m), notes, strict=True)
    )
    numbers = {photograph.name: i for i, photograph in enumerate(project.photographs)}
    original = [numbers[note.get("copy_of") or note["name"]] for note in notes]
    measured = MeasuredPhotographs(frame, photographs, np.array(original, dtype=np.int64))
    if project.rigs:
        photographs = measured_by_master(photographs, _grouped(project, measured).companions)
    return replace(measured, photographs=photographs)


def _photograph(
    source: ProjectPhotograph, frame: LocalFrame, gnss_world_m: FloatArray | None, note: PhotographNote
) -> Photograph:
    gnss = gnss_world_m
    place = np.zeros(3) if gnss is None else gnss
    attitude = velocity = None
    if note["velocity_m_s"] is not None:
        north, east, down = note["velocity_m_s"]
        velocity = frame.rotation_world_from_true(place) @ [east, north, -down]
    if note["attitude_deg"] is not None:
        attitude = frame.rotation_world_from_true(place) @ rotation_from_gimbal(*note["attitude_deg"])
    if gnss is not None and note.get("lever_arm_enu_m") is not None:
        gnss = gnss + frame.rotation_world_from_true(gnss) @ np.array(note["lever_arm_enu_m"])
    arm, time = note.get("lever_arm_camera_m"), note.get("time")
    return Photograph(
        source.name,
        source.camera,
        source.path,
        source.flight,
        None if time is None else datetime.fromisoformat(time),
        gnss,
        None if gnss is None else np.array(note["gnss_sigma_m"]),
        attitude,
        None if attitude is None else float(np.deg2rad(source.attitude_sigma_deg)),
        note["height_above_ground_m"],
        lever_arm_camera_m=None if arm is None else np.array(arm),
        gnss_sigma_assumed=gnss is not None and note.get("gnss_sigma_assumed", False),
        velocity_world_m_s=velocity,
        capture=note.get("capture"),
    )


def _on_originals(points: ControlPoints, original: IntArray) -> ControlPoints:
    """Return ground points whose marks in copies of a photograph are moved to the photograph itself, unless the point
    is marked there already."""
    own = original[points.mark_photograph] == points.mark_photograph
    order = np.argsort(~own, kind="stable")  # marks in the photograph itself come before those in its copies
    place = np.column_stack([original[points.mark_photograph], points.mark_point])[order]
    kept = np.sort(order[np.unique(place, axis=0, return_index=True)[1]])
    return replace(
        points,
        mark_photograph=original[points.mark_photograph[kept]],
        mark_point=points.mark_point[kept],
        mark_pixel=points.mark_pixel[kept],
        mark_covariance_px2=points.mark_covariance_px2[kept],
    )


def _grouped(project: Project, measured: MeasuredPhotographs) -> Grouped:
    duplicates = np.flatnonzero(measured.original != np.arange(len(measured.original))).tolist()
    return grouped(project.rigs, measured.photographs, duplicates)


def companions_of(project: Project, measured: MeasuredPhotographs) -> tuple[Companion, ...]:
    """Return the cameras that are fixed to another on one body, with their exposures. Raises ProjectError where these
    are ambiguous, or there are none."""
    if not project.rigs:
        return ()
    rigs = _grouped(project, measured)
    if rigs.errors:
        raise ProjectError("\n".join(f"{project.path}: {error}" for error in rigs.errors))
    return rigs.companions


def block_of(project: Project, measured: MeasuredPhotographs) -> Block:
    """Return the block of measured photographs and the project's ground points: no poses, no tie points.

    A photograph that is there twice has its marks once. Raises FrameError where a ground point lies outside the CRS,
    ProjectError where the photographs of a rig are no exposures.
    """
    points = project.control_points_in(measured.frame)
    if np.any(measured.original != np.arange(len(measured.original))):
        points = _on_originals(points, measured.original)
    return Block(
        measured.frame,
        project.cameras,
        measured.photographs,
        (None,) * len(measured.photographs),
        NO_TIE_POINTS,
        points,
        project.common_gnss_sigma_m,
        project.datum_sigma_m,
        constraints=project.constraints,
        rigs=companions_of(project, measured),
    )


def measured_block(project: Project, notes: Sequence[PhotographNote], frame: LocalFrame | None = None) -> Block:
    """Return the block as project and notes give it: no poses, no tie points. Raises as ``measured_photographs`` and
    ``block_of``."""
    return block_of(project, measured_photographs(project, notes, frame))
