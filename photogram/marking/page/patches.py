"""Patches of photographs in their original pixels, as the sensor delivered them, cut from what is decoded at a power of
two of their size.

A pixel of a patch that is reduced s times covers s × s pixels of the photograph, so its window is whole in these. What
is kept is not photographs but their surroundings of patches: a thousand photographs take no more memory than ten.
"""

from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Lock, Semaphore

import cv2

from photogram.arrays import ByteArray
from photogram.errors import ControlPointError, ImageError
from photogram.files.photographs.depth import Stretch
from photogram.files.photographs.images import read_window

SCALES = (1, 2, 4, 8)
KEPT_BYTES = 256_000_000
"""Of surroundings kept in memory."""

AROUND = 384
"""Pixels at its own scale that are kept around a patch, so that moving a little decodes nothing again."""

LARGEST_SIDE = 4096
DECODERS = 2
"""Photographs decoded at a time: each may take 3 bytes a pixel while it is."""


@dataclass(frozen=True)
class Window:
    """A part of a photograph: the pixels from ``left`` and ``upper`` on, ``width`` × ``height`` of them in its original
    pixels, at ``scale`` original pixels to one of the patch. Only the last pixel of a row may reach over its edge."""

    left: int
    upper: int
    width: int
    height: int
    scale: int = 1


@dataclass(frozen=True, eq=False)
class _Region:
    """What is kept of a photograph at a scale: pixels from ``left`` and ``upper`` on, counted at that scale."""

    left: int
    upper: int
    pixels: ByteArray

    def holds(self, box: tuple[int, int, int, int]) -> bool:
        rows, columns = self.pixels.shape[:2]
        left, upper, right, lower = box
        return self.left <= left and self.upper <= upper and right <= self.left + columns and lower <= self.upper + rows

    def cut(self, box: tuple[int, int, int, int]) -> ByteArray:
        left, upper, right, lower = box
        return self.pixels[upper - self.upper : lower - self.upper, left - self.left : right - self.left]


class PatchReader:
    """Cuts patches from photographs given by path and size (width, height) in px, and by the ``stretches`` to 8 bits of
    those that have more, None for others; threads may ask at the same time."""

    def __init__(
        self,
        paths: Sequence[Path],
        sizes_px: Sequence[tuple[int, int]],
        kept_bytes: int = KEPT_BYTES,
        stretches: Sequence[Stretch | None] = (),
    ) -> None:
        self._stretches = tuple(stretches) or (None,) * len(paths)
        self._paths = tuple(paths)
        self._sizes_px = tuple(sizes_px)
        self._kept_bytes = kept_bytes
        self._regions: OrderedDict[tuple[int, int], list[_Region]] = OrderedDict()
        self._reading: dict[tuple[int, int], Lock] = {}
        self._bytes = 0
        self._lock = Lock()
        self._decoders = Semaphore(DECODERS)
        self._ahead = ThreadPoolExecutor(DECODERS, "patches ahead")
        self._planned: list[Future[None]] = []
        self._is_closed = False

    @property
    def kept_bytes(self) -> int:
        """Return how much is kept."""
        with self._lock:
            return self._bytes

    def window(self, photograph: int, wanted: Window) -> Window:
        """Return the part of a window that lies in the photograph, widened to whole pixels of its scale. Raises
        ControlPointError where that is nothing, or a window cannot be."""
        left, upper, right, lower = self._box(photograph, wanted)
        s = wanted.scale
        return Window(left * s, upper * s, (right - left) * s, (lower - upper) * s, s)

    def _box(self, photograph: int, wanted: Window) -> tuple[int, int, int, int]:
        """Return a window within the photograph in pixels of its scale: left, upper, right, lower."""
        s = wanted.scale
        if s not in SCALES or not 0 < wanted.width <= LARGEST_SIDE * s or not 0 < wanted.height <= LARGEST_SIDE * s:
            raise ControlPointError(
                f"a patch of {wanted.width} × {wanted.height} px at scale {s}: sides must be up to {LARGEST_SIDE} "
                f"pixels at scale {', '.join(map(str, SCALES))}"
            )
        width, height = (-(-side // s) for side in self._sizes_px[photograph])
        left, upper = max(wanted.left // s, 0), max(wanted.upper // s, 0)
        right = min(-(-(wanted.left + wanted.width) // s), width)
        lower = min(-(-(wanted.upper + wanted.height) // s), height)
        if right <= left or lower <= upper:
            raise ControlPointError(f"the patch at {wanted.left}, {wanted.upper} px lies outside of the photograph")
        return left, upper, right, lower

    def pixels(self, photograph: int, wanted: Window) -> ByteArray:
        """Return the patch of a window (rows, columns, 3), what ``window`` says of it. Raises ControlPointError as
        ``window``, ImageError where the photograph cannot be read."""
        box, key = self._box(photograph, wanted), (photograph, wanted.scale)
        region = self._kept(key, box)
        if region is None:
            with self._lock:
                reading = self._reading.setdefault(key, Lock())
            with reading:  # who asks for the same photograph waits and finds it
                region = self._kept(key, box) or self._read(key, box)
        return region.cut(box)

    def picture(self, photograph: int, wanted: Window) -> bytes:
        """Return the patch of a window as BMP. Raises as ``pixels``."""
        # a tenth of the time of PNG: a dozen patches of a point are made and read while somebody waits
        content = cv2.imencode(".bmp", cv2.cvtColor(self.pixels(photograph, wanted), cv2.COLOR_RGB2BGR))[1]
        return content.tobytes()

    def read_ahead(self, wanted: Sequence[tuple[int, Window]]) -> None:
        """Read what will be asked for next, in this order and in the background, in place of what was to be read
        before."""
        with self._lock:
            for plan in self._planned:
                plan.cancel()
            if self._is_closed:
                return
            self._planned = [self._ahead.submit(self._quietly, photograph, window) for photograph, window in wanted]

    def _quietly(self, photograph: int, window: Window) -> None:
        try:
            self.pixels(photograph, window)
        except (ControlPointError, ImageError, OSError):
            return  # who asks for it gets the error

    def close(self) -> None:
        """End reading ahead."""
        with self._lock:
            self._is_closed = True
        self._ahead.shutdown(wait=False, cancel_futures=True)

    def _kept(self, key: tuple[int, int], box: tuple[int, int, int, int]) -> _Region | None:
        with self._lock:
            for region in self._regions.get(key, ()):
                if region.holds(box):
                    self._regions.move_to_end(key)
                    return region
        return None

    def _read(self, key: tuple[int, int], box: tuple[int, int, int, int]) -> _Region:
        photograph, scale = key
        size = self._sizes_px[photograph]
        width, height = (-(-side // scale) for side in size)
        left, upper, right, lower = box
        wide = max(left - AROUND, 0), max(upper - AROUND, 0), min(right + AROUND, width), min(lower + AROUND, height)
        with self._decoders:
            pixels = read_window(self._paths[photograph], wide, scale, size, self._stretches[photograph])
        region = _Region(wide[0], wide[1], pixels)
        with self._lock:
            self._regions.setdefault(key, []).append(region)
            self._regions.move_to_end(key)
            self._bytes += region.pixels.nbytes
            while self._bytes > self._kept_bytes and len(self._regions) > 1:
                _, oldest = self._regions.popitem(last=False)
                self._bytes -= sum(one.pixels.nbytes for one in oldest)
            own = self._regions[key]
            while self._bytes > self._kept_bytes and len(own) > 1:
                self._bytes -= own.pop(0).pixels.nbytes
        return region
