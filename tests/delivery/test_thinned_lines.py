"""Simplified contour lines against the traced ones, and the places of their labels."""

import numpy as np
import pytest
import shapely
from delivered import handed_over

from photogram.delivery.thinned_lines import index_labels, thinned
from photogram.survey import Contours


def lines(contours: Contours) -> list[shapely.LineString]:
    parts = zip(contours.first[:-1], contours.first[1:], strict=True)
    return [shapely.LineString(contours.vertex_map_m[a:b]) for a, b in parts]


@pytest.mark.parametrize("tolerance_m", [0.02, 0.06, 0.5])
def test_lines_stay_within_the_tolerance_and_lose_most_vertices(tolerance_m: float) -> None:
    traced = handed_over().contours
    assert traced is not None
    fewer = thinned(traced, tolerance_m)
    distance = [shapely.hausdorff_distance(a, b) for a, b in zip(lines(traced), lines(fewer), strict=True)]
    assert 0.0 < max(distance) <= tolerance_m + 1e-9
    assert len(fewer.vertex_map_m) < 0.35 * len(traced.vertex_map_m)
    np.testing.assert_array_equal(fewer.height_m, traced.height_m)
    np.testing.assert_array_equal(fewer.vertex_map_m[fewer.first[:-1]], traced.vertex_map_m[traced.first[:-1]])
    np.testing.assert_array_equal(fewer.vertex_map_m[fewer.first[1:] - 1], traced.vertex_map_m[traced.first[1:] - 1])


def test_nothing_is_lost_without_a_tolerance_but_what_lies_on_a_straight_line() -> None:
    bent = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    contours = Contours(np.array([5.0]), bent, np.array([0, 4]), 1.0, 1.0)
    np.testing.assert_array_equal(thinned(contours, 0.0).vertex_map_m, [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    empty = Contours(np.zeros(0), np.zeros((0, 2)), np.array([0]), 1.0, 1.0)
    assert len(thinned(empty, 1.0)) == 0
    assert len(index_labels(empty, 1.0).height_m) == 0


def test_labels_are_read_from_the_south_and_follow_the_line() -> None:
    west = np.array([[100.0, 0.0], [0.0, 10.0]])  # drawn towards the west
    contours = Contours(np.array([10.0, 11.0]), np.vstack([west, west + 5.0]), np.array([0, 2, 4]), 1.0, 1.0)
    labels = index_labels(contours, 1.0)
    assert labels.height_m.tolist() == [10.0]
    np.testing.assert_allclose(labels.position_map_m, [[50.0, 5.0]])
    np.testing.assert_allclose(labels.angle_deg, [np.rad2deg(np.arctan2(-10.0, 100.0))])
    assert len(index_labels(contours, 0.2).height_m) == 4
    assert len(index_labels(contours, 11.0).height_m) == 0
