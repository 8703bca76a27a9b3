"""What project and tags say of the photographs before anything is adjusted: where they are, where they look, and how
high they fly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.files.photographs.tags import PhotographTags
from photogram.frames import LocalFrame, map_from_geodetic, map_heights
from photogram.project.cross_checks import AreaOfUse
from photogram.project.measured_positions import FROM_TAGS, sigmas_of, source_of
from photogram.project.positions.frozen import frozen_positions
from photogram.project.project import Project, ProjectPhotograph
from photogram.survey import ControlPoints


@dataclass(frozen=True, eq=False)
class MeasuredSurvey:
    """What project and tags say of the photographs; NaN where they say nothing.

    ``gnss_map_m`` and ``gnss_world_m`` (F, 3) are positions, ``gnss_sigma_m`` (F, 3) their sigmas; ``rotation``
    (F, 3, 3) the attitude, world from camera; ``flying_height_m`` (F,) above ground, or above the place of take-off;
    ``footprint_m`` (F,) the diagonal of the ground that a photograph shows.
    """

    frame: LocalFrame
    gnss_map_m: FloatArray
    gnss_world_m: FloatArray
    gnss_sigma_m: FloatArray
    rotation: FloatArray
    flying_height_m: FloatArray
    footprint_m: FloatArray
    control: ControlPoints

    @property
    def positioned(self) -> BoolArray:
        """Return which photographs (F,) have a GNSS position."""
        return np.asarray(np.isfinite(self.gnss_map_m).all(axis=1))


def frozen_photographs(tags: Sequence[PhotographTags | None], stated_map_m: FloatArray) -> BoolArray:
    """Return which of the positions (F, 3) of a receiver that has stopped are not measured ones."""
    return frozen_positions(stated_map_m, [None if t is None else t.time for t in tags])


def gnss_positions(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return the measured GNSS position (F, 3) of each photograph in the map, NaN where there is none, or where the
    receiver has stopped. Raises FrameError where the tags' lie outside the CRS."""
    position = stated_positions(project, tags)
    position[frozen_photographs(tags, position)] = np.nan
    return position


def stated_positions(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return the GNSS position (F, 3) of each photograph in the map, the project's before those of files before its
    tags', NaN where there is none. Raises FrameError where the tags' lie outside the CRS."""
    nothing = (np.nan,) * 3
    geodetic = np.array(
        [
            nothing if t is None or source_of(p, t) != FROM_TAGS else (t.longitude_deg, t.latitude_deg, t.height_m)
            for p, t in zip(project.photographs, tags, strict=True)
        ],
        dtype=np.float64,
    ).reshape(-1, 3)
    position = np.full(geodetic.shape, np.nan)
    tagged = np.isfinite(geodetic).all(axis=1)
    systems = [None if t is None else project.heights.of_tags(t.height_is_ellipsoidal) for t in tags]
    for system in dict.fromkeys(systems):
        own = tagged & np.array([s == system for s in systems], dtype=bool)
        if own.any():
            plan = map_from_geodetic(project.crs, geodetic[own])
            position[own] = map_heights(project.crs, project.heights, system, plan)
    for i, photograph in enumerate(project.photographs):
        if photograph.gnss_map_m is not None:
            position[i] = photograph.gnss_map_m
        elif photograph.file_position is not None:
            position[i] = photograph.file_position.position_map_m
    return position


def _sigma(photograph: ProjectPhotograph, tags: PhotographTags | None) -> Sequence[float]:
    return sigmas_of(photograph, tags)[0] or (np.nan,) * 3


def _height(photograph: ProjectPhotograph, tags: PhotographTags | None) -> float:
    height = photograph.height_above_ground_m or (None if tags is None else tags.height_above_take_off_m)
    return height if height is not None and height > 0 else np.nan


def _angles(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[float, float, float] | None:
    if photograph.attitude_deg is not None or tags is None:
        return photograph.attitude_deg
    yaw, pitch, roll = tags.gimbal_yaw_deg, tags.gimbal_pitch_deg, tags.gimbal_roll_deg
    return None if yaw is None or pitch is None or roll is None else (yaw, pitch, roll)


def measured_survey(
    project: Project, tags: Sequence[PhotographTags | None], gnss_map_m: FloatArray
) -> MeasuredSurvey | None:
    """Return what is known of the survey's geometry, None where nothing says where it is. Raises FrameError as
    LocalFrame does."""
    known = np.asarray(np.isfinite(gnss_map_m).all(axis=1))
    control_map_m = control_positions(project)
    places = np.vstack([gnss_map_m[known], control_map_m])
    if not len(places):
        return None
    frame = LocalFrame.near(project.crs, places, project.world_kind, project.heights.map_geoid)
    world = np.full(gnss_map_m.shape, np.nan)
    world[known] = frame.world_from_map(gnss_map_m[known])
    pairs = list(zip(project.photographs, tags, strict=True))
    rotation = np.full((len(pairs), 3, 3), np.nan)
    for i, angles in enumerate(_angles(*pair) for pair in pairs):
        if angles is not None:
            place = world[i] if known[i] else np.zeros(3)
            rotation[i] = frame.rotation_world_from_true(place) @ rotation_from_gimbal(*angles)
    height = np.array([_height(*pair) for pair in pairs])
    if len(control_map_m):
        over_control = gnss_map_m[:, 2] - np.median(control_map_m[:, 2])
        height = np.where(np.isnan(height) & (over_control > 0), over_control, height)
    cameras = [project.cameras[p.camera] for p in project.photographs]
    spread = np.array([np.hypot(c.width_px, c.height_px) / c.focal_px for c in cameras])
    sigma = np.array([_sigma(*pair) for pair in pairs], dtype=np.float64).reshape(-1, 3)
    return MeasuredSurvey(
        frame, gnss_map_m, world, sigma, rotation, height, height * spread, project.control_points_in(frame)
    )


def usable_survey(project: Project, tags: Sequence[PhotographTags | None]) -> MeasuredSurvey | None:
    """Return ``measured_survey`` without the positions far outside the area where the project's CRS is used, None where
    nothing says where the survey is. Raises FrameError as ``gnss_positions`` and LocalFrame do."""
    gnss_map_m = gnss_positions(project, tags)
    gnss_map_m[foreign_positions(project, gnss_map_m)] = np.nan
    return measured_survey(project, tags, gnss_map_m)


def foreign_positions(project: Project, gnss_map_m: FloatArray) -> BoolArray:
    """Return which GNSS positions (F,) lie far outside the area where the project's CRS is used."""
    area = AreaOfUse.of(project.crs)
    known = np.asarray(np.isfinite(gnss_map_m).all(axis=1))
    return known & ~area.contains(gnss_map_m[:, :2]) if area is not None else np.zeros(len(known), dtype=bool)


def control_positions(project: Project) -> FloatArray:
    """Return the positions (N, 3) of the ground points in the map."""
    return np.array([p.position_map_m for p in project.control_points]).reshape(-1, 3)
