"""The scores of dense heights on surfaces made for it, and the geometry of the rectified pairs of their peer."""

from dataclasses import replace

import numpy as np
import pytest
from lib import dense_scores, dense_truth, rectified_pairs
from lib.dense_truth import Truth

from photogram.camera import Camera, Pose, image_plane, project_points
from photogram.grid import MapGrid
from photogram.simulation.simulated_survey import simulate, simulate_block
from photogram.simulation.survey_plan import SurveyPlan, whole_survey_plan
from photogram.survey import Block, PointCloud, Raster, TiePoints

CELL_M, GSD_M = 0.1, 0.05
GRID = MapGrid(1000.0, 2020.0, CELL_M, 200, 220)
CORNERS = np.array([[1006.0, 2006.0], [1014.0, 2013.0]])  # of a building with a flat roof


def surface(xy: np.ndarray, grown_m: float = 0.0) -> np.ndarray:
    """A slope with a building 5 m high, grown to all sides."""
    inside = np.all((xy > CORNERS[0] - grown_m) & (xy < CORNERS[1] + grown_m), axis=-1)
    return np.asarray(50.0 + 0.1 * (xy[..., 0] - 1000.0) + 5.0 * inside)


def raster(grown_m: float = 0.0) -> Raster:
    values = surface(dense_truth.centres_map_m(GRID), grown_m).reshape(GRID.rows, GRID.columns)
    return GRID.raster(values.astype(np.float32))


@pytest.fixture(scope="module", name="truth")
def _truth() -> Truth:
    xy = dense_truth.centres_map_m(GRID)
    building = np.all((xy > CORNERS[0]) & (xy < CORNERS[1]), axis=1).reshape(GRID.rows, GRID.columns)
    near = np.all((xy > CORNERS[0] - 1.0) & (xy < CORNERS[1] + 1.0), axis=1).reshape(GRID.rows, GRID.columns)
    seen = np.full(near.shape, 4, np.uint16)
    seen[:20] = 2
    return Truth(
        GRID,
        surface(xy).reshape(near.shape),
        seen,
        seen,
        ~near,
        dense_truth._outline_of(building, GRID),
        surface,
        GSD_M,
    )


def test_the_truth_itself_has_no_errors(truth: Truth) -> None:
    found = dense_scores.score(raster(), truth)
    assert found.completeness == found.within_of_seen == 1.0
    assert found.nmad_m < 1e-5
    assert found.seen == found.heights == 180 * 220
    assert found.edges.places == pytest.approx(300, abs=12)  # 15 m and 15 m of walls, but for the corners
    assert found.edges.p95_cells < 0.13  # half a step of the profiles: the true wall has no width


def test_holes_bad_heights_and_sigmas_are_counted(truth: Truth) -> None:
    rng = np.random.default_rng(1)
    heights, sigma_m = raster(), 0.4 * GSD_M
    values = heights.values + (0.01 + sigma_m * rng.standard_normal(heights.values.shape)).astype(np.float32)
    kind = rng.random(values.shape)
    values[kind < 0.10] = np.nan
    values[(kind >= 0.10) & (kind < 0.15)] += 0.5
    sigma = GRID.raster(np.full(values.shape, sigma_m, np.float32))
    found = dense_scores.score(GRID.raster(values), truth, sigma)
    assert found.completeness == pytest.approx(0.90, abs=0.01)
    assert found.error_rate == pytest.approx(0.05 / 0.90, abs=0.005)
    assert found.within_of_seen == pytest.approx(0.85, abs=0.01)
    assert found.median_m == pytest.approx(0.01, abs=0.005)
    assert found.nmad_gsd == pytest.approx(0.4, abs=0.05)
    assert found.normalised_nmad == pytest.approx(1.0, abs=0.12)


def test_a_raster_of_another_extent_counts_where_it_lies(truth: Truth) -> None:
    whole = raster()
    part = Raster(whole.values[50:90, 30:100], 1003.0, 2015.0, CELL_M)
    found = dense_scores.score(part, truth)
    assert found.heights == 40 * 70
    assert found.nmad_m < 1e-5
    with pytest.raises(ValueError, match="cells do not fall on cells"):
        dense_scores.score(replace(whole, west_map_m=1000.04), truth)


@pytest.mark.parametrize("grown_cells", [-3.0, 1.0, 2.5])
def test_displaced_edges(truth: Truth, grown_cells: float) -> None:
    edges = dense_scores.score(raster(grown_cells * CELL_M), truth).edges
    assert edges.bias_cells == pytest.approx(grown_cells, abs=0.6)
    assert edges.median_cells == pytest.approx(abs(grown_cells), abs=0.6)
    assert edges.missed == edges.unknown == edges.bridged == 0.0


def test_a_shifted_raster_moves_edges_by_its_shift(truth: Truth) -> None:
    heights = raster()
    edges = dense_scores.score(replace(heights, west_map_m=1000.0 + 3 * CELL_M), truth).edges
    assert edges.p95_cells == pytest.approx(3.0, abs=0.2)  # the walls in the east and west
    assert abs(edges.bias_cells) < 0.2


def test_a_building_that_is_not_there_and_a_moat(truth: Truth) -> None:
    gone = GRID.raster(raster(-20.0).values)
    edges = dense_scores.score(gone, truth).edges
    assert edges.missed == 1.0
    assert edges.median_cells == np.inf
    moat = raster()
    xy = dense_truth.centres_map_m(GRID).reshape(GRID.rows, GRID.columns, 2)
    around = np.all((xy > CORNERS[0] - 0.4) & (xy < CORNERS[1] + 0.4), axis=-1)
    inside = np.all((xy > CORNERS[0] + 0.2) & (xy < CORNERS[1] - 0.2), axis=-1)
    moat.values[around & ~inside] = np.nan
    edges = dense_scores.score(moat, truth).edges
    assert edges.bridged > 0.9
    assert edges.bias_cells == pytest.approx(1.0, abs=0.3)  # the middle of two cells within and four without


def test_what_a_building_hides() -> None:
    """The shadow of a wall 5 m high, 10 m from the foot of a camera 20 m above ground, is 10 · 5/15 m long."""
    level = GRID.raster(np.full((GRID.rows, GRID.columns), 50.0, np.float32))
    level.values[:, 100:120] = 55.0
    camera = Camera("c", 4000, 4000, 1000.0, np.array([1999.5, 1999.5]))
    down = np.diag([1.0, -1.0, -1.0])
    photograph = (camera, Pose(down, np.array([1002.0, 2010.0, 70.0])))
    truth = dense_truth.raster_truth(level, [photograph], CELL_M, GSD_M)
    row = truth.seen[100]
    first = np.flatnonzero(row[120:] > 0)[0] * CELL_M
    assert row[:119].min() == 1
    assert first == pytest.approx(10.0 * 5.0 / 15.0, abs=0.25)
    assert truth.height_at(np.array([[1010.5, 2010.0], [999.0, 2010.0]])) == pytest.approx([55.0, np.nan], nan_ok=True)


def test_agreement_with_another_cloud() -> None:
    heights = raster()
    rng = np.random.default_rng(2)
    xy = dense_truth.centres_map_m(GRID)
    xy = xy[(xy[:, 0] < 1010.0) & (rng.random(len(xy)) < 0.7)]
    other = np.column_stack([xy, surface(xy) - 1.5 + 0.02 * rng.standard_normal(len(xy))])
    heights.values[:20] = np.nan
    found = dense_scores.agreement(heights, PointCloud(other))
    assert found.cells == pytest.approx(200 * 100, rel=0.01)
    assert found.completeness == pytest.approx(0.9, abs=0.01)
    assert found.mean_m == pytest.approx(1.5, abs=0.002)
    assert found.nmad_m == pytest.approx(0.02, abs=0.001)
    assert found.bent_nmad_m == pytest.approx(0.02, abs=0.001)
    dome = 0.4 * ((xy[:, 0] - 1004.0) / 5.0) ** 2 - 0.1 * (xy[:, 1] - 2010.0) / 5.0
    bent = dense_scores.agreement(heights, PointCloud(other + np.column_stack([0 * dome, 0 * dome, dome])))
    assert bent.nmad_m > 0.1
    assert bent.bent_nmad_m == pytest.approx(0.02, abs=0.001)
    few = dense_scores.point_agreement(heights, PointCloud(other[::40]))
    assert few.mean_m == pytest.approx(1.5, abs=0.02)


def test_medians_of_cells() -> None:
    grid = MapGrid(0.0, 2.0, 1.0, 2, 2)
    points = np.array(
        [[0.5, 1.5, 3.0], [0.6, 1.4, 5.0], [0.1, 1.9, 4.0], [1.5, 0.5, 1.0], [1.2, 0.5, 2.0], [5, 5, 9.0]]
    )
    expected = np.array([[4.0, np.nan], [np.nan, 1.5]])
    np.testing.assert_array_equal(dense_scores.gridded_median(points, grid), expected)


def test_a_block_that_is_off_is_told_from_its_matching() -> None:
    plan = replace(
        SurveyPlan(), strips=2, photographs_per_strip=3, buildings=2, trees=3, control_points=3, check_points=0
    )
    survey = simulate(plan, 3)
    truth = dense_truth.simulated_truth(survey, 0.5)
    shift = np.array([1.0, -0.5, 0.7])
    step = survey.frame.rotation_world_from_map(np.zeros(3)) @ shift
    poses = tuple(replace(p, position_world_m=p.position_world_m + step) for p in survey.truth.poses)
    none = np.zeros(0, np.int64)
    empty = TiePoints(none, none, none, np.zeros((0, 2)), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    block = Block(
        survey.frame, (survey.truth.camera,), survey.photographs, poses, empty, survey.control_points, np.ones(3)
    )
    moved = dense_truth.as_adjusted(truth, survey, block)
    assert dense_truth.block_error(truth, survey, block)(dense_truth.centres_map_m(truth.grid)[::997]) == pytest.approx(
        np.tile(shift, (len(dense_truth.centres_map_m(truth.grid)[::997]), 1)), abs=2e-3
    )
    assert moved.height_map_m[1:, 2:] == pytest.approx(truth.height_map_m[:-1, :-2] + 0.7, abs=0.05, nan_ok=True)


def test_rows_of_rectified_pairs_are_epipolar_lines() -> None:
    """Of the full camera model, whichever way the base runs: along a strip or across."""
    made = simulate_block(
        whole_survey_plan(), 1, tie_points=1500, start_position_sigma_m=0.0, start_attitude_sigma_deg=0.0
    )
    tie = replace(made.block.tie_points, position_world_m=made.tie_point_position_world_m)
    block = replace(made.block, cameras=(made.truth.camera,), poses=made.truth.poses, tie_points=tie)
    chosen = rectified_pairs.choose_pairs(block, 3)
    assert set(np.concatenate(chosen)) == set(range(len(block.photographs)))
    for number in chosen[:4]:
        pair = rectified_pairs.rectify(block, number, 0.3)
        seen = [set(tie.point[tie.photograph == i]) for i in number]
        X = tie.position_world_m[sorted(seen[0] & seen[1])]
        places = []
        for side in (0, 1):
            pose = made.truth.poses[number[side]]
            ideal = image_plane(made.truth.camera, project_points(made.truth.camera, pose, X))
            ray = np.column_stack([ideal, np.ones(len(ideal))]) @ pose.rotation_world_from_camera.T
            places.append(ray @ pair.rotation_world_from_rectified @ pair.matrix(side).T)
            places[-1] = places[-1][:, :2] / places[-1][:, 2:]
        disparity = places[0][:, 0] - places[1][:, 0]
        assert np.abs(places[0][:, 1] - places[1][:, 1]).max() < 1e-6
        assert disparity.min() > 0
        assert disparity.max() < pair.disparities
        assert pair.world_m(places[0], disparity) == pytest.approx(X, abs=1e-6)
        u, _ = np.meshgrid(np.arange(1200.0), np.arange(900.0))
        picture, held = rectified_pairs.rectified(block, pair, 0, (u / 5).astype(np.uint8))
        within = np.rint(places[0]).astype(int)
        expected = project_points(made.truth.camera, made.truth.poses[number[0]], X)[:, 0] / 5
        assert held[within[:, 1], within[:, 0]].mean() > 0.97
        assert picture[within[:, 1], within[:, 0]] == pytest.approx(expected, abs=1.5)


def test_groups_of_heights_that_agree() -> None:
    cell = np.array([0, 0, 0, 0, 2, 2, 2, 2, 3])
    z = np.array([5.0, 1.0, 1.1, 1.2, 4.0, 7.0, 7.05, 4.2, 3.0], np.float32)
    begin, value = rectified_pairs._grouped(cell, z, 4)
    expected = [1.1, np.nan, 7.025, np.nan]
    assert rectified_pairs._modes(begin, value, 2, 0.3) == pytest.approx(expected, abs=1e-5, nan_ok=True)
    assert rectified_pairs._medians(begin, value, 1) == pytest.approx([1.15, np.nan, 5.6, 3.0], abs=1e-5, nan_ok=True)


def test_the_map_as_a_quadratic_of_the_world() -> None:
    frame = whole_survey_plan().frame
    rng = np.random.default_rng(3)
    place = rng.uniform([-150, -150, -10], [150, 150, 70], (500, 3))
    found = rectified_pairs.map_polynomial(frame, place)(place)
    assert found == pytest.approx(frame.map_from_world(place), abs=1e-4)


@pytest.mark.parametrize(("beyond_deg", "seen", "faced"), [(0.0, 1, 1), (9.0, 1, 1), (13.0, 1, 0), (35.0, 0, 0)])
def test_a_photograph_that_grazes_a_face_sees_it_and_does_not_look_at_it(
    beyond_deg: float, seen: int, faced: int
) -> None:
    """A face of 60° that falls to the east, from straight above (30° off it) and from further and further behind it."""
    xy = dense_truth.centres_map_m(GRID).reshape(GRID.rows, GRID.columns, 2)
    fall = np.tan(np.radians(60.0)) * (xy[..., 0] - xy[100, 120, 0])
    face = GRID.raster((50.0 - fall).astype(np.float32))
    place = np.array([*xy[100, 120], 50.0])
    camera = Camera("c", 4000, 4000, 1000.0, np.array([1999.5, 1999.5]))
    position = place + np.array([-10.0 * np.tan(np.radians(beyond_deg)), 0.0, 10.0])
    photograph = (camera, Pose(np.diag([1.0, -1.0, -1.0]), position))
    truth = dense_truth.raster_truth(face, [photograph], CELL_M, GSD_M)
    assert (truth.seen[100, 120], truth.faced[100, 120]) == (seen, faced)
