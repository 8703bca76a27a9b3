"""How many photographs see the ground: against geometry and a second projection."""

from collections.abc import Sequence

import numpy as np
import pytest
from makers import bare_adjustment
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose, project_points
from photogram.geodesy.frames import LocalFrame
from photogram.report.numbers.overlap import CELLS, Overlap, ground_overlap
from photogram.results import Adjustment
from photogram.survey import Block, ControlPoints, Photograph, Raster, TiePoints

FRAME = LocalFrame("EPSG:25832", (602340.0, 5794120.0, 100.0), "grid")
NADIR = np.diag([1.0, -1.0, -1.0])
# 80 m over the ground, 1000 px to 100 m: a pixel is 0.1 m, a photograph covers 100 m by 60 m
CAMERA = Camera("square", 1000, 600, 800.0, np.array([499.5, 299.5]))


def nothing(*shape: int) -> FloatArray:
    return np.zeros(shape)


def block_of(points: FloatArray, poses: Sequence[Pose | None], camera: Camera = CAMERA) -> Adjustment:
    """An adjustment of photographs over tie points (P, 3); each point is observed in every registered photograph."""
    seen = [i for i, pose in enumerate(poses) if pose is not None]
    photograph = np.tile(np.array(seen, dtype=np.int64), len(points))
    point = np.repeat(np.arange(len(points)), len(seen))
    n = len(point)
    ties = TiePoints(photograph, point, nothing(n).astype(np.int64), nothing(n, 2), np.ones(n), points,
                     np.zeros((len(points), 3), np.uint8))  # fmt: skip
    no_marks = np.zeros(0, dtype=np.int64)
    ground = ControlPoints((), (), nothing(0, 3), nothing(0, 3), no_marks, no_marks, nothing(0, 2), nothing(0, 2, 2))
    photographs = tuple(Photograph(f"{i}.JPG", 0) for i in range(len(poses)))
    block = Block(FRAME, (camera,), photographs, tuple(poses), ties, ground)
    return bare_adjustment(block, nothing(len(poses), 3, 3), nothing(len(poses), 3, 3))


def level(width_m: float, height_m: float, count: int = 4000, seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.5, 0.5, (2, count))
    return np.column_stack([width_m * x, height_m * y, np.zeros(count)])


def overlap_of(result: Adjustment) -> Overlap | None:
    return ground_overlap(result, FRAME.map_from_world(result.block.tie_points.position_world_m))


def centres_world_m(raster: Raster) -> FloatArray:
    rows, columns = raster.values.shape
    easting, northing = np.meshgrid(
        raster.west_map_m + (np.arange(columns) + 0.5) * raster.cell_m,
        raster.north_map_m - (np.arange(rows) + 0.5) * raster.cell_m,
    )
    return np.dstack([easting - 602340.0, northing - 5794120.0])


def test_rectangles_over_level_ground() -> None:
    """Two photographs side by side, 50 m apart: their footprints are known to the millimetre."""
    poses = [Pose(NADIR, np.array([-25.0, 0.0, 80.0])), Pose(NADIR, np.array([25.0, 5.0, 80.0]))]
    overlap = overlap_of(block_of(level(200.0, 100.0), poses))
    assert overlap is not None
    values, place = overlap.photographs.values, centres_world_m(overlap.photographs)
    inside = [(np.abs(place[..., 0] - x) <= 50.0) & (np.abs(place[..., 1] - y) <= 30.0) for x, y in ((-25, 0), (25, 5))]
    known = np.isfinite(values)
    assert known.mean() > 0.95
    assert np.array_equal(values[known], (inside[0].astype(int) + inside[1])[known])
    assert max(values.shape) == CELLS
    assert overlap.area_m2 == pytest.approx(50.0 * 55.0, rel=0.03)
    assert overlap.share_amid == np.mean(values[known] == 2)
    assert overlap.share(2) == 1.0
    assert overlap.share(3) == 0.0
    assert overlap.amid[known].all()


def test_ground_reaches_as_far_as_two_photographs_show_it() -> None:
    """Tie points on a small part of what three photographs show: areas are those of the rectangles."""
    poses = [Pose(NADIR, np.array([x, 0.0, 80.0])) for x in (-25.0, 0.0, 25.0)]
    overlap = overlap_of(block_of(level(20.0, 20.0), poses))
    assert overlap is not None
    assert overlap.area_m2 == pytest.approx(100.0 * 60.0, rel=0.02)
    assert overlap.share(3) == pytest.approx(0.5, abs=0.01)
    assert np.median(overlap.counts) == 2.5
    assert overlap.share_amid == 1.0
    assert np.count_nonzero(overlap.amid) * overlap.photographs.cell_m**2 == pytest.approx(400.0, rel=0.06)


def hills(plan: FloatArray) -> FloatArray:
    """Heights without any symmetry."""
    return np.asarray(6 * np.sin(plan[:, 0] / 30 + 0.5) + 4 * np.cos(plan[:, 1] / 25 - 0.7) + 0.08 * plan[:, 1])


def test_any_camera_and_pose_as_the_projection_says() -> None:
    """Tilted photographs with a distortion that folds back within the picture's reach, over hills."""
    camera = Camera(
        "barrel", 900, 700, 500.0, np.array([440.0, 360.0]), np.array([-0.25, 0.02, 0.0, 0.0]), np.array([1e-3, 2e-3])
    )
    assert np.isfinite(camera.largest_radius)
    rng = np.random.default_rng(4)
    points = level(400.0, 300.0, 3000)
    points[:, 2] = hills(points)
    poses = []
    for _ in range(25):
        turn = NADIR @ Rotation.from_rotvec(0.4 * rng.standard_normal(3)).as_matrix()
        poses.append(Pose(turn, np.array([*rng.uniform(-150, 150, 2), rng.uniform(40, 90)])))
    result = block_of(points, poses, camera)
    overlap = overlap_of(result)
    assert overlap is not None
    raster = overlap.photographs
    known = np.isfinite(raster.values) & overlap.amid
    # between tie points the hills are a little lower than they should be, so counts differ along edges of footprints
    plan = centres_world_m(raster)[known]
    place = np.column_stack([plan, hills(plan)])
    expected = np.sum(
        [camera.contains(np.nan_to_num(project_points(camera, pose, place), nan=-99.0)) for pose in poses], axis=0
    )
    difference = np.abs(raster.values[known] - expected)
    assert np.mean(difference > 0) < 0.08
    assert raster.values[known].max() > 4
    # on level ground the surface has no error, and no count differs
    flat = block_of(level(400.0, 300.0, 3000), poses, camera)
    overlap = overlap_of(flat)
    assert overlap is not None
    known = np.isfinite(overlap.photographs.values)
    plan = centres_world_m(overlap.photographs)[known]
    place = np.column_stack([plan, np.zeros(len(plan))])
    expected = np.sum(
        [camera.contains(np.nan_to_num(project_points(camera, pose, place), nan=-99.0)) for pose in poses], axis=0
    )
    assert np.array_equal(overlap.photographs.values[known], expected)
    assert np.array_equal(overlap.counts, expected[expected >= 2])
    assert overlap.area_m2 == np.count_nonzero(expected >= 2) * overlap.photographs.cell_m**2


def test_a_photograph_that_is_not_registered_sees_nothing() -> None:
    pose = Pose(NADIR, np.array([0.0, 0.0, 80.0]))
    with_it, without = (overlap_of(block_of(level(60.0, 40.0), [pose, other])) for other in (pose, None))
    assert with_it is not None
    assert without is not None
    assert np.nanmax(with_it.photographs.values) == 2
    assert with_it.area_m2 == pytest.approx(100.0 * 60.0, rel=0.02)
    assert np.nanmax(without.photographs.values) == 1
    assert without.area_m2 == 0.0


def test_distant_points_do_not_coarsen_the_cells() -> None:
    pose = Pose(NADIR, np.array([0.0, 0.0, 80.0]))
    points = level(60.0, 40.0)
    far = np.vstack([points, [[5000.0, 3000.0, 0.0], [-9000.0, 10.0, 0.0]]])
    found = [overlap_of(block_of(p, [pose])) for p in (points, far)]
    assert all(o is not None and 0.55 < o.photographs.cell_m < 0.65 for o in found)


def test_ground_beyond_a_wide_gap_is_not_bridged() -> None:
    pose = Pose(NADIR, np.array([0.0, 0.0, 80.0]))
    points = level(90.0, 20.0, 8000)
    gap = points[np.abs(points[:, 0]) > 20.0]
    overlap = overlap_of(block_of(gap, [pose]))
    assert overlap is not None
    values, place = overlap.photographs.values, centres_world_m(overlap.photographs)
    assert np.isnan(values[np.abs(place[..., 0]) < 18.0]).all()
    assert np.count_nonzero(overlap.amid) * overlap.photographs.cell_m**2 == pytest.approx(50.0 * 20.0, rel=0.08)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((2, 3)),
        np.zeros((50, 3)),
        np.linspace(0, 50, 300)[:, None] * np.array([1.0, 2.0, 0.0]),
    ],
    ids=["none", "two", "one place", "a line"],
)
def test_points_that_span_no_area_have_no_overlap(points: FloatArray) -> None:
    assert overlap_of(block_of(points, [Pose(NADIR, np.array([0.0, 0.0, 80.0]))])) is None
