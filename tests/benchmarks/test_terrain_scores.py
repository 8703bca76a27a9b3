"""Scores of terrain, and the sites with a known terrain: exact, simulated."""

import numpy as np
import pytest
from lib.simulated.terrain_sites import SITES, terrain_site
from lib.terrain_scores import rms, terrain_scores


def test_errors_are_counted_as_they_are_defined() -> None:
    ground = np.array([[True, True, True, True], [False] * 4])
    accepted = np.array([[True, True, True, False], [True, False, False, False]])
    error = np.array([[1.0, -1.0, 1.0, 2.0], [2.0, np.nan, np.nan, np.nan]])
    scores = terrain_scores(accepted, ground, ~ground, error, np.full((2, 4), 2.0))
    assert (scores.type_i, scores.type_ii, scores.total) == (0.25, 0.25, 0.25)
    assert scores.rms_m == pytest.approx(np.sqrt(11 / 5))
    assert scores.over_sigma == pytest.approx((1.0, np.sqrt(11 / 20)))
    assert np.isnan(rms(np.array([np.nan])))


@pytest.mark.parametrize("name", ["wood on a slope of 22°", "bridge", "bare slope of 30°"])
def test_a_site_has_ground_and_objects_where_they_are_known(name: str) -> None:
    site = terrain_site(name, 1)
    above = site.surface.values - site.terrain_m
    assert not (site.ground & site.objects).any()
    assert np.median(np.abs(above[site.ground])) < 0.1
    if site.objects.any():
        assert np.median(above[site.objects]) > 3.0
    assert site.objects.any() == (not name.startswith("bare"))
    assert name in SITES
