"""A block without names, dates and place: the same adjustment."""

from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from makers import simulated

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.constraints.between_points import CommonSurface, Distance
from photogram.constraints.rigs import Companion, RelativePose
from photogram.donation.anonymous_block import ABSENT, FIRST_EXPOSURE, SiteAxes, anonymous, numbered
from photogram.errors import PhotogramError
from photogram.simulation.simulated_survey import SurveyPlan
from photogram.survey import Block

PLAN = SurveyPlan(
    strips=2, photographs_per_strip=4, control_points=5, check_points=3, flights=2, gnss_sigma_m=(0.02, 0.02, 0.03),
    attitude_sigma_deg=1.0,
)  # fmt: skip
SETTINGS = AdjustmentSettings()


def block_of(**plan: object) -> Block:
    return simulated(replace(PLAN, **plan)).block  # type: ignore[arg-type]


def nameless(block: Block) -> Block:
    return anonymous(block, SiteAxes.of(block))


@pytest.mark.parametrize("plan", [{}, {"gnss_tags": False}, {"control_points": 0}], ids=("both", "control", "GNSS"))
def test_it_is_adjusted_as_the_block_itself(plan: dict[str, object]) -> None:
    block = block_of(**plan)
    axes = SiteAxes.of(block)
    own, other = adjust(block, SETTINGS), adjust(anonymous(block, axes), SETTINGS)
    assert other.redundancy == own.redundancy
    assert other.sigma0 == pytest.approx(own.sigma0, abs=2e-3)
    variance = np.einsum("ik,nkl,jl->nij", axes.site_from_world, own.covariances.position_m2, axes.site_from_world)
    sigma = np.sqrt(np.diagonal(variance, axis1=1, axis2=2))
    for pose, expected, limit in zip(other.block.poses, own.block.poses, sigma, strict=True):
        assert pose is not None
        assert expected is not None
        # image coordinates are rounded to a 1024th of a pixel, where they are known to half a pixel
        assert np.all(np.abs(pose.position_world_m - axes.places(expected.position_world_m)) < 0.02 * limit)
    np.testing.assert_allclose(other.covariances.position_m2, variance, rtol=1e-3, atol=1e-3 * sigma.min() ** 2)
    off = own.estimates.ground_world_m - block.control_points.position_world_m
    again = other.estimates.ground_world_m - axes.places(block.control_points.position_world_m)
    np.testing.assert_allclose(again, off @ axes.site_from_world.T, atol=2e-4)


def test_places_are_counted_from_the_middle_along_the_axes_of_the_map() -> None:
    block = block_of()
    moved, axes = nameless(block), SiteAxes.of(block)
    np.testing.assert_array_equal(axes.places(axes.middle_world_m), np.zeros(3))
    centres = np.array([p.position_world_m for p in moved.poses if p is not None])
    assert np.all(np.abs(np.median(centres, axis=0)) < 0.5)
    surveyed = block.frame.map_from_world(block.control_points.position_world_m)
    again = moved.control_points.position_world_m
    # distances in the map differ from those in space by its scale; directions by what the map turns over the site
    apart, apart_again = surveyed[1:, :2] - surveyed[0, :2], again[1:, :2] - again[0, :2]
    np.testing.assert_allclose(apart_again, apart, atol=2e-3 * np.abs(apart).max())
    turns = np.arctan2(apart[:, 1], apart[:, 0]) - np.arctan2(apart_again[:, 1], apart_again[:, 0])
    np.testing.assert_allclose(np.sin(turns), 0.0, atol=1e-4)


def test_nothing_tells_who_when_and_where() -> None:
    block, start = block_of(), datetime(2031, 5, 17, 9, 30)
    photographs = tuple(
        replace(p, time=start + timedelta(seconds=7 * i), capture=f"secret {i // 2}", flight=f"secret {p.flight}")
        for i, p in enumerate(block.photographs)
    )
    points = replace(block.control_points, name=tuple(f"secret {n}" for n in block.control_points.name))
    ties = replace(block.tie_points, colour=np.full_like(block.tie_points.colour, 77))
    made = nameless(replace(block, photographs=photographs, control_points=points, tie_points=ties))
    assert made.frame.is_local
    assert [p.name for p in made.photographs] == [f"photograph {i}" for i in range(1, len(photographs) + 1)]
    assert {p.flight for p in made.photographs} == {"flight 1", "flight 2"}
    assert [p.capture for p in made.photographs[:3]] == ["exposure 1", "exposure 1", "exposure 2"]
    assert made.photographs[0].time == FIRST_EXPOSURE
    assert made.photographs[3].time_s - made.photographs[0].time_s == pytest.approx(21.0)  # type: ignore[operator]
    assert made.control_points.name[0] == "point 1"
    assert made.cameras[0].name == "camera 1"
    assert not made.tie_points.colour.any()
    assert "secret" not in repr(vars(made))
    assert all(p.path is None for p in made.photographs)


def test_a_point_and_a_photograph_of_one_name_stay_two() -> None:
    block = block_of()
    photograph, point, other = block.photographs[1].name, block.control_points.name[2], block.control_points.name[0]
    points = replace(block.control_points, name=(photograph, *block.control_points.name[1:]))
    constraints = (
        Distance(ends=(photograph, point), sigma_m=0.01, length_m=5.0),
        Distance(ends=(block.photographs[0].name, photograph), sigma_m=0.01, length_m=6.0, of_photographs=True),
        CommonSurface("pond", "level surface", (point, photograph, "nobody"), (0.01, 0.01, 0.01)),
    )
    made = nameless(replace(block, control_points=points, constraints=constraints)).constraints
    assert other != photograph
    assert [c.points for c in made] == [
        ("point 1", "point 3"), ("photograph 1", "photograph 2"), ("point 3", "point 1", ABSENT),
    ]  # fmt: skip
    assert [c.name for c in made] == ["constraint 1", "constraint 2", "constraint 3"]


def test_rigs_keep_their_exposures() -> None:
    block = block_of()
    first, second = block.photographs[0].name, block.photographs[1].name
    given = RelativePose(np.array([0.1, 0.0, 0.0]), np.eye(3))
    other = replace(block.cameras[0], name="b")
    rig = Companion("b", block.cameras[0].name, given, np.full(6, 1e-3), ((second, first),), np.full((1, 6), 1e-3))
    photographs = (block.photographs[0], replace(block.photographs[1], camera=1), *block.photographs[2:])
    made = nameless(replace(block, cameras=(*block.cameras, other), photographs=photographs, rigs=(rig,)))
    assert (made.rigs[0].name, made.rigs[0].master) == ("camera 2", "camera 1")
    assert made.rigs[0].exposures == (("photograph 2", "photograph 1"),)


def test_a_block_without_an_orientation_has_no_middle() -> None:
    block = block_of()
    with pytest.raises(PhotogramError, match="no photograph is oriented"):
        SiteAxes.of(replace(block, poses=(None,) * len(block.poses)))


def test_names_are_numbered_in_their_order() -> None:
    assert numbered(["b", "a", "b"], "flight") == {"b": "flight 1", "a": "flight 2"}
