"""Point clouds with whatever their LAS or LAZ file says of each point: standard deviations, confidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from photogram.arrays import ByteArray, FloatArray, IntArray, check_shape, check_shapes
from photogram.errors import ProjectError
from photogram.files.clouds.points import las_colour, las_units, read_las

FIGURES = ("sigma z", "sigma xy", "confidence")


@dataclass(frozen=True, eq=False)
class DescribedCloud:
    """Points in the map: ``position_map_m`` (N, 3), ``colour`` (N, 3) uint8 or None, and what is known of each.

    ``figures`` holds those of FIGURES that there are, (N,) each: standard deviations in height and in plan, m, and the
    confidence, 0 to 1; NaN where one is not known.
    """

    position_map_m: FloatArray
    colour: ByteArray | None
    figures: Mapping[str, FloatArray]

    def __post_init__(self) -> None:
        n = len(self.position_map_m)
        check_shapes(self, position_map_m=(n, 3), colour=(n, 3))
        for name, values in self.figures.items():
            check_shape(name, values, (n,))

    def __len__(self) -> int:
        return len(self.position_map_m)

    def chosen(self, index: IntArray) -> DescribedCloud:
        """Return the points of an index (M,), in its order."""
        colour = None if self.colour is None else self.colour[index]
        figures = {name: values[index] for name, values in self.figures.items()}
        return DescribedCloud(self.position_map_m[index], colour, figures)


def read_described(path: Path) -> DescribedCloud:
    """Return the cloud of a .las or .laz file with its colours and those of FIGURES that stand in its extra bytes, in
    metres, whatever the units of the map that it names.

    Names are compared without regard to capitals and underscores; whole numbers of a confidence are per cent. Raises
    ProjectError where the file is missing, damaged or empty.
    """
    points = read_las(path)
    if len(points) == 0:
        raise ProjectError(f"point cloud {path}: it contains no points: export it again")
    position = np.asarray(points.xyz, dtype=np.float64)
    if not np.isfinite(position).all():
        raise ProjectError(f"point cloud {path}: it has non-finite positions, it is damaged: export it again")
    known = {name.casefold().replace("_", " "): name for name in points.point_format.extra_dimension_names}
    figures = {name: np.asarray(points[known[name]]) for name in FIGURES if name in known}
    if "confidence" in figures and np.issubdtype(figures["confidence"].dtype, np.integer):
        figures["confidence"] = figures["confidence"] / 100.0
    figures = {name: values.astype(np.float64) for name, values in figures.items()}
    units = las_units(points.header)
    for name, unit_m in (("sigma z", units.height_m), ("sigma xy", units.plan_m)):
        if name in figures:
            figures[name] = figures[name] * unit_m
    return DescribedCloud(position * units.factors, las_colour(points), figures)
