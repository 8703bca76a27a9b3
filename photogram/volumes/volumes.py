"""Cut and fill within polygons, each with its standard deviation.

V = Σ a d over the cells, a the area of a cell within the polygon. Its variance has three parts: own errors of cells,
correlated over the width of a window; common errors, whose every pattern g adds (Σ a g)²; and the corners of the
polygon, each off by the same standard deviation. Fill counts where the later surface is higher, cut where it is lower.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.arrays import FloatArray
from photogram.grid import MapGrid, Window
from photogram.volumes.differences import LEVEL, Difference, DifferenceCells, own_variance
from photogram.volumes.outlines import Geometry, OutlineSamples, coverage, outline_samples
from photogram.wording import percent

KINDS = 3
"""Volumes of a polygon: net, fill and cut."""


@dataclass(frozen=True)
class Volume:
    """Volumes within a polygon, m³, and what they rest on."""

    name: str
    """Of the polygon."""
    area_m2: float
    """Of the polygon."""
    measured_m2: float
    """Of it, where both surfaces were measured."""
    interpolated_m2: float
    """Where one of them was filled from its neighbours."""
    unmeasured_m2: float
    """Where one of them has no height: not counted."""
    net_m3: float
    """Fill less cut: later minus earlier."""
    net_sigma_m3: float
    """Its standard deviation."""
    fill_m3: float
    """Where the later surface is higher."""
    fill_sigma_m3: float
    """Its standard deviation."""
    cut_m3: float
    """Where it is lower, positive."""
    cut_sigma_m3: float
    """Its standard deviation."""
    own_sigma_m3: float
    """Part of the net volume's standard deviation by own errors of the cells."""
    common_sigma_m3: float
    """By errors that cells share."""
    outline_sigma_m3: float
    """By the corners of the polygon."""
    noise_m3: float
    """What noise alone adds to both fill and cut; in their standard deviations."""
    interpolated_m3: float
    """Part of the net volume in filled cells, which has no standard deviation."""
    detected_fill_m3: float
    """Fill in cells beyond the level of detection."""
    detected_cut_m3: float
    """Cut in cells beyond the level of detection."""


def volume_label(volume_m3: float, sigma_m3: float) -> str:
    """Return a volume with its standard deviation, to the latter's second digit: +1234.5 ± 6.7 m³."""
    if not sigma_m3 > 0.0:
        return f"{volume_m3:+.3g} m³".replace("-", "−")
    digits = max(0, 1 - int(np.floor(np.log10(sigma_m3))))
    return f"{volume_m3:+.{digits}f} ± {sigma_m3:.{digits}f} m³".replace("-", "−")


def volume_words(volume_m3: float, sigma_m3: float, unmeasured: float) -> str:
    """Return a volume with its standard deviation and, on a line of its own, the share (0 to 1) of its polygon that is
    not measured."""
    text = volume_label(volume_m3, sigma_m3)
    return f"{text}\n{percent(unmeasured)} not measured" if unmeasured >= 0.005 else text


class VolumeSums:
    """What adds up over the windows of a polygon: every array has one row for each of net, fill and cut."""

    def __init__(
        self, name: str, polygon: Geometry, grid: MapGrid, patterns: int, outline_sigma_m: float = 0.0
    ) -> None:
        self.name = name
        self.polygon = polygon
        self.grid = grid
        self.outline_sigma_m = outline_sigma_m
        self.area_m2 = float(polygon.area)
        self.measured_m2 = self.interpolated_m2 = self.noise_m3 = self.interpolated_m3 = 0.0
        self.volume_m3 = np.zeros(KINDS)
        self.own_m6 = np.zeros(KINDS)
        self.detected_m3 = np.zeros(KINDS)
        self.pattern_m3 = np.zeros((KINDS, patterns))
        self.samples: OutlineSamples | None = outline_samples(polygon, grid.cell_m) if outline_sigma_m > 0.0 else None
        self.outline = np.zeros((KINDS, 0 if self.samples is None else self.samples.corners, 2))

    def add(self, difference: Difference, cells: DifferenceCells, outer: Window, window: Window) -> None:
        """Add the cells of a ``window`` of the grid from those around it, ``outer``."""
        area = coverage(self.polygon, self.grid, outer) * self.grid.cell_m**2
        inner = window.within(outer)
        known = cells.known
        d = np.where(known, cells.difference_m, 0.0)
        weights = np.stack([area * known, area * (d > 0.0), area * (d < 0.0)])
        measured = ~cells.interpolated
        self.measured_m2 += float(weights[0][inner][measured[inner]].sum())
        self.interpolated_m2 += float(weights[0][inner][~measured[inner]].sum())
        self.interpolated_m3 += float((weights[0] * d)[inner][~measured[inner]].sum())
        self.volume_m3 += np.sum((weights * d)[:, *inner], axis=(1, 2)) * [1, 1, -1]
        detected = weights * d * np.isin(cells.codes, (1, 2))
        self.detected_m3 += np.sum(detected[:, *inner], axis=(1, 2)) * [1, 1, -1]
        weights *= measured
        lengths = difference.correlation_m
        self.own_m6 += [own_variance(w, cells, lengths, self.grid.cell_m, inner) for w in weights]
        self.pattern_m3 += np.einsum("krc,mrc->km", weights[:, *inner], cells.pattern_m[:, *inner])
        self.noise_m3 += _noise(weights[0][inner], d[inner], cells.own_m[inner])
        self._add_outline(d, outer, window)

    def _add_outline(self, d: FloatArray, outer: Window, window: Window) -> None:
        if self.samples is None:
            return
        row, column = self.grid.cells_at(self.samples.place_map_m)
        within = (row >= window.row) & (row < window.row_end) & (column >= window.column) & (column < window.column_end)
        at = d[row[within] - outer.row, column[within] - outer.column]
        for kind, values in enumerate((at, np.maximum(at, 0.0), np.maximum(-at, 0.0))):
            self.outline[kind] += self.samples.slopes(values, within)

    def volume(self) -> Volume:
        """Return the volumes of what was added."""
        common = np.sum(self.pattern_m3**2, axis=1)
        outline = self.outline_sigma_m**2 * np.sum(self.outline**2, axis=(1, 2))
        sigma = np.sqrt(self.own_m6 + common + outline + np.array([0.0, 1.0, 1.0]) * self.noise_m3**2)
        net, fill, cut = (float(v) for v in self.volume_m3)
        own, shared, corners = (float(np.sqrt(v[0])) for v in (self.own_m6, common, outline))
        unmeasured = max(self.area_m2 - self.measured_m2 - self.interpolated_m2, 0.0)
        return Volume(
            name=self.name,
            area_m2=self.area_m2,
            measured_m2=self.measured_m2,
            interpolated_m2=self.interpolated_m2,
            unmeasured_m2=unmeasured if unmeasured > 1e-6 * self.area_m2 else 0.0,
            net_m3=net,
            net_sigma_m3=float(sigma[0]),
            fill_m3=fill,
            fill_sigma_m3=float(sigma[1]),
            cut_m3=cut,
            cut_sigma_m3=float(sigma[2]),
            own_sigma_m3=own,
            common_sigma_m3=shared,
            outline_sigma_m3=corners,
            noise_m3=self.noise_m3,
            interpolated_m3=self.interpolated_m3,
            detected_fill_m3=float(self.detected_m3[1]),
            detected_cut_m3=float(self.detected_m3[2]),
        )


def total(sums: Sequence[VolumeSums], shared: int | None = None) -> Volume:
    """Return the volumes of several polygons apart from each other: the first ``shared`` of their common patterns, or
    all, are common to all polygons too; the others are each polygon's own."""
    whole = VolumeSums("all", sums[0].polygon, sums[0].grid, sums[0].pattern_m3.shape[1])
    whole.area_m2, whole.outline_sigma_m = sum(s.area_m2 for s in sums), sums[0].outline_sigma_m
    known = sums[0].pattern_m3.shape[1] if shared is None else shared
    together = np.sum([part.pattern_m3[:, :known] for part in sums], axis=0)
    whole.pattern_m3 = np.concatenate([together, *(part.pattern_m3[:, known:] for part in sums)], axis=1)
    for part in sums:
        whole.measured_m2 += part.measured_m2
        whole.interpolated_m2 += part.interpolated_m2
        whole.interpolated_m3 += part.interpolated_m3
        whole.noise_m3 += part.noise_m3
        whole.volume_m3 += part.volume_m3
        whole.detected_m3 += part.detected_m3
        whole.own_m6 += part.own_m6
    whole.outline = np.concatenate([s.outline for s in sums], axis=1)
    return whole.volume()


def _noise(area_m2: FloatArray, difference_m: FloatArray, sigma_m: FloatArray) -> float:
    """Return what own errors add to fill, and to cut, on average, Σ a σ/√(2π) over the cells that they alone may have
    moved: the mean of the positive part of a normal variable whose mean is 0."""
    unmoved = np.abs(difference_m) <= LEVEL * sigma_m
    return float(np.sum(area_m2 * sigma_m, where=unmoved) / np.sqrt(2.0 * np.pi))
