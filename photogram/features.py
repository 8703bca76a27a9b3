"""Key points and descriptors of one photograph: SIFT (Lowe 2004) on tiles, RootSIFT descriptors (Arandjelović & Zisserman 2012).

Tiles bound the memory (SIFT doubles the picture before it starts), and the strongest key points are taken cell by cell, so
that they spread over the whole photograph.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from photogram.errors import ImageError
from photogram.survey import ByteArray, Features


@dataclass(frozen=True)
class FeatureSettings:
    """How key points are found."""

    maximum: int = 10000  # key points kept per photograph
    contrast_threshold: float = 0.02  # SIFT's own, on grey values of 0 to 1
    tile_px: int = 1536
    overlap_px: int = 96
    cells_per_side: int = 24  # the grid over which key points are spread


def _tile_edges(length_px: int, tile_px: int) -> NDArray[np.int64]:
    count = max(1, -(-length_px // tile_px))
    return np.linspace(0, length_px, count + 1).round().astype(np.int64)


def _detect(grey: ByteArray, settings: FeatureSettings) -> tuple[NDArray[np.float64], ByteArray]:
    """Return key points (N, 5): u, v, size, angle in degrees, response; and RootSIFT descriptors (N, 128) as bytes."""
    sift = cv2.SIFT_create(contrastThreshold=settings.contrast_threshold, enable_precise_upscale=True)
    rows = _tile_edges(grey.shape[0], settings.tile_px)
    columns = _tile_edges(grey.shape[1], settings.tile_px)
    found: list[NDArray[np.float64]] = []
    descriptors: list[ByteArray] = []
    for top, bottom in zip(rows[:-1], rows[1:], strict=True):
        for left, right in zip(columns[:-1], columns[1:], strict=True):
            v0, u0 = max(0, top - settings.overlap_px), max(0, left - settings.overlap_px)
            tile = grey[v0 : bottom + settings.overlap_px, u0 : right + settings.overlap_px]
            key_points, descriptor = sift.detectAndCompute(np.ascontiguousarray(tile), None)
            if not key_points:
                continue
            table = np.array([(k.pt[0], k.pt[1], k.size, k.angle, k.response) for k in key_points], dtype=np.float64)
            table[:, :2] += (u0, v0)
            inside = (table[:, 0] >= left - 0.5) & (table[:, 0] < right - 0.5) & (table[:, 1] >= top - 0.5) & (table[:, 1] < bottom - 0.5)
            inside &= table[:, 2] < settings.overlap_px
            share = descriptor[inside] / np.maximum(descriptor[inside].sum(axis=1, keepdims=True), 1e-9)
            found.append(table[inside])
            descriptors.append(np.clip(np.round(512.0 * np.sqrt(share)), 0, 255).astype(np.uint8))
    if not found:
        return np.zeros((0, 5)), np.zeros((0, 128), dtype=np.uint8)
    return np.concatenate(found), np.concatenate(descriptors)


def _spread(table: NDArray[np.float64], width_px: int, height_px: int, settings: FeatureSettings) -> NDArray[np.int64]:
    """Return the indices of at most ``maximum`` key points, the strongest of every cell first."""
    cells = settings.cells_per_side
    column = np.clip((table[:, 0] / width_px * cells).astype(np.int64), 0, cells - 1)
    row = np.clip((table[:, 1] / height_px * cells).astype(np.int64), 0, cells - 1)
    cell = row * cells + column
    order = np.lexsort((table[:, 3], table[:, 0], table[:, 1], -table[:, 4], cell))
    starts = np.searchsorted(cell[order], np.arange(cells * cells))
    rank = np.arange(len(order)) - starts[cell[order]]
    chosen = order[np.lexsort((order, -table[order, 4], rank))[: settings.maximum]]
    return np.asarray(chosen[np.lexsort((table[chosen, 3], table[chosen, 0], table[chosen, 1]))])


def find_features(name: str, pixels: ByteArray, settings: FeatureSettings) -> Features:
    """Find key points in the photograph ``name`` with RGB ``pixels`` (H, W, 3), sorted by row, then column.

    Raises ImageError when the photograph shows too little texture to be matched.
    """
    grey = cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY)
    height, width = grey.shape
    table, descriptor = _detect(np.asarray(grey, dtype=np.uint8), settings)
    if len(table) < 8:
        raise ImageError(
            f"{name}: only {len(table)} key points found in {width} x {height} px: the photograph is blank, blurred or black; "
            "leave it out, or lower features.contrast_threshold"
        )
    keep = _spread(table, width, height, settings)
    table = table[keep]
    column = np.clip(np.round(table[:, 0]).astype(np.int64), 0, width - 1)
    row = np.clip(np.round(table[:, 1]).astype(np.int64), 0, height - 1)
    return Features(table[:, :2].copy(), table[:, 2].copy(), np.deg2rad(table[:, 3]), descriptor[keep], pixels[row, column].copy())
