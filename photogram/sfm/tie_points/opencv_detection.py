"""Key points by a detector of OpenCV, tile by tile: what lies in a mask is left out, what is taken is described."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.sfm.tie_points.detector import FeatureSettings, KeyPoints, Picture
from photogram.sfm.tie_points.picture_tiles import Tile, spread

Strength = Callable[[FloatArray, FloatArray], FloatArray]
"""Of key points, by which they are chosen, from their sizes (N,) in px and OpenCV's responses (N,)."""


def _described(method: cv2.Feature2D, tile: Tile, points: Sequence[cv2.KeyPoint], length: int) -> ByteArray:
    """Return the descriptors (N, length) of key points in a tile: bytes, or whole numbers that fit into them."""
    if not points:
        return np.zeros((0, length), dtype=np.uint8)
    order = np.argsort([point.octave for point in points], kind="stable")  # some detectors return them so
    wanted = [points[i] for i in order.tolist()]
    kept, computed = method.compute(tile.grey, wanted)
    if [point.pt for point in kept] != [point.pt for point in wanted]:
        raise AssertionError("OpenCV describes other key points than it was given")
    descriptor = np.empty((len(points), length), dtype=np.uint8)
    descriptor[order] = computed
    return descriptor


def detected(
    method: cv2.Feature2D,
    picture: Picture,
    tiles: Sequence[Tile],
    settings: FeatureSettings,
    strength: Strength = lambda _, response: response,
) -> KeyPoints:
    """Return key points of a picture and its ``tiles`` as `Detector.detect` says; those of ``overlap_px`` and more,
    which no tile sees whole, are left out."""
    points = list[cv2.KeyPoint]()
    table = list[FloatArray]()
    number = list[IntArray]()
    for n, tile in enumerate(tiles):
        seen = method.detect(tile.grey)
        rows = [(k.pt[0] + tile.u0, k.pt[1] + tile.v0, k.size, k.angle, k.response) for k in seen]
        part = np.array(rows, dtype=np.float64).reshape(-1, 5)
        own = np.flatnonzero(tile.answers_for(part[:, :2]) & (part[:, 2] < settings.overlap_px))
        points += [seen[i] for i in own.tolist()]
        table.append(part[own])
        number.append(np.full(len(own), n))
    every, tile_number = np.concatenate(table), np.concatenate(number)
    clear = np.flatnonzero(picture.leaves(every[:, :2], every[:, 2]))
    every, tile_number = every[clear], tile_number[clear]
    chosen = spread(every[:, :2], every[:, 3], strength(every[:, 2], every[:, 4]), picture.grey.shape, settings)
    every, tile_number = every[chosen], tile_number[chosen]
    taken = [points[i] for i in clear[chosen].tolist()]
    descriptor = np.zeros((len(every), method.descriptorSize()), dtype=np.uint8)
    for n, tile in enumerate(tiles):
        own = np.flatnonzero(tile_number == n)
        descriptor[own] = _described(method, tile, [taken[i] for i in own.tolist()], descriptor.shape[1])
    return KeyPoints(every[:, :2], every[:, 2], every[:, 3], descriptor)
