"""Ground filters on simulated sites whose bare terrain is known, and on a classified tile of airborne lidar.

    python benchmarks/terrain.py [--seeds 3 4] [--cloth]

Each row is a class of site (benchmarks/lib/simulated/terrain_sites.py), each group of columns a filter: type I (ground
rejected, % of the ground), type II (objects accepted, % of the objects), total (% of both), as Sithole and Vosselman
(2004) define them, and the RMS of the terrain against the truth in metres, where photogram makes one. All filters take
one set of parameters for all sites; the terrain is linear between what each takes for ground. `own` is photogram's;
`over sigma` the RMS of its errors over their stated standard deviations, in interpolated cells and in all.

The filter was developed on the sites of seeds 1 and 2.

--cloth compares the cloth simulation too (package csf-3dfin, Python up to 3.13), which takes 20 s for a site.

The tile is Topography.laz of ../shared/data/terrain (wooded, a lake): the highest point of each square metre is the
surface, points of the classes ground and water are the ground.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple

import laspy
import numpy as np
from lib.ground_filters import Filter, cloth, progressive_morphology, smrf
from lib.shared_data import SHARED_DATA
from lib.simulated.terrain_sites import SITES, TerrainSite, terrain_site
from lib.terrain_scores import TerrainScores, terrain_scores
from scipy.interpolate import LinearNDInterpolator

from photogram.arrays import BoolArray, FloatArray
from photogram.surface.dtm import terrain_from_surface
from photogram.survey import Raster

TILE = SHARED_DATA / "terrain" / "Topography.laz"
TILE_SIGMA_M = 0.1
GROUND_CLASSES = (2, 9)


def linear_terrain(heights_m: FloatArray, ground: BoolArray) -> FloatArray:
    """Return heights (rows, columns), linear between the ground where there is none; NaN beyond it."""
    beside = np.zeros(ground.shape, dtype=bool)
    for axis in (0, 1):
        for step in (1, -1):
            beside |= np.roll(~ground, step, axis)
    edge = ground & beside
    terrain = np.where(ground, heights_m, np.nan)
    if edge.sum() > 3 and not ground.all():
        terrain[~ground] = LinearNDInterpolator(np.argwhere(edge), heights_m[edge])(np.argwhere(~ground))
    return terrain


def own_scores(site: TerrainSite) -> TerrainScores:
    """Return the scores of photogram's terrain."""
    made = terrain_from_surface(site.surface, site.sigma)
    heights, sigma = made.heights.values.astype(float), made.sigma.values.astype(float)
    accepted = np.isfinite(heights) & ~made.interpolated
    return terrain_scores(accepted, site.ground, site.objects, heights - site.terrain_m, sigma)


def scores_of(ground_filter: Filter) -> Callable[[TerrainSite], TerrainScores]:
    """Return what scores a filter on a site, the terrain judged where the surface has a height."""

    def scored(site: TerrainSite) -> TerrainScores:
        heights = site.surface.values.astype(float)
        accepted = ground_filter(heights, site.surface.cell_m)
        terrain = np.where(np.isfinite(heights), linear_terrain(heights, accepted), np.nan)
        return terrain_scores(accepted, site.ground, site.objects, terrain - site.terrain_m)

    return scored


def classified_tile() -> TerrainSite:
    """Return the tile as a surface of its highest points, in cells of a metre, and the terrain of its ground."""
    cloud = laspy.read(TILE)
    position, kind = np.asarray(cloud.xyz), np.asarray(cloud.classification)
    low = np.floor(position[:, :2].min(axis=0))
    column, row = np.floor(position[:, :2] - low).astype(int).T
    rows, columns = row.max() + 1, column.max() + 1
    row = rows - 1 - row
    surface = np.full((rows, columns), np.nan)
    code = np.zeros((rows, columns), dtype=int)
    order = np.argsort(position[:, 2])
    surface[row[order], column[order]] = position[order, 2]
    code[row[order], column[order]] = kind[order]
    of_ground = np.isin(kind, GROUND_CLASSES)
    between = LinearNDInterpolator(position[of_ground, :2] - low, position[of_ground, 2])
    y, x = np.indices(surface.shape) + 0.5
    terrain = between(x, rows - y)
    known = np.isfinite(surface) & np.isfinite(terrain)
    ground = known & np.isin(code, GROUND_CLASSES)
    objects = known & ~np.isin(code, GROUND_CLASSES) & (surface - terrain > 0.5)

    def raster(values: FloatArray) -> Raster:
        return Raster(values.astype(np.float32), 0.0, float(rows), 1.0)

    return TerrainSite(raster(surface), raster(np.where(known, TILE_SIGMA_M, np.nan)), terrain, ground, objects)


def print_row(
    name: str, sites: Sequence[TerrainSite], filters: Mapping[str, Callable[[TerrainSite], TerrainScores]]
) -> None:
    """Print a class of sites: the means over them."""
    line = f"{name:28}"
    for scores in filters.values():
        each = [scores(site) for site in sites]
        type_i, type_ii, total, rms_m = np.mean([astuple(s)[:4] for s in each], axis=0)
        second = "    –" if np.isnan(type_ii) else f"{100 * type_ii:5.1f}"
        line += f" |{100 * type_i:5.1f} {second} {100 * total:5.2f} {rms_m:6.3f}"
        if not np.isnan(each[0].over_sigma[1]):
            line += "  {:4.2f} {:4.2f}".format(*np.mean([s.over_sigma for s in each], axis=0))
    print(line, flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[3, 4])
    parser.add_argument("--cloth", action="store_true")
    given = parser.parse_args()
    compared = {"SMRF": smrf, "progr. morphology": progressive_morphology} | ({"cloth": cloth} if given.cloth else {})
    filters = {name: scores_of(of) for name, of in compared.items()} | {"own": own_scores}
    print(f"{'':28}" + "".join(f" | {name:23}" for name in filters))
    print(f"{'':28}" + " |    I    II total    RMS" * len(filters) + "  over sigma")
    for name in SITES:
        print_row(name, [terrain_site(name, seed) for seed in given.seeds], filters)
    if TILE.is_file():
        print_row("lidar tile, wooded", [classified_tile()], filters)
    else:
        print(f"lidar tile: left out, there is no {TILE}")


if __name__ == "__main__":
    main()
