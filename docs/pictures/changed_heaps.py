"""Compare two simulated epochs and draw what has changed: docs/pictures/changed_heaps.png.

Call: PYTHONPATH=benchmarks python docs/pictures/changed_heaps.py [OUTPUT].
"""

import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyogrio
import shapely
from lib.simulated_changes import CORNER, CRS, Errors, Heap, epoch, grid_at, uneven

from photogram.arrays import FloatArray
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.files.maps.rasters import write_raster
from photogram.survey import Raster

HEAPS = {"gravel": Heap(-20.0, 10.0, 8.0, 0.5), "sand": Heap(14.0, -6.0, 5.0, 0.5), "pit": Heap(24.0, 18.0, 6.0, -0.4)}
HOLE = slice(160, 190), slice(90, 130)
CELL_M, CORRELATION_M = 0.2, 1.0


def later(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the ground of the later epoch."""
    return np.asarray(uneven(x, y) + sum(heap.height(x, y) for heap in HEAPS.values()))


def polygons(path: Path, outlines: dict[str, shapely.Geometry]) -> Path:
    """Write polygons with their names."""
    pyogrio.raw.write(
        path, geometry=shapely.to_wkb(np.array(list(outlines.values()), dtype=object)),
        field_data=[np.array(list(outlines), dtype=object)], fields=["name"], driver="GPKG", geometry_type="Polygon",
        crs=CRS,
    )  # fmt: skip
    return path


def main(output: Path) -> None:
    """Survey twice, compare, and copy the picture."""
    rng, grid = np.random.default_rng(5), grid_at(0.0, 0.0, 76.0, CELL_M)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for epoch_name, ground in (("may", uneven), ("june", later)):
            survey = epoch(ground, grid, Errors(), rng)
            for part, raster in (("", survey.heights), ("_sigma", survey.sigma), ("_sigma_own", survey.own)):
                assert raster is not None
                values = raster.read(grid.whole)
                if epoch_name == "june":
                    values[HOLE] = np.nan
                tile = Raster(values, grid.west_map_m, grid.north_map_m, grid.cell_m)
                write_raster(folder / f"{epoch_name}{part}.tif", tile, CRS)
        east, north = CORNER
        heaps = {
            n: shapely.Point(east + h.east_m, north + h.north_m).buffer(h.radius_m + 1.0) for n, h in HEAPS.items()
        }
        stable = {
            "road": shapely.box(east - 35, north - 35, east + 35, north - 20),
            "yard": shapely.box(east - 5, north + 26, east + 35, north + 36),
        }
        request = SurfaceRequest(
            folder / "june.tif", folder / "may.tif", polygons(folder / "heaps.gpkg", heaps),
            polygons(folder / "stable.gpkg", stable), "tilt", correlation_m=CORRELATION_M,
        )  # fmt: skip
        compare_surfaces(request, folder / "out")
        shutil.copyfile(folder / "out" / "comparison.png", output)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("changed_heaps.png"))
