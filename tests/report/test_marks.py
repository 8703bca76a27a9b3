"""Numbers of the marks of ground points, by kind and by point, against figures reckoned by hand."""

import math
from typing import Any

import numpy as np
import pytest

from photogram.report.marks import (
    UNKNOWN,
    by_misfit,
    largest_w,
    mark_kind_numbers,
    point_marks,
    residual_length_px,
)
from photogram.report.record.ground import GroundPointRecord, MarkRecord

Json = dict[str, Any]


def mark(residual_px: tuple[float, float] | None = (0.3, -0.4), **more: Any) -> MarkRecord:
    """A mark of a control point, sigma 0.5 px, half of a blunder in it shows."""
    found: MarkRecord = {
        "photograph": "1.jpg",
        "left_out": False,
        "pixel": [100.0, 200.0],
        "residual_px": None if residual_px is None else list(residual_px),
        "redundancy": [0.5, 0.5],
        "w": [0.8, -1.1],
        "mdb_px": [3.0, 3.0],
        "suspect": False,
        "kind": "raw",
        "sigma_px": 0.5,
    }
    found.update(more)  # type: ignore[typeddict-item]
    return found


def of_check_point(residual_px: tuple[float, float], **more: Any) -> MarkRecord:
    return mark(residual_px, redundancy=None, w=None, mdb_px=None, suspect=None, **more)


def point(name: str, marks: list[MarkRecord], role: str = "control") -> GroundPointRecord:
    found: Json = {"name": name, "role": role, "marks": marks}
    return found  # type: ignore[return-value]  # the keys that are read


def test_marks_are_counted_by_kind_with_their_sigmas() -> None:
    control = point("G1", [mark(), mark(kind="circle", sigma_px=0.1), mark(kind="circle", sigma_px=0.4)])
    check = point("C1", [of_check_point((0.0, 0.1), kind="circle", sigma_px=0.2)], "check")
    circle, raw = mark_kind_numbers([control, check])
    assert (circle["kind"], circle["marks"], circle["of_control_points"], circle["rejected"]) == ("circle", 3, 2, 0)
    assert circle["sigma_px"] == {"median": 0.2, "least": 0.1, "largest": 0.4}
    assert (raw["kind"], raw["marks"], raw["of_control_points"]) == ("raw", 1, 1)


def test_residuals_are_root_mean_squares_over_u_and_v_of_marks_that_count() -> None:
    marks = [mark((0.3, -0.4)), mark((0.5, 0.0), sigma_px=1.0), mark((40.0, 30.0), left_out=True), mark(None)]
    (raw,) = mark_kind_numbers([point("G1", marks)])
    assert raw["marks"] == 4
    assert raw["rejected"] == 1
    assert raw["residual_rms_px"] == pytest.approx(math.sqrt((0.09 + 0.16 + 0.25 + 0.0) / 4))
    assert raw["residual_over_sigma"] == pytest.approx(math.sqrt((0.36 + 0.64 + 0.25 + 0.0) / 4))
    assert raw["sigma_factor"] == pytest.approx(math.sqrt((0.36 + 0.64 + 0.25) / 2.0))


def test_residuals_of_a_mark_with_a_covariance_count_along_the_axes_of_its_ellipse() -> None:
    along = (2.0 * math.cos(math.radians(30.0)), 2.0 * math.sin(math.radians(30.0)))
    across = (-along[1] / 2.0, along[0] / 2.0)
    ellipse: Json = {"sigma_px": math.sqrt(0.5 * (2.0**2 + 0.5**2)), "semi_axes_px": [2.0, 0.5], "direction_deg": 30.0}
    for residual, squares in ((along, 1.0), (across, 4.0)):
        (kind,) = mark_kind_numbers([point("G1", [mark(residual, **ellipse)])])
        assert kind["residual_over_sigma"] == pytest.approx(math.sqrt(squares / 2.0))
        assert kind["sigma_factor"] == pytest.approx(math.sqrt(squares / 1.0))


def test_the_factor_finds_by_what_sigmas_were_misstated() -> None:
    """Residuals of variance r sigma², as least squares leaves them, of marks stated half as good as they are, and
    right."""
    random = np.random.default_rng(5)
    n, sigma = 4000, 0.3
    redundancy = random.uniform(0.2, 0.9, (n, 2))
    residual = random.normal(0.0, sigma * np.sqrt(redundancy))
    for stated, factor in ((sigma, 1.0), (sigma / 2, 2.0)):
        marks = [
            mark((u, v), redundancy=[float(a), float(b)], sigma_px=stated)
            for (u, v), (a, b) in zip(residual.tolist(), redundancy, strict=True)
        ]
        (raw,) = mark_kind_numbers([point("G1", marks)])
        assert raw["sigma_factor"] == pytest.approx(factor, rel=5 / math.sqrt(2 * redundancy.sum()))
        assert raw["residual_over_sigma"] is not None
        assert raw["residual_over_sigma"] < factor


def test_nothing_is_said_where_there_is_nothing_to_say_it_of() -> None:
    assert mark_kind_numbers([]) == []
    (kind,) = mark_kind_numbers([point("C1", [of_check_point((0.1, 0.1))], "check")])
    assert kind["sigma_factor"] is None
    (kind,) = mark_kind_numbers([point("G1", [mark(None)])])
    assert kind["residual_rms_px"] is None
    assert kind["residual_over_sigma"] is None
    former = mark()
    del former["kind"]
    (kind,) = mark_kind_numbers([point("G1", [former])])
    assert kind["kind"] == UNKNOWN
    del former["sigma_px"]  # a report of an earlier version
    assert mark_kind_numbers([point("G1", [former])]) == []


def test_a_point_is_told_by_its_worst_mark_that_counts() -> None:
    worst = mark((3.0, -4.0), photograph="worst.jpg", w=[1.0, -4.0], suspect=True)
    marks = [mark((0.1, 0.0)), worst, mark((60.0, 0.0), photograph="wrong.jpg", left_out=True), mark(None)]
    (found,) = point_marks([point("G1", marks), point("G2", [])])
    assert (found.name, found.role, found.marks, found.rejected) == ("G1", "control", 4, 1)
    assert found.largest is worst
    assert found.largest_px == pytest.approx(5.0)
    assert found.w == -4.0
    assert found.is_flagged
    (calm,) = point_marks([point("G1", [mark()])])
    assert not calm.is_flagged
    (bare,) = point_marks([point("C1", [mark(None)], "check")])
    assert (bare.largest_px, bare.w) == (None, None)


def test_marks_in_the_order_of_their_misfit() -> None:
    rejected, far, near, nowhere = mark((0.0, 0.1), left_out=True), mark((2.0, 0.0)), mark((0.0, 1.0)), mark(None)
    assert by_misfit([nowhere, near, far, rejected]) == [rejected, far, near, nowhere]
    assert residual_length_px(nowhere) is None
    assert largest_w(mark(w=[None, 0.5])) == 0.5
    assert largest_w(mark(w=None)) is None
