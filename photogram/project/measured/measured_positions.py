"""The measured position of each photograph: which source gives it, how good it may be believed to be, and where the
camera is from its antenna.

The project's own position comes first, then that of a file of positions, then the one in the tags. A standard deviation
is never believed to be better than the kind of solution allows (gnss_solutions.FLOOR_M).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NotRequired

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.geodesy.crs import NO_CRS
from photogram.geodesy.frames import map_from_geodetic, map_heights
from photogram.gnss import FLOOR_M, Sigma3, Solution, at_least, solution_of_rtk_flag
from photogram.project.project import Project, ProjectPhotograph

FROM_TAGS, FROM_PROJECT = "tags", "project"
OVERSTATED = 2.0


@dataclass(frozen=True, eq=False)
class MeasuredPosition:
    """The measured position (3,) of one photograph in the map, and what is known of it.

    ``source`` is FROM_PROJECT, FROM_TAGS, or the file of positions. ``sigma_m`` is what is believed, ``stated_m`` what
    was stated. The lever arm from the antenna to the camera lies along true east,
    north and up (``arm_enu_m``) or along the camera's axes (``arm_camera_m``); both are None where there is none to be
    counted. ``of_antenna`` says that the position is known to be the antenna's,
    ``sigma_assumed`` that nobody has stated its standard deviations.
    """

    map_m: FloatArray
    source: str
    solution: Solution
    sigma_m: Sigma3
    stated_m: Sigma3
    of_antenna: bool = False
    arm_enu_m: FloatArray | None = None
    arm_camera_m: FloatArray | None = None
    sigma_assumed: bool = False

    @property
    def overstated(self) -> bool:
        """Return whether more was claimed of a solution without fixed ambiguities than can be believed."""
        return claims_too_much(self.solution, self.sigma_m, self.stated_m)

    @property
    def lacks_arm(self) -> bool:
        """Return whether this is known to be the antenna's position, and not where the camera is from it."""
        return self.of_antenna and self.arm_enu_m is None and self.arm_camera_m is None


class PositionNote(TypedDict):
    """A measured position as the first stage stores it; where there is none, ``gnss_map_m`` and ``gnss_sigma_m`` are
    None and nothing is noted but why."""

    gnss_map_m: list[float] | None
    """Position in the map: easting, northing, height."""
    gnss_sigma_m: list[float] | None
    """Standard deviations that are believed: east, north, up."""
    gnss_source: NotRequired[str]
    """What gives the position: FROM_PROJECT, FROM_TAGS, or the file of positions."""
    gnss_solution: NotRequired[Solution]
    """Kind of solution."""
    gnss_stated_sigma_m: NotRequired[list[float] | None]
    """Standard deviations that were stated: east, north, up; None where they are believed."""
    gnss_sigma_assumed: NotRequired[bool]
    """Whether nobody has stated the standard deviations."""
    gnss_lacks_lever_arm: NotRequired[bool]
    """Whether it is known to be the antenna's position, and not where the camera is from it."""
    lever_arm_enu_m: NotRequired[list[float] | None]
    """Lever arm from the antenna to the camera along true east, north and up, None where there is none of this kind."""
    lever_arm_camera_m: NotRequired[list[float] | None]
    """Lever arm from the antenna to the camera along its axes x, y, z, None where there is none of this kind."""
    gnss_frozen: NotRequired[bool]
    """Whether a position is not used because the receiver had stopped."""
    copy_of: NotRequired[str]
    """Name of the photograph of which this is a copy, which then measures nothing."""


def claims_too_much(solution: Solution, believed_m: Sigma3, stated_m: Sigma3) -> bool:
    """Return whether a float or single solution was stated so well that less is believed: OVERSTATED times less along
    some axis, so that a figure just below the floor is no reason to warn."""
    worse = any(b > OVERSTATED * s for b, s in zip(believed_m, stated_m, strict=True))
    return solution in ("float", "single") and worse


def positions_map_m(
    project: Project, photographs: Sequence[ProjectPhotograph], tags: Sequence[PhotographTags | None]
) -> FloatArray:
    """Return the measured position (F, 3) of each photograph in the map: the project's before that of a file of
    positions before its tags', NaN where there is none; tags say nothing in a local frame. Raises FrameError where the
    tags' lie outside the CRS."""
    nothing = (np.nan,) * 3
    geodetic = np.array(
        [
            nothing
            if t is None or project.crs == NO_CRS or source_of(p, t) != FROM_TAGS
            else (t.longitude_deg, t.latitude_deg, t.height_m)
            for p, t in zip(photographs, tags, strict=True)
        ],
        dtype=np.float64,
    ).reshape(-1, 3)
    position = np.full(geodetic.shape, np.nan)
    tagged = np.isfinite(geodetic).all(axis=1)
    systems = [None if t is None else project.heights.of_tags(t.height_is_ellipsoidal) for t in tags]
    for system in dict.fromkeys(systems):
        own = tagged & np.array([s == system for s in systems], dtype=bool)
        if own.any():
            plan = map_from_geodetic(project.crs, geodetic[own], project.datum.grid)
            position[own] = map_heights(project.crs, project.heights, system, plan)
    for i, photograph in enumerate(photographs):
        if photograph.gnss_map_m is not None:
            position[i] = photograph.gnss_map_m
        elif photograph.file_position is not None:
            position[i] = photograph.file_position.position_map_m
    return position


def source_of(photograph: ProjectPhotograph, tags: PhotographTags | None) -> str | None:
    """Return what gives a photograph its position: FROM_PROJECT, a file, FROM_TAGS, or None where nothing does."""
    if photograph.gnss_map_m is not None:
        return FROM_PROJECT
    if photograph.file_position is not None:
        return photograph.file_position.source
    tagged = tags is not None and None not in (tags.longitude_deg, tags.latitude_deg, tags.height_m)
    return FROM_TAGS if tagged else None


def solution_of(photograph: ProjectPhotograph, tags: PhotographTags | None) -> Solution:
    """Return the kind of solution that a photograph's position is, as its source says."""
    if photograph.gnss_map_m is not None:
        return "unknown"
    if photograph.file_position is not None:
        return photograph.file_position.solution
    return "unknown" if tags is None else solution_of_rtk_flag(tags.rtk_flag)


def sigmas_of(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[Sigma3 | None, Sigma3 | None]:
    """Return the standard deviations of a photograph's position that are believed, and those that are stated.

    The photograph's own come first, then those of a file of positions, then those of the whole project, then the tags'.
    None where there are none. Of a float solution or a single receiver the project's figure for all photographs is not
    believed where the tags state worse, and no statement below FLOOR_M.
    """
    given = None if photograph.gnss_sigma_m is None else _sigma3(photograph.gnss_sigma_m)
    listed, solution = photograph.file_position, solution_of(photograph, tags)
    read = _read_sigma(photograph, tags)
    stated = given if given is not None and (photograph.own_sigma or listed is None) else read or given
    if stated is None:
        return None, None
    believed = at_least(stated, FLOOR_M[solution])
    if solution in ("float", "single") and read is not None and not photograph.own_sigma:
        believed = at_least(believed, read)
    return believed, stated


def _read_sigma(photograph: ProjectPhotograph, tags: PhotographTags | None) -> Sigma3 | None:
    """Return the standard deviations that a file of positions or else the tags state of a photograph's position."""
    if photograph.gnss_map_m is not None:
        return None
    if photograph.file_position is not None:
        return photograph.file_position.sigma_m
    return None if tags is None else tags.gnss_sigma_m


def _sigma3(values: FloatArray) -> Sigma3:
    east, north, up = (float(v) for v in values)
    return east, north, up


def _body_attitude(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[float, float, float] | None:
    listed = photograph.file_position
    if listed is not None and listed.attitude_deg is not None:
        return listed.attitude_deg
    if tags is None:
        return None
    yaw, pitch, roll = tags.flight_yaw_deg, tags.flight_pitch_deg, tags.flight_roll_deg
    return None if yaw is None or pitch is None or roll is None else (yaw, pitch, roll)


def needs_attitude(photograph: ProjectPhotograph, tags: PhotographTags | None) -> bool:
    """Return whether a lever arm in the axes of the aircraft is to be counted, whose attitude nothing tells."""
    return (
        _is_antennas(photograph)
        and photograph.lever_arm_m is not None
        and photograph.lever_arm_axes == "body"
        and (
            photograph.gnss_map_m is not None
            or photograph.file_position is None
            or photograph.file_position.lever_arm_m is None
        )
        and _body_attitude(photograph, tags) is None
    )


def _is_antennas(photograph: ProjectPhotograph) -> bool:
    """Return whether a position is the antenna's: as its file says, or, of others, where a lever arm is given."""
    if photograph.gnss_map_m is None and photograph.file_position is not None:
        return photograph.file_position.position_of == "antenna"
    return photograph.lever_arm_m is not None


def _arms(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the lever arm (3,) along true east, north and up, or along the camera's axes; None for what is not, or
    cannot be turned (``needs_attitude``)."""
    if not _is_antennas(photograph):
        return None, None
    listed = photograph.file_position
    if photograph.gnss_map_m is None and listed is not None and listed.lever_arm_m is not None:
        return np.array(listed.lever_arm_m), None
    if photograph.lever_arm_m is None:
        return None, None
    forward, right, down = photograph.lever_arm_m
    if photograph.lever_arm_axes == "camera":
        # a camera that looks down with its top forward: x right, y backward, z down
        return None, np.array([right, -forward, down])
    attitude = _body_attitude(photograph, tags)
    if attitude is None:
        return None, None
    # the angles of an aircraft turn its body as those of a gimbal turn the camera, which has right, down and forward
    return rotation_from_gimbal(*attitude) @ np.array([right, down, forward]), None


def known_position(
    photograph: ProjectPhotograph, tags: PhotographTags | None, map_m: FloatArray
) -> MeasuredPosition | None:
    """Return what is known of a photograph's position ``map_m`` (3,), None where that is not a number.

    Where nothing states its standard deviation that is NaN, and a lever arm that cannot be turned is left out.
    """
    source = source_of(photograph, tags)
    if source is None or not np.isfinite(map_m).all():
        return None
    believed, stated = sigmas_of(photograph, tags)
    nothing = (np.nan,) * 3
    solution, of_antenna = solution_of(photograph, tags), _is_antennas(photograph)
    assumed = photograph.gnss_sigma_assumed and _read_sigma(photograph, tags) is None
    return MeasuredPosition(
        map_m, source, solution, believed or nothing, stated or nothing, of_antenna, *_arms(photograph, tags), assumed
    )


def measured_position(project: Project, photograph: ProjectPhotograph, tags: PhotographTags) -> MeasuredPosition | None:
    """Return the measured position of a photograph, None where nothing gives one.

    Raises FrameError where the tags' lies outside the CRS, ProjectError where it has no standard deviation, or a lever
    arm cannot be turned.
    """
    position = known_position(photograph, tags, positions_map_m(project, [photograph], [tags])[0])
    if position is None:
        return None
    if np.isnan(position.sigma_m).any():
        where = "the tags" if position.source == FROM_TAGS else position.source
        raise ProjectError(
            f"photograph {photograph.name}: its GNSS position has no sigma, neither in {where} nor in the project: "
            "give photographs.gnss_sigma_m (0.02 to 0.05 m with RTK, 2 to 5 m without)"
        )
    if needs_attitude(photograph, tags):
        raise ProjectError(
            f"photograph {photograph.name}: its lever arm is given in the axes of the aircraft, but neither "
            "its tags nor a position file give the aircraft's yaw, pitch and roll: where the camera is fixed "
            "to look down "
            "give gnss.lever_arm_axes: camera"
        )
    return position


def position_note(measured: MeasuredPosition | None) -> PositionNote:
    """Return a measured position as it is stored, None where there is none."""
    if measured is None:
        return {"gnss_map_m": None, "gnss_sigma_m": None}
    return {
        "gnss_map_m": measured.map_m.tolist(),
        "gnss_sigma_m": list(measured.sigma_m),
        "gnss_source": measured.source,
        "gnss_solution": measured.solution,
        "gnss_stated_sigma_m": list(measured.stated_m) if measured.overstated else None,
        "gnss_sigma_assumed": measured.sigma_assumed,
        "gnss_lacks_lever_arm": measured.lacks_arm,
        "lever_arm_enu_m": None if measured.arm_enu_m is None else measured.arm_enu_m.tolist(),
        "lever_arm_camera_m": None if measured.arm_camera_m is None else measured.arm_camera_m.tolist(),
    }
