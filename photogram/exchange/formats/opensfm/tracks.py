"""OpenSfM's tracks.csv: observations of tie points in normalised image coordinates.

With size = max(w, h) and pixels whose top-left one has its centre at (0, 0), as photogram's (OpenSfM documentation,
Geometric Models, Normalized Image Coordinates):

    x = (u + 1/2 − w/2)/size,  y = (v + 1/2 − h/2)/size
"""

from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from photogram.arrays import ByteArray, FloatArray, IntArray
from photogram.errors import ExchangeError
from photogram.files.solutions.parsing import numbers, text_of, whole_numbers
from photogram.wording import printable

_HEADER = "OPENSFM_TRACKS_VERSION_v"
_COLUMNS = {0: 8, 1: 9, 2: 11}
"""Cells of a line by the version of the file: image, track, feature, x, y, then scale from 1 on, a colour, and from 2
on two numbers of a segmentation."""

_LINES_AT_ONCE = 50_000


class Tracks(NamedTuple):
    """Observations (N) of the photographs and points that are wanted, and the number of others."""

    photograph: IntArray
    point: IntArray
    feature: IntArray
    normalised: FloatArray
    """Normalised coordinates (N, 2)."""
    others: int


def read_tracks(path: Path, photographs: Mapping[str, int], points: Mapping[str, int]) -> Tracks:
    """Return the observations of photographs and points by their names. Raises ExchangeError where a line is not as
    the version of the file has it."""
    lines = text_of(path).split("\n")
    version, first = 0, 0
    if lines[0].startswith(_HEADER):
        text = lines[0][len(_HEADER) :].strip()
        if text not in map(str, _COLUMNS):
            raise ExchangeError(f"{path}:1: is of version {printable(text)[:20]}, at most 2 is read: export it again")
        version, first = int(text), 1
    width = _COLUMNS[version]
    while lines and not lines[-1].strip():
        lines.pop()
    photograph, point, feature, place = array("q"), array("q"), array("d"), array("d")
    for start in range(first, len(lines), _LINES_AT_ONCE):
        chunk = lines[start : start + _LINES_AT_ONCE]
        wrong = next((i for i, line in enumerate(chunk) if line.count("\t") != width - 1), None)
        if wrong is not None:
            raise ExchangeError(
                f"{path}:{start + wrong + 1}: has {chunk[wrong].count(chr(9)) + 1} cells, expected {width}: the file "
                "is cut off or damaged"
            )
        cells = "\t".join(chunk).split("\t")
        where = f"{path}: from line {start + 1} on"
        photograph.extend([photographs.get(name, -1) for name in cells[0::width]])
        point.extend([points.get(name, -1) for name in cells[1::width]])
        feature.extend(numbers(where, cells[2::width]).tolist())
        xy = np.column_stack([numbers(where, cells[3::width]), numbers(where, cells[4::width])])
        place.extend(xy.ravel().tolist())
    photo, tie = np.array(photograph, dtype=np.int64), np.array(point, dtype=np.int64)
    wanted = (photo >= 0) & (tie >= 0)
    keys = whole_numbers(str(path), "the number of a feature", np.array(feature, dtype=np.float64)[wanted])
    normalised = np.array(place, dtype=np.float64).reshape(-1, 2)[wanted]
    return Tracks(photo[wanted], tie[wanted], keys, normalised, int((~wanted).sum()))


def pixel_of_normalised(sizes_px: IntArray, normalised: FloatArray) -> FloatArray:
    """Return pixels (N, 2) of normalised coordinates (N, 2) in pictures of these sizes (N, 2)."""
    return np.asarray(normalised * sizes_px.max(axis=1, keepdims=True) + (sizes_px - 1) / 2)


def normalised_of_pixel(sizes_px: IntArray, pixel: FloatArray) -> FloatArray:
    """Return normalised coordinates (N, 2) of pixels (N, 2) in pictures of these sizes (N, 2)."""
    return np.asarray((pixel - (sizes_px - 1) / 2) / sizes_px.max(axis=1, keepdims=True))


def tracks_text(names: Sequence[str], tracks: Tracks, colour: ByteArray) -> str:
    """Return the text of a tracks.csv of version 2, sorted by photograph; ``colour`` (N, 3) is that of the observed
    points. The scale, which photogram does not keep, is 1."""
    order = np.lexsort((tracks.point, tracks.photograph))
    rows = zip(
        tracks.photograph[order].tolist(),
        tracks.point[order].tolist(),
        tracks.feature[order].tolist(),
        tracks.normalised[order].tolist(),
        colour[order].tolist(),
        strict=True,
    )
    lines = [
        f"{names[i]}\t{point}\t{feature}\t{x!r}\t{y!r}\t1\t{r}\t{g}\t{b}\t-1\t-1"
        for i, point, feature, (x, y), (r, g, b) in rows
    ]
    return "\n".join([f"{_HEADER}2", *lines, ""])
