"""Two simulated epochs: is unchanged ground within the level of detection, and are volumes off by what they say?

    python benchmarks/change.py [--heaps 200] [--draws 10] [--pairs 600] [--seed 1]

Every pair of epochs has noise of 1 to 3 cm that is correlated over 5 cells, and common errors of both blocks: shifts of
1.5 cm in plan and 2 cm in height, a tilt of 1 cm and a dome of 0.5 cm at 100 m (one standard deviation each).

The first table is the share of unchanged ground within the level of detection, a mean over pairs of surveys: of
surfaces cell by cell, and of clouds by M3C2 (py4dgeo), with the level by predicted sigmas, by roughness alone as
py4dgeo gives it, and by roughness with the common errors of both as registration error, added linearly (Lague et al.
2013, eq. 1).

The second table is of heaps and pits, each surveyed --draws times anew: errors of volumes over the predicted sigma.
`mean` is that of the error over sigma, `rms` its root mean square: 1 where sigma is neither too small nor too large.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from lib.simulated_changes import CORNER, Errors, Heap, epoch, grid_at, uneven

from photogram.arrays import FloatArray
from photogram.change.m3c2 import CloudErrors, m3c2
from photogram.grid import Window
from photogram.survey import PointCloud
from photogram.volumes.differences import UNCHANGED, Correction, Difference, difference_of
from photogram.volumes.stable_ground import registration_of
from photogram.volumes.surfaces import SurfaceFiles
from photogram.volumes.volumes import Volume, VolumeSums

CELL_M = 0.2
BLOCK_M = 80.0
"""Heaps lie within this distance of the middle of the block, east and north."""
RIM_M, STABLE_M = 1.0, 6.0
"""From the foot of a heap to its polygon, and from there on stable ground to the rim of what is simulated."""
FINE = 5
"""Cells of the true volume to a side of a cell."""
CASES = {
    "own and common errors": Errors(),
    "own errors alone": replace(Errors(), shift_m=(0.0, 0.0, 0.0), tilt_m=0.0, dome_m=0.0),
    "common errors alone": replace(Errors(), own_m=(0.0, 0.0)),
}


def heaps(count: int, rng: np.random.Generator) -> list[Heap]:
    """Return as many heaps as pits, 8 to 24 m wide and 1 to 8 m high or deep."""
    return [
        Heap(
            float(rng.uniform(-BLOCK_M, BLOCK_M)), float(rng.uniform(-BLOCK_M, BLOCK_M)), float(rng.uniform(4.0, 12.0)),
            float(rng.uniform(0.25, 0.7) * (1 if n % 2 else -1)),
        )
        for n in range(count)
    ]  # fmt: skip


def true_volume_m3(heap: Heap) -> float:
    """Return the volume of a heap by fine cells."""
    grid = grid_at(heap.east_m, heap.north_m, 2.0 * heap.radius_m + 2.0, CELL_M / FINE)
    east, north = grid.centres_map_m(grid.whole)
    return float(heap.height(*np.meshgrid(east - CORNER[0], north - CORNER[1])).sum() * grid.cell_m**2)


def surveys(heap: Heap, errors: Errors, rng: np.random.Generator) -> Difference:
    """Return the ground before and after a heap, surveyed once each."""
    grid = grid_at(heap.east_m, heap.north_m, 2.0 * (heap.radius_m + RIM_M + STABLE_M), CELL_M)

    def after(x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(uneven(x, y) + heap.height(x, y))

    return difference_of(epoch(uneven, grid, errors, rng), epoch(after, grid, errors, rng))


def volume_of(difference: Difference, heap: Heap, correction: Correction | None) -> Volume:
    """Return the volume within a polygon around a heap."""
    place = shapely.Point(CORNER[0] + heap.east_m, CORNER[1] + heap.north_m)
    grid, margin = difference.grid, difference.margin
    sums = VolumeSums("heap", place.buffer(heap.radius_m + RIM_M), grid, difference.patterns(correction))
    outer = Window(-margin, -margin, grid.rows + margin, grid.columns + margin)
    sums.add(difference, difference.cells(outer, correction), outer, grid.whole)
    return sums.volume()


def around(heap: Heap) -> list[shapely.Geometry]:
    """Return the ground around a heap that has not moved, as far as it is simulated."""
    place = shapely.Point(CORNER[0] + heap.east_m, CORNER[1] + heap.north_m)
    side = heap.radius_m + RIM_M + STABLE_M
    box = shapely.box(place.x - side, place.y - side, place.x + side, place.y + side)
    return [box - place.buffer(heap.radius_m + RIM_M)]


def row(name: str, z: Sequence[float]) -> str:
    """Return a line of the table of volumes."""
    off = np.array(z)
    shares = " | ".join(f"{np.mean(np.abs(off) < k):.1%}" for k in (1, 2, 3))
    return f"| {name} | {len(off)} | {off.mean():+.2f} | {np.sqrt(np.mean(off**2)):.2f} | {shares} |"


def volumes(count: int, draws: int, rng: np.random.Generator) -> None:
    """Print the errors of volumes over their standard deviations."""
    kinds: dict[str, Callable[[Volume, float], float]] = {
        "net": lambda v, true: (v.net_m3 - true) / v.net_sigma_m3,
        "fill of heaps, cut of pits": lambda v, true: (
            (v.fill_m3 - true) / v.fill_sigma_m3 if true > 0 else (v.cut_m3 + true) / v.cut_sigma_m3
        ),
        "net, without what neighbours share": lambda v, true: (
            (v.net_m3 - true) / np.hypot(v.own_sigma_m3 / 5.0, v.common_sigma_m3)
        ),
        "net, without common errors": lambda v, true: (v.net_m3 - true) / v.own_sigma_m3,
    }
    shown = {"own and common errors": tuple(kinds)[::3] + tuple(kinds)[1:2], "own errors alone": tuple(kinds)[:3:2]}
    print("\n| volumes | n | mean | rms | within 1 sigma | 2 | 3 |\n|---|---|---|---|---|---|---|")
    sites = heaps(count, rng)
    truth = [true_volume_m3(heap) for heap in sites]
    for name, wanted in shown.items():
        plain: list[tuple[Volume, float]] = []
        aligned: list[tuple[Volume, float]] = []
        for heap, true in zip(sites * draws, truth * draws, strict=True):
            difference = surveys(heap, CASES[name], rng)
            plain.append((volume_of(difference, heap, None), true))
            if name == "own and common errors":
                correction = registration_of(difference, around(heap), "tilt")[1]
                aligned.append((volume_of(difference, heap, correction), true))
        for kind in wanted:
            print(row(f"{name}: {kind}", [kinds[kind](v, true) for v, true in plain]))
        if aligned:
            z = [kinds["net"](v, true) for v, true in aligned]
            print(row(f"{name}: net, offset and tilt taken off on stable ground", z))
            sigma = [float(np.median([v.net_sigma_m3 / abs(true) for v, true in of])) for of in (plain, aligned)]
            print(
                f"| median sigma {sigma[0]:.1%} of the volume, with offset and tilt taken off {sigma[1]:.2%} |"
                + 6 * " |"
            )


def cloud_of(survey: SurfaceFiles) -> tuple[PointCloud, CloudErrors]:
    """Return a survey's cells as points, with their errors."""
    grid = survey.heights.grid
    assert survey.sigma is not None
    assert survey.own is not None
    east, north = np.meshgrid(*grid.centres_map_m(grid.whole))
    height, whole, own = (
        r.read(grid.whole).astype(np.float64).ravel() for r in (survey.heights, survey.sigma, survey.own)
    )
    common = np.sqrt(np.maximum(whole**2 - own**2, 0.0))
    return PointCloud(np.column_stack([east.ravel(), north.ravel(), height])), CloudErrors(
        own, common, survey.correlation_m
    )


def unchanged(pairs: int, rng: np.random.Generator) -> None:
    """Print the shares of unchanged ground within the level of detection."""
    print("| unchanged ground within its level | surface | M3C2, sigmas | M3C2, roughness | and registration |")
    print("|---|---|---|---|---|")
    for name, errors in CASES.items():
        shares: list[list[float]] = []
        for _ in range(pairs):
            east, north = rng.uniform(-BLOCK_M, BLOCK_M, 2)
            grid = grid_at(float(east), float(north), 14.0, CELL_M)
            epochs = [epoch(uneven, grid, errors, rng) for _ in range(2)]
            cells = difference_of(epochs[0], epochs[1]).cells(grid.whole)
            (first, of_first), (second, of_second) = (cloud_of(e) for e in epochs)
            by_sigma = m3c2(first, second, errors=(of_first, of_second))
            common_m = float(np.sqrt(np.mean(of_first.common_m**2 + of_second.common_m**2)))
            known = np.isfinite(by_sigma.level_m)
            distance = np.abs(by_sigma.distance_m[known])
            levels = (
                by_sigma.level_m[known], by_sigma.roughness_level_m[known],
                by_sigma.roughness_level_m[known] + 1.959964 * common_m,
            )  # fmt: skip
            shares.append(
                [float(np.mean(cells.codes == UNCHANGED)), *(float(np.mean(distance <= level)) for level in levels)]
            )
        print(f"| {name} | " + " | ".join(f"{share:.1%}" for share in np.mean(shares, axis=0)) + " |")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--heaps", type=int, default=200)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--pairs", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    unchanged(given.pairs, np.random.default_rng(given.seed))
    volumes(given.heaps, given.draws, np.random.default_rng(given.seed))


if __name__ == "__main__":
    main()
