"""The measured block as `photogram check` looks at it: where the photographs are, where they look, and how high they
fly."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.arrays import BoolArray, FloatArray
from photogram.files.photographs.placeholders import stray_zero_heights
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.frames import LocalFrame
from photogram.project.cross_checks import AreaOfUse
from photogram.project.measured.measured_block import measured_arrays, measured_block, photograph_note, survey_frame
from photogram.project.measured.measured_positions import known_position, positions_map_m
from photogram.project.measured.unmeasured import withdraw_placeholders
from photogram.project.positions.frozen import frozen_positions
from photogram.project.project import Project
from photogram.survey import Block, ControlPoints


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
    captures = [None if t is None else t.capture for t in tags]
    return frozen_positions(stated_map_m, [None if t is None else t.time for t in tags], captures)


def of_tags(project: Project) -> BoolArray:
    """Return the positions of which photographs (F,) can only come from their tags."""
    return np.array([p.gnss_map_m is None and p.file_position is None for p in project.photographs], dtype=bool)


def gnss_positions(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return the measured GNSS position (F, 3) of each photograph in the map, NaN where there is none, where the
    receiver has stopped, or the height is no measurement. Raises FrameError where the tags' lie outside the CRS."""
    position = stated_positions(project, tags)
    position[frozen_photographs(tags, position) | (stray_zero_heights(tags) & of_tags(project))] = np.nan
    return position


def stated_positions(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return the GNSS position (F, 3) of each photograph in the map, as ``positions_map_m``."""
    return positions_map_m(project, project.photographs, tags)


def tagged_survey(project: Project, tags: Sequence[PhotographTags | None], gnss_map_m: FloatArray) -> Block | None:
    """Return the measured block of a survey by its tags and its positions (F, 3) in the map, None where nothing says
    where it is. Raises FrameError as LocalFrame does."""
    notes = [
        photograph_note(photograph, tag, known_position(photograph, tag, position))
        for photograph, tag, position in zip(project.photographs, tags, gnss_map_m, strict=True)
    ]
    withdraw_placeholders(project, notes, tags)
    control_map_m = control_positions(project)
    frame = survey_frame(project, notes)
    if frame is None and len(control_map_m):  # check points alone adjust nothing, but there is something to say of them
        frame = LocalFrame.near(project.crs, control_map_m, project.world_kind, project.heights.map_geoid)
    return None if frame is None else measured_block(project, notes, frame)


def measured_survey(
    project: Project, tags: Sequence[PhotographTags | None], gnss_map_m: FloatArray
) -> MeasuredSurvey | None:
    """Return what is known of the survey's geometry, None where nothing says where it is: the measured block as arrays.
    Raises FrameError as LocalFrame does."""
    block, control_map_m = tagged_survey(project, tags, gnss_map_m), control_positions(project)
    if block is None:
        return None
    photographs = block.photographs
    heights = [p.height_above_ground_m for p in photographs]
    height_m = np.array([h if h is not None and h > 0 else np.nan for h in heights])
    if len(control_map_m):
        over_control = gnss_map_m[:, 2] - np.median(control_map_m[:, 2])
        height_m = np.where(np.isnan(height_m) & (over_control > 0), over_control, height_m)
    cameras = [block.cameras[p.camera] for p in photographs]
    spread = np.array([np.hypot(c.width_px, c.height_px) / c.focal_px for c in cameras])
    return MeasuredSurvey(
        block.frame, gnss_map_m, *measured_arrays(photographs), height_m, height_m * spread, block.control_points
    )


def usable_survey(project: Project, tags: Sequence[PhotographTags | None]) -> MeasuredSurvey | None:
    """Return ``measured_survey`` without the positions far outside the area where the project's CRS is used, None where
    nothing says where the survey is. Raises FrameError as ``gnss_positions`` and LocalFrame do."""
    return measured_survey(project, tags, usable_positions(project, tags))


def usable_positions(project: Project, tags: Sequence[PhotographTags | None]) -> FloatArray:
    """Return ``gnss_positions`` (F, 3), NaN too for those far outside the area where the project's CRS is used. Raises
    FrameError as that does."""
    gnss_map_m = gnss_positions(project, tags)
    gnss_map_m[foreign_positions(project, gnss_map_m)] = np.nan
    return gnss_map_m


def foreign_positions(project: Project, gnss_map_m: FloatArray) -> BoolArray:
    """Return which GNSS positions (F,) lie far outside the area where the project's CRS is used."""
    area = AreaOfUse.of(project.crs)
    known = np.asarray(np.isfinite(gnss_map_m).all(axis=1))
    return known & ~area.contains(gnss_map_m[:, :2]) if area is not None else np.zeros(len(known), dtype=bool)


def control_positions(project: Project) -> FloatArray:
    """Return the positions (N, 3) of the ground points in the map."""
    return np.array([p.position_map_m for p in project.control_points]).reshape(-1, 3)
