"""The scale of blocks with attitudes whose positions scatter by more than they are wide: positive, and as wrong as it
is said to be."""

from dataclasses import replace

import numpy as np
import pytest
from makers import simulated
from scipy.stats import truncnorm

from photogram.measures.open_scale import open_scale, positive_scale
from photogram.simulation.simulated_survey import SurveyPlan


@pytest.mark.parametrize(("scale", "sigma"), [(2.0, 1.0), (0.3, 1.2), (0.0, 5.0), (-1.0, 0.5), (-4.0, 1.0)])
def test_what_is_added_gives_the_moments_of_the_truncated_distribution(scale: float, sigma: float) -> None:
    observed, its_sigma = positive_scale(scale, sigma)
    variance = 1.0 / (1.0 / sigma**2 + 1.0 / its_sigma**2)
    mean = variance * (scale / sigma**2 + observed / its_sigma**2)
    exact = truncnorm(-scale / sigma, np.inf, loc=scale, scale=sigma)
    assert (mean, variance) == pytest.approx((exact.mean(), exact.var()), rel=1e-6)


def test_a_scale_that_positions_tell_is_left_to_them() -> None:
    made = simulated(SurveyPlan(strips=2, photographs_per_strip=3, control_points=0, check_points=0), tie_points=50)
    block = replace(made.block, poses=tuple(made.truth.poses))
    assert open_scale(block) is None
    noisy = tuple(replace(p, gnss_sigma_m=np.full(3, 900.0)) for p in block.photographs)
    held = open_scale(replace(block, photographs=noisy))
    assert held is not None
    assert held.distance_m > 0.0
    turning = tuple(replace(p, attitude_world_from_camera=None, attitude_sigma_rad=None) for p in noisy)
    assert open_scale(replace(block, photographs=turning)) is None
