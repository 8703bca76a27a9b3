"""What must not matter, and what must matter in one direction only: a survey that is moved, turned, scaled, mirrored,
renamed, reordered or written in another zone is the same survey; a measurement more makes nothing worse."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.geodesy.frames import LocalFrame
from photogram.results import Adjustment, AdjustmentCovariances
from photogram.simulation.simulated_survey import SurveyPlan, simulate_block
from photogram.survey import Block, Photograph

FREE = (5.0, 3.0, 3.0, 0.004, 0.004, 0.0, 0.0, 0.0002, 0.0002, 0.0, 0.0)
PLAN = SurveyPlan(
    strips=2,
    photographs_per_strip=3,
    control_points=6,
    check_points=2,
    gnss_sigma_m=(0.03, 0.03, 0.05),
    gnss_offset_sigma_m=(0.3, 0.3, 0.5),
    control_sigma_m=(0.01, 0.01, 0.02),
    calibration_sigmas=FREE,
)
"""Standard deviations that are alike in easting and northing, so that a turned survey is one that can be stated."""
SETTINGS = AdjustmentSettings()
STATED = replace(
    SETTINGS,
    robust_loss="none",
    outlier_threshold=1e4,
    estimate_sigmas=False,
    lens_field="none",
    common_errors="none",
)
"""Everything is used with the sigmas that are stated, and nothing is decided."""
MIRROR = np.diag([-1.0, 1.0, 1.0])
EXCHANGE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def made(seed: int = 1, mismatches: float = 0.02) -> Block:
    """A block in Cartesian axes, with mismatches among its tie points."""
    simulated = simulate_block(PLAN, seed, tie_points=300, mismatches=mismatches).block
    return replace(simulated, frame=LocalFrame.local())


BLOCK = made()
RESULT = adjust(BLOCK, SETTINGS)


def mapped(block: Block, place: Callable[[FloatArray], FloatArray], turn: FloatArray, scale: float = 1.0) -> Block:
    """Return a block of which all places go through ``place``, all rotations by ``turn`` (3, 3) and all lengths by
    ``scale``."""

    def moved_photograph(photograph: Photograph) -> Photograph:
        assert photograph.gnss_world_m is not None
        assert photograph.gnss_sigma_m is not None
        assert photograph.attitude_world_from_camera is not None
        height_m = photograph.height_above_ground_m
        return replace(
            photograph,
            gnss_world_m=place(photograph.gnss_world_m),
            gnss_sigma_m=photograph.gnss_sigma_m * scale,
            attitude_world_from_camera=turn @ photograph.attitude_world_from_camera,
            height_above_ground_m=None if height_m is None else height_m * scale,
        )

    def moved_pose(pose: Pose | None) -> Pose:
        assert pose is not None
        return Pose(turn @ pose.rotation_world_from_camera, place(pose.position_world_m))

    control = block.control_points
    return replace(
        block,
        photographs=tuple(map(moved_photograph, block.photographs)),
        poses=tuple(map(moved_pose, block.poses)),
        tie_points=replace(block.tie_points, position_world_m=place(block.tie_points.position_world_m)),
        control_points=replace(
            control, position_world_m=place(control.position_world_m), sigma_m=control.sigma_m * scale
        ),
        gnss_offset_sigma_m=block.gnss_offset_sigma_m * scale,
    )


def through_the_glass(block: Block, axes: FloatArray, camera: Callable[[Camera], Camera], places: FloatArray) -> Block:
    """Return a block seen in a mirror: the ground by ``axes`` (3, 3), pixels by ``places`` (2, 3), their rotation and
    shift, and the camera likewise. The camera's axes are mirrored, too, so that rotations stay rotations."""
    turned, shift = places[:, :2], places[:, 2]

    def in_the_glass(rotation: FloatArray | None) -> FloatArray:
        assert rotation is not None
        return axes @ rotation @ axes

    ties, control = block.tie_points, block.control_points
    return replace(
        block,
        cameras=tuple(map(camera, block.cameras)),
        photographs=tuple(
            replace(
                p,
                gnss_world_m=None if p.gnss_world_m is None else axes @ p.gnss_world_m,
                attitude_world_from_camera=in_the_glass(p.attitude_world_from_camera),
            )
            for p in block.photographs
        ),
        poses=tuple(
            Pose(in_the_glass(p.rotation_world_from_camera), axes @ p.position_world_m) for p in block.poses if p
        ),
        tie_points=replace(ties, pixel=ties.pixel @ turned.T + shift, position_world_m=ties.position_world_m @ axes.T),
        control_points=replace(
            control,
            position_world_m=control.position_world_m @ axes.T,
            mark_pixel=control.mark_pixel @ turned.T + shift,
            mark_covariance_px2=turned @ control.mark_covariance_px2 @ turned.T,
        ),
    )


def assert_same(one: Adjustment, other: Adjustment, axes: FloatArray, scale: float = 1.0) -> None:
    """Hold that two results say the same of the noise, of every observation and, through ``axes``, of the precision."""
    assert other.sigma0 == pytest.approx(one.sigma0, rel=1e-7)
    assert other.redundancy == one.redundancy
    assert len(other.block.tie_points.pixel) == len(one.block.tie_points.pixel)
    assert other.estimates.residual_px**2 @ [1.0, 1.0] == pytest.approx(
        one.estimates.residual_px**2 @ [1.0, 1.0], abs=1e-6
    )
    assert other.covariances.ground_m2 == pytest.approx(
        axes @ one.covariances.ground_m2 @ axes.T * scale**2, rel=1e-5, abs=1e-9 * scale**2
    )


def assert_no_less_precise(worse: AdjustmentCovariances, better: AdjustmentCovariances) -> None:
    """Hold that no standard deviation has grown, but for what the solution has moved, and that they have shrunk."""
    for name in ("ground_m2", "position_m2", "tie_point_m2"):
        before, after = (np.sqrt(np.diagonal(getattr(each, name), axis1=-2, axis2=-1)) for each in (worse, better))
        assert np.max(after / before) < 1.01, name
        assert name == "ground_m2" or np.median(after / before) < 0.9999, name


@settings(max_examples=6)
@given(
    angle=st.floats(-np.pi, np.pi),
    scale=st.sampled_from([0.3048, 0.5, 1.0, 3.2808]),
    shift=st.tuples(*[st.floats(-2000.0, 2000.0)] * 3),
)
def test_a_survey_that_is_moved_turned_and_scaled_is_the_same(
    angle: float, scale: float, shift: tuple[float, float, float]
) -> None:
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def place(points: FloatArray) -> FloatArray:
        return np.asarray(scale * points @ turn.T + np.array(shift))

    other = adjust(mapped(BLOCK, place, turn, scale), SETTINGS)
    assert_same(RESULT, other, turn, scale)
    assert other.estimates.ground_world_m == pytest.approx(place(RESULT.estimates.ground_world_m), abs=1e-6 * scale)


def test_a_survey_in_a_mirror_is_the_same() -> None:
    """u goes the other way, and so do the principal point, p2 and b2."""

    def camera(each: Camera) -> Camera:
        (cx, cy), (p1, p2), (b1, b2) = each.principal_point_px, each.tangential, each.affinity
        return replace(
            each,
            principal_point_px=np.array([each.width_px - 1 - cx, cy]),
            tangential=np.array([p1, -p2]),
            affinity=np.array([b1, -b2]),
        )

    pixels = np.array([[-1.0, 0.0, BLOCK.cameras[0].width_px - 1], [0.0, 1.0, 0.0]])
    other = adjust(through_the_glass(BLOCK, MIRROR, camera, pixels), SETTINGS)
    assert_same(RESULT, other, MIRROR)
    assert other.estimates.ground_world_m == pytest.approx(RESULT.estimates.ground_world_m @ MIRROR, abs=1e-6)
    assert other.block.cameras[0].tangential == pytest.approx(
        RESULT.block.cameras[0].tangential * [1.0, -1.0], abs=1e-9
    )


def test_rows_and_columns_exchanged_are_the_same() -> None:
    def camera(each: Camera) -> Camera:
        assert not each.affinity.any()
        sigmas = each.sigmas.copy()
        sigmas[[1, 2]], sigmas[[7, 8]] = sigmas[[2, 1]], sigmas[[8, 7]]
        return replace(
            each,
            width_px=each.height_px,
            height_px=each.width_px,
            principal_point_px=each.principal_point_px[::-1].copy(),
            tangential=each.tangential[::-1].copy(),
            sigmas=sigmas,
        )

    pixels = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    other = adjust(through_the_glass(BLOCK, EXCHANGE, camera, pixels), SETTINGS)
    assert_same(RESULT, other, EXCHANGE)
    assert other.estimates.ground_world_m == pytest.approx(RESULT.estimates.ground_world_m @ EXCHANGE, abs=1e-6)


def reordered(block: Block, photograph: FloatArray, point: FloatArray) -> Block:
    """Return a block whose photographs and ground points stand in another order, under other names."""
    new_place = np.argsort(photograph)
    ties, control = block.tie_points, block.control_points
    order = np.lexsort((new_place[ties.photograph], ties.point))
    new_point = np.argsort(point)
    return replace(
        block,
        photographs=tuple(replace(block.photographs[k], name=f"other_{k}.jpg") for k in photograph),
        poses=tuple(block.poses[k] for k in photograph),
        tie_points=replace(
            ties,
            photograph=new_place[ties.photograph][order],
            point=ties.point[order],
            feature=ties.feature[order],
            pixel=ties.pixel[order],
            sigma_px=ties.sigma_px[order],
        ),
        control_points=replace(
            control,
            name=tuple(f"other {control.name[k]}" for k in point),
            role=tuple(control.role[k] for k in point),
            position_world_m=control.position_world_m[point],
            sigma_m=control.sigma_m[point],
            controlled=control.controlled[point],
            sigma_assumed=control.sigma_assumed[point],
            mark_sigma_assumed=control.mark_sigma_assumed[point],
            mark_photograph=new_place[control.mark_photograph],
            mark_point=new_point[control.mark_point],
        ),
    )


@settings(max_examples=4)
@given(st.permutations(range(6)), st.permutations(range(8)))
def test_the_order_and_the_names_of_photographs_and_points_do_not_matter(
    photograph: list[int], point: list[int]
) -> None:
    other = adjust(reordered(BLOCK, np.array(photograph), np.array(point)), SETTINGS)
    assert other.sigma0 == pytest.approx(RESULT.sigma0, rel=1e-7)
    assert other.redundancy == RESULT.redundancy
    assert other.estimates.ground_world_m == pytest.approx(RESULT.estimates.ground_world_m[point], abs=1e-6)
    assert other.covariances.ground_m2 == pytest.approx(RESULT.covariances.ground_m2[point], rel=1e-5)


def test_a_camera_that_is_held_may_be_two() -> None:
    held = replace(BLOCK, cameras=(replace(BLOCK.cameras[0], sigmas=np.zeros(12)),))
    two = replace(
        held,
        cameras=(held.cameras[0], replace(held.cameras[0], name="the same")),
        photographs=tuple(replace(p, camera=k % 2) for k, p in enumerate(held.photographs)),
    )
    one, other = adjust(held, STATED), adjust(two, STATED)
    assert other.estimates.ground_world_m == pytest.approx(one.estimates.ground_world_m, abs=1e-6)
    assert other.covariances.ground_m2 == pytest.approx(one.covariances.ground_m2, rel=1e-5, abs=1e-12)


def test_a_camera_whose_parts_are_calibrated_apart_is_known_less_well() -> None:
    """With priors that say nothing: two would be two measurements."""
    camera = replace(BLOCK.cameras[0], sigmas=1e3 * BLOCK.cameras[0].sigmas)
    two = replace(
        BLOCK,
        cameras=(camera, replace(camera, name="the same")),
        photographs=tuple(replace(p, camera=k % 2) for k, p in enumerate(BLOCK.photographs)),
    )
    clean = made(mismatches=0.0)
    one = adjust(replace(clean, cameras=(camera,)), STATED)
    apart = adjust(replace(two, tie_points=clean.tie_points, control_points=clean.control_points), STATED)
    assert_no_less_precise(apart.covariances, one.covariances)


@pytest.mark.parametrize("point", [6, 7])
def test_a_check_point_that_becomes_control_makes_nothing_less_precise(point: int) -> None:
    clean = made(mismatches=0.0)
    control = clean.control_points
    assert control.role[point] == "check"
    roles = tuple("control" if k == point else role for k, role in enumerate(control.role))
    controlled = control.controlled.copy()
    controlled[point] = True
    more = replace(clean, control_points=replace(control, role=roles, controlled=controlled))
    before, after = adjust(clean, STATED).covariances, adjust(more, STATED).covariances
    assert_no_less_precise(before, after)


def test_the_zone_of_the_map_does_not_matter() -> None:
    """Between two zones: the same ground to 0.1 mm, the same noise."""
    simulated = simulate_block(PLAN, 1, tie_points=300).block
    east = LocalFrame("EPSG:25833", simulated.frame.origin_map_m)
    to_the_east = Transformer.from_crs("EPSG:25832", "EPSG:25833", always_xy=True)
    origin = to_the_east.transform(*simulated.frame.origin_map_m[:2])
    east = LocalFrame("EPSG:25833", (origin[0], origin[1], simulated.frame.origin_map_m[2]))

    def in_the_east(points_world_m: FloatArray) -> FloatArray:
        plain = np.atleast_2d(points_world_m)
        x, y, z = simulated.frame.map_from_world(plain).T
        moved = east.world_from_map(np.column_stack([*to_the_east.transform(x, y), z]))
        return np.asarray(moved if points_world_m.ndim == 2 else moved[0])

    axes = in_the_east(np.eye(3)) - in_the_east(np.zeros(3))
    turn = axes.T @ np.linalg.inv(np.linalg.cholesky(axes @ axes.T).T)
    one = adjust(simulated, SETTINGS)
    other = adjust(replace(mapped(simulated, in_the_east, turn), frame=east), SETTINGS)
    assert other.sigma0 == pytest.approx(one.sigma0, rel=1e-4)
    assert other.estimates.ground_world_m == pytest.approx(in_the_east(one.estimates.ground_world_m), abs=1e-4)
