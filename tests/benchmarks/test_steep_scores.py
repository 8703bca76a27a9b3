"""The scores of steep ground on surfaces made for them."""

import numpy as np
import pytest
from lib.dense_truth import Outline, Truth, centres_map_m
from lib.simulated.steep_site import Heap
from lib.steep_scores import WALLS, slope_classes, steep_scores, true_slope_deg, volume_errors

from photogram.geodesy.frames import LocalFrame
from photogram.grid import MapGrid

CELL_M, GSD_M = 0.1, 0.05
FRAME = LocalFrame("EPSG:25832", (600000.0, 5800000.0, 50.0))
GRID = MapGrid(599990.0, 5800010.0, CELL_M, 200, 200)
HEAP = Heap(0.0, 0.0, 5.0, 2.0, 3.0, 45.0)


def surface(xy_map: np.ndarray) -> np.ndarray:
    """A heap with a face of 45° on a plane that rises by a quarter to the east, and a wall in the west."""
    middle = FRAME.map_from_world(np.array([[HEAP.east_m, HEAP.north_m, 0.0]]))[0, :2]
    east = xy_map[..., 0] - 599990.0
    heap = np.clip(HEAP.foot_m - np.linalg.norm(xy_map - middle, axis=-1), 0.0, HEAP.height_m)
    return np.asarray(50.0 + 0.25 * east + heap + 4.0 * (east < 2.0))


@pytest.fixture(scope="module", name="truth")
def _truth() -> Truth:
    height = surface(centres_map_m(GRID)).reshape(GRID.rows, GRID.columns)
    seen = np.full(height.shape, 5, np.uint16)
    seen[:20] = 2
    nothing = Outline(np.zeros((0, 2)), np.zeros((0, 2)))
    return Truth(GRID, height, seen, seen, np.ones(height.shape, bool), nothing, surface, GSD_M)


def test_slopes_are_those_over_the_cell_and_walls_stand_apart(truth: Truth) -> None:
    slope = true_slope_deg(truth)
    classes = slope_classes(slope)
    assert np.sum(list(classes.values()), axis=0).max() == 1
    assert slope[100, 40] == pytest.approx(np.degrees(np.arctan(0.25)), abs=1e-6)
    assert classes["0 to 15°"][100, 40]
    assert classes[WALLS][:, 18:21].all()  # east of 2 m lies between columns 19 and 20
    assert not classes[WALLS][:, 22:].any()
    # up the face to the east the plane's rise is added
    assert slope[100, 65] == pytest.approx(np.degrees(np.arctan(1.25)), abs=0.1)


def test_errors_are_counted_in_the_class_of_their_cells(truth: Truth) -> None:
    rng = np.random.default_rng(4)
    sigma_m = 0.5 * GSD_M
    height = truth.height_map_m + sigma_m * rng.standard_normal(truth.height_map_m.shape)
    steep = slope_classes(true_slope_deg(truth))["50 to 60°"]
    hit = np.flatnonzero(steep & (truth.seen >= 3))
    bad, gross, holes = np.split(rng.permutation(hit)[: 3 * (len(hit) // 10)], 3)
    height.flat[bad] += 5.0 * GSD_M
    height.flat[gross] -= 20.0 * GSD_M
    height.flat[holes] = np.nan
    raster = GRID.raster(height.astype(np.float32))
    own = GRID.raster(np.full(height.shape, sigma_m, np.float32))
    scores = {s.name: s for s in steep_scores(raster, own, truth)}
    hurt, level = scores["50 to 60°"], scores["0 to 15°"]
    assert hurt.completeness == pytest.approx(0.9, abs=0.01)
    assert hurt.bad == pytest.approx(2.0 / 9.0, abs=0.01)
    assert hurt.gross == pytest.approx(1.0 / 9.0, abs=0.01)
    assert level.completeness == 1.0
    assert level.bad == level.gross == 0.0
    assert level.nmad_gsd == pytest.approx(0.5, abs=0.02)
    assert level.within == pytest.approx((0.683, 0.954, 0.997), abs=0.01)
    assert level.cells < np.sum(slope_classes(true_slope_deg(truth))["0 to 15°"])  # without those that two see


def test_a_volume_is_off_by_what_is_laid_on_the_heap(truth: Truth) -> None:
    east, north = GRID.centres_map_m(GRID.whole)
    on_top = np.hypot(*np.meshgrid(east - 600000.0, north - 5800000.0)) < HEAP.top_m
    raised = truth.height_map_m + 0.1 * on_top
    ((heap, share),) = volume_errors(GRID.raster(raised.astype(np.float32)), truth, [HEAP], FRAME)
    assert heap is HEAP
    assert share == pytest.approx(0.1 * np.pi * HEAP.top_m**2 / HEAP.volume_m3, rel=0.02)
    raised[90:110, 90:110] = np.nan
    assert not volume_errors(GRID.raster(raised.astype(np.float32)), truth, [HEAP], FRAME)
