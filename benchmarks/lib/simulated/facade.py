"""A simulated survey turned and scaled rigidly: a site photographed from above becomes a facade photographed sideways.

Nothing in the photographs says which way is down, so those that were rendered from above serve; positions, attitudes
and ground points are turned with the site, and lengths scaled with it.
"""

from dataclasses import replace

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Pose
from photogram.simulation.simulated_survey import SimulatedSurvey


def upright_rotation(facing_deg: float, tilt_deg: float = 90.0) -> FloatArray:
    """Return the rotation (3, 3) that sets a site up: what was up faces ``facing_deg`` from north, and the site leans
    ``tilt_deg`` from level, its former north upwards."""
    facing, tilt = np.deg2rad(facing_deg), np.deg2rad(tilt_deg)
    out = np.array([np.sin(facing), np.cos(facing), 0.0])
    normal = np.sin(tilt) * out + np.cos(tilt) * np.array([0.0, 0.0, 1.0])
    right = np.cross([0.0, 0.0, 1.0], out)
    return np.column_stack([right, np.cross(normal, right), normal])


def turned_survey(
    survey: SimulatedSurvey, rotation: FloatArray, scale: float = 1.0, shift_m: tuple[float, float, float] = (0, 0, 0)
) -> SimulatedSurvey:
    """Return a survey whose world is turned by a rotation (3, 3), scaled and shifted: measurements and truth, their
    standard deviations scaled alike.

    The scene and the photographs that ``render_photographs`` makes stay those of the given survey: render that.
    Heights above take-off, which a turned flight has not, are left out. Raises ValueError where standard
    deviations along the axes differ: turned, they would no longer be along the axes.
    """

    def place(points: FloatArray) -> FloatArray:
        return np.asarray(scale * points @ rotation.T + np.array(shift_m, dtype=np.float64))

    points, truth = survey.control_points, survey.truth
    sigmas = [points.sigma_m, *(p.gnss_sigma_m[None] for p in survey.photographs if p.gnss_sigma_m is not None)]
    if any(np.ptp(sigma, axis=1).max(initial=0.0) > 0.0 for sigma in sigmas):
        raise ValueError("standard deviations of a survey that is turned must be the same along all axes")
    photographs = tuple(
        replace(
            photograph,
            gnss_world_m=None if photograph.gnss_world_m is None else place(photograph.gnss_world_m),
            gnss_sigma_m=None if photograph.gnss_sigma_m is None else scale * photograph.gnss_sigma_m,
            attitude_world_from_camera=None
            if photograph.attitude_world_from_camera is None
            else rotation @ photograph.attitude_world_from_camera,
            height_above_ground_m=None,
        )
        for photograph in survey.photographs
    )
    plan = survey.plan
    east, north, up = (scale * sigma for sigma in plan.gnss_sigma_m)
    return replace(
        survey,
        plan=replace(plan, flying_height_m=scale * plan.flying_height_m, gnss_sigma_m=(east, north, up)),
        photographs=photographs,
        control_points=replace(points, position_world_m=place(points.position_world_m), sigma_m=scale * points.sigma_m),
        truth=replace(
            truth,
            poses=tuple(
                Pose(
                    rotation @ pose.rotation_world_from_camera,
                    place(pose.position_world_m),
                    scale * rotation @ pose.velocity_world_m_s,
                )
                for pose in truth.poses
            ),
            control_position_world_m=place(truth.control_position_world_m),
            gnss_offset_world_m={
                flight: scale * rotation @ offset for flight, offset in truth.gnss_offset_world_m.items()
            },
        ),
    )
