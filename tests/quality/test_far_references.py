"""References that lie far off: how far is said, and distances from them are measured to a few of their points."""

import numpy as np
import pytest

from photogram.quality.cloud_comparison import compare_to_reference, triangulate
from photogram.quality.far_references import ABOVE_REMEDY, FAR_SPACINGS, above, beside, is_far, spacing_of, thinned
from photogram.survey import PointCloud

HERE = np.array([[0.0, 0.0], [100.0, 50.0]])


@pytest.mark.parametrize(
    ("shift", "says"),
    [
        ((265.0, 0.0), "it lies 165 m east of the survey"),
        ((-103.0, -54.0), "it lies 5 m south-west of the survey"),
        ((50.0, 4050.0), "it lies 4000 m north of the survey"),
        ((-412_100.0, 0.0), "it lies 412 km west of the survey"),
    ],
)
def test_how_far_a_reference_lies_beside_and_which_way(shift: tuple[float, float], says: str) -> None:
    assert beside(HERE + shift, HERE) == says
    assert beside(HERE + 0.9 * HERE[1], HERE) == ""


def ground(count: int, seed: int, height_m: float = 0.0) -> PointCloud:
    """Points on hills of 2 m, without noise."""
    x, y = np.random.default_rng(seed).uniform(0, 60, (2, count))
    return PointCloud(np.column_stack([x, y, np.sin(x / 5) + np.cos(y / 7) + height_m]))


@pytest.mark.parametrize("height_m", [265.0, 45.0, 10.0, -45.0])
def test_distances_from_afar_take_few_points_and_are_right_to_a_hundredth(height_m: float) -> None:
    reference, cloud = ground(60_000, 1), ground(200, 2, height_m)
    few = thinned(reference, height_m)
    assert len(few) <= (60.0 / (0.05 * abs(height_m)) + 1) ** 2
    off_m = cloud.position_map_m[:, None] - reference.position_map_m[None]
    exact = np.array([np.linalg.norm(each, axis=1).min() for each in off_m])
    found = compare_to_reference(cloud, triangulate(reference), sor=False)
    np.testing.assert_allclose(found.cloud_distance_m, exact, rtol=0.01)
    assert found.doubt == f"the reference: {above(-found.cloud_to_surface.median_m)}: {ABOVE_REMEDY}"
    assert f"{abs(height_m):.1f} m {'below' if height_m > 0 else 'above'} the survey" in found.doubt


def test_a_reference_in_its_place_is_not_doubted() -> None:
    assert compare_to_reference(ground(500, 3, 0.3), triangulate(ground(20_000, 1))).doubt == ""


def test_the_spacing_is_that_of_cells_which_fill_the_extent() -> None:
    places = np.random.default_rng(0).uniform([100.0, 200.0, 0.0], [140.0, 210.0, 90.0], (998, 3))
    points = np.vstack([places, [[100.0, 200.0, 5.0], [140.0, 210.0, 5.0]]])
    assert spacing_of(points) == pytest.approx(np.sqrt(40.0 * 10.0 / 1000))


def test_a_reference_is_far_beyond_some_spacings_and_ten_times_the_scatter() -> None:
    for offset_m, scatter_m, spacing_m, far in (
        (FAR_SPACINGS * 2.0 + 0.1, 0.01, 2.0, True),
        (-FAR_SPACINGS * 2.0 - 0.1, 0.01, 2.0, True),
        (FAR_SPACINGS * 2.0, 0.01, 2.0, False),
        (FAR_SPACINGS * 2.0 + 0.1, 5.0, 2.0, False),
    ):
        assert is_far(offset_m, scatter_m, spacing_m) is far
