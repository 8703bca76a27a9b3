"""The measured position of each photograph: which source gives it, how good it may be believed to be, and where the
camera is from its antenna.

The project's own position comes first, then that of a file of positions, then the one in the tags. A standard deviation
is never believed to be better than the kind of solution allows (gnss_solutions.FLOOR_M).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import rotation_from_gimbal
from photogram.errors import ProjectError
from photogram.files.photographs.tags import PhotographTags
from photogram.frames import map_from_geodetic, map_heights
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
    counted. ``of_antenna`` says that the position is known to be the antenna's.
    """

    map_m: FloatArray
    source: str
    solution: Solution
    sigma_m: Sigma3
    stated_m: Sigma3
    of_antenna: bool = False
    arm_enu_m: FloatArray | None = None
    arm_camera_m: FloatArray | None = None

    @property
    def overstated(self) -> bool:
        """Return whether more was claimed of a solution without fixed ambiguities than can be believed."""
        return claims_too_much(self.solution, self.sigma_m, self.stated_m)

    @property
    def lacks_arm(self) -> bool:
        """Return whether this is known to be the antenna's position, and not where the camera is from it."""
        return self.of_antenna and self.arm_enu_m is None and self.arm_camera_m is None


def claims_too_much(solution: Solution, believed_m: Sigma3, stated_m: Sigma3) -> bool:
    """Return whether a float or single solution was stated so well that less is believed: OVERSTATED times less along
    some axis, so that a figure just below the floor is no reason to warn."""
    worse = any(b > OVERSTATED * s for b, s in zip(believed_m, stated_m, strict=True))
    return solution in ("float", "single") and worse


def tagged_position_map_m(project: Project, tags: PhotographTags) -> FloatArray | None:
    """Return the position (3,) in a photograph's tags in the map, None where there is none. Raises FrameError where it
    lies outside the CRS."""
    if tags.longitude_deg is None or tags.latitude_deg is None or tags.height_m is None:
        return None
    geodetic = np.array([[tags.longitude_deg, tags.latitude_deg, tags.height_m]])
    system = project.heights.of_tags(tags.height_is_ellipsoidal)
    return np.asarray(map_heights(project.crs, project.heights, system, map_from_geodetic(project.crs, geodetic))[0])


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
    read = None
    if photograph.gnss_map_m is None:
        read = listed.sigma_m if listed is not None else None if tags is None else tags.gnss_sigma_m
    stated = given if given is not None and (photograph.own_sigma or listed is None) else read or given
    if stated is None:
        return None, None
    believed = at_least(stated, FLOOR_M[solution])
    if solution in ("float", "single") and read is not None and not photograph.own_sigma:
        believed = at_least(believed, read)
    return believed, stated


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
        and (photograph.file_position is None or photograph.file_position.lever_arm_m is None)
        and _body_attitude(photograph, tags) is None
    )


def _is_antennas(photograph: ProjectPhotograph) -> bool:
    """Return whether a position is the antenna's: as its file says, or, of others, where a lever arm is given."""
    if photograph.gnss_map_m is None and photograph.file_position is not None:
        return photograph.file_position.position_of == "antenna"
    return photograph.lever_arm_m is not None


def _arms(photograph: ProjectPhotograph, tags: PhotographTags | None) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the lever arm (3,) along true east, north and up, or along the camera's axes; None for what is not."""
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
        raise ProjectError(
            f"photograph {photograph.name}: its lever arm is given in the axes of the aircraft, but neither "
            "its tags nor a position file give the aircraft's yaw, pitch and roll: where the camera is fixed "
            "to look down "
            "give gnss.lever_arm_axes: camera"
        )
    # the angles of an aircraft turn its body as those of a gimbal turn the camera, which has right, down and forward
    return rotation_from_gimbal(*attitude) @ np.array([right, down, forward]), None


def measured_position(project: Project, photograph: ProjectPhotograph, tags: PhotographTags) -> MeasuredPosition | None:
    """Return the measured position of a photograph, None where nothing gives one.

    Raises FrameError where the tags' lies outside the CRS, ProjectError where it has no standard deviation, or a lever
    arm cannot be turned.
    """
    source = source_of(photograph, tags)
    if source is None:
        return None
    place = photograph.gnss_map_m
    if place is None and photograph.file_position is not None:
        place = photograph.file_position.position_map_m
    elif place is None:
        place = tagged_position_map_m(project, tags)
    believed, stated = sigmas_of(photograph, tags)
    if place is None or believed is None or stated is None:
        where = "the tags" if source == FROM_TAGS else source
        raise ProjectError(
            f"photograph {photograph.name}: its GNSS position has no sigma, neither in {where} nor in the project: "
            "give photographs.gnss_sigma_m (0.02 to 0.05 m with RTK, 2 to 5 m without)"
        )
    enu, camera = _arms(photograph, tags)
    return MeasuredPosition(
        place, source, solution_of(photograph, tags), believed, stated, _is_antennas(photograph), enu, camera
    )


def position_note(measured: MeasuredPosition | None) -> dict[str, object]:
    """Return a measured position as JSON."""
    if measured is None:
        return {"gnss_map_m": None, "gnss_sigma_m": None}
    return {
        "gnss_map_m": measured.map_m.tolist(),
        "gnss_sigma_m": list(measured.sigma_m),
        "gnss_source": measured.source,
        "gnss_solution": measured.solution,
        "gnss_stated_sigma_m": list(measured.stated_m) if measured.overstated else None,
        "gnss_lacks_lever_arm": measured.lacks_arm,
        "lever_arm_enu_m": None if measured.arm_enu_m is None else measured.arm_enu_m.tolist(),
        "lever_arm_camera_m": None if measured.arm_camera_m is None else measured.arm_camera_m.tolist(),
    }
