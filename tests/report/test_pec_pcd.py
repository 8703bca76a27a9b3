"""Classes of the PEC-PCD: the table as it is published, and both of its conditions."""

import numpy as np
import pytest

from photogram.report.standards.pec_pcd import (
    CLASSES,
    CONTOUR_INTERVAL_M,
    LEAST_POINTS,
    height_class,
    plan_class,
)

PUBLISHED_PLAN_M = {
    1000: ((0.28, 0.17), (0.50, 0.30), (0.80, 0.50), (1.00, 0.60)),
    2000: ((0.56, 0.34), (1.00, 0.60), (1.60, 1.00), (2.00, 1.20)),
    10_000: ((2.80, 1.70), (5.00, 3.00), (8.00, 5.00), (10.00, 6.00)),
    250_000: ((70.0, 42.5), (125.0, 75.0), (200.0, 125.0), (250.0, 150.0)),
}
"""PEC and EP of the classes A to D, m."""
PUBLISHED_HEIGHT_M = {
    1000: ((0.27, 0.17), (0.50, 0.33), (0.60, 0.40), (0.75, 0.50)),
    5000: ((0.54, 0.34), (1.00, 0.67), (1.20, 0.80), (1.50, 1.00)),
    10_000: ((1.35, 0.84), (2.50, 1.67), (3.00, 2.00), (3.75, 2.50)),
    250_000: ((27.0, 16.67), (50.0, 33.33), (60.0, 40.0), (75.0, 50.0)),
}


@pytest.mark.parametrize("scale", PUBLISHED_PLAN_M)
def test_limits_in_plan_are_those_of_the_published_table(scale: int) -> None:
    for tolerances, (pec_m, ep_m) in zip(CLASSES.values(), PUBLISHED_PLAN_M[scale], strict=True):
        assert 1e-3 * scale * tolerances.pec_plan_mm == pytest.approx(pec_m)
        assert 1e-3 * scale * tolerances.ep_plan_mm == pytest.approx(ep_m)


@pytest.mark.parametrize("scale", PUBLISHED_HEIGHT_M)
def test_limits_in_height_are_those_of_the_published_table(scale: int) -> None:
    interval_m = CONTOUR_INTERVAL_M[scale]
    for tolerances, (pec_m, ep_m) in zip(CLASSES.values(), PUBLISHED_HEIGHT_M[scale], strict=True):
        assert interval_m * tolerances.pec_height == pytest.approx(pec_m, abs=1e-9)
        assert interval_m * tolerances.ep_height == pytest.approx(ep_m, abs=0.007)  # printed with two decimals


@pytest.mark.parametrize(("name", "rms_m"), [("A", 0.169), ("B", 0.299), ("C", 0.499), ("D", 0.599), (None, 0.601)])
def test_the_root_mean_square_decides(name: str | None, rms_m: float) -> None:
    assert plan_class(np.full(20, rms_m), 1000) == name


def test_nine_tenths_must_be_within_the_limit() -> None:
    small = np.full(18, 0.01)
    assert plan_class(np.array([*small, 0.3, 0.3]), 1000) == "A"  # 18 of 20
    assert plan_class(np.array([*small[1:], 0.3, 0.3, 0.3]), 1000) == "B"
    assert height_class(np.array([*small, -0.3, 0.3]), 1000) == "A"
    assert height_class(np.array([*small[1:], -0.3, 0.3, 0.3]), 1000) == "B"


def test_too_few_points_hold_no_class() -> None:
    assert plan_class(np.zeros(LEAST_POINTS), 1000) == "A"
    assert plan_class(np.zeros(LEAST_POINTS - 1), 1000) is None
    assert height_class(np.zeros(LEAST_POINTS - 1), 1000) is None
