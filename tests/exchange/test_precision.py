"""Standard deviations of angles and points along the map, against the scatter of draws from the covariances."""

from dataclasses import replace

import numpy as np
from audited_solutions import PLAN
from makers import simulated
from scipy.spatial.transform import Rotation

from photogram.adjustment.adjustment import adjust
from photogram.camera import omega_phi_kappa_deg
from photogram.exchange.audit.audit import LEAST_SQUARES
from photogram.exchange.audit.precision import exterior_sigmas, ground_sigmas

DRAWS = 20_000


def test_draws_scatter_as_stated() -> None:
    """Rotations about the camera's axes, turned into angles of the map; centres and ground points along its axes."""
    result = adjust(simulated(PLAN, tie_points=300).block, LEAST_SQUARES)
    frame, rng = result.block.frame, np.random.default_rng(7)
    angles, centres = exterior_sigmas(result)
    for i in (0, 7, 14):
        pose = result.block.poses[i]
        assert pose is not None
        to_map = frame.rotation_world_from_map(pose.position_world_m).T
        turns = Rotation.from_rotvec(rng.multivariate_normal(np.zeros(3), result.covariances.rotation_rad2[i], DRAWS))
        drawn = np.array(
            [omega_phi_kappa_deg(to_map @ pose.rotation_world_from_camera @ turn) for turn in turns.as_matrix()]
        )
        np.testing.assert_allclose(angles[i], drawn.std(axis=0), rtol=0.03)
        places = pose.position_world_m + rng.multivariate_normal(np.zeros(3), result.covariances.position_m2[i], DRAWS)
        np.testing.assert_allclose(centres[i], frame.map_from_world(places).std(axis=0), rtol=0.03)
    places = result.estimates.ground_world_m[0] + rng.multivariate_normal(
        np.zeros(3), result.covariances.ground_m2[0], DRAWS
    )
    np.testing.assert_allclose(ground_sigmas(result)[0], frame.map_from_world(places).std(axis=0), rtol=0.03)


def test_what_took_no_part_has_none() -> None:
    block = simulated(PLAN, tie_points=300).block
    result = adjust(replace(block, poses=(None, *block.poses[1:])), LEAST_SQUARES)
    angles, centres = exterior_sigmas(result)
    assert np.isnan(angles[0]).all()
    assert np.isnan(centres[0]).all()
    assert np.isfinite(angles[1:]).all()
    assert np.isfinite(centres[1:]).all()
