"""The stretches to 8 bits of a survey's photographs: one for each camera whose photographs have more."""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from photogram.arrays import IntArray
from photogram.errors import ImageError
from photogram.files.photographs.depth import LARGEST_VALUE, Stretch
from photogram.files.photographs.images import sample_values
from photogram.wording import some, things

SAMPLED = 24
"""Photographs of a camera, evenly spread over its survey, that a stretch is found from."""

SHARE = 0.0005
"""Of the pixel values, that lie below the range of the ground and above it each: specular reflections, dead pixels."""

MARGIN = 0.1
"""Of that range, that is added at each end as far as there are values, so that white targets keep their edges."""


def find_stretch(paths: Sequence[Path | str], executor: Executor | None = None) -> Stretch:
    """Return the stretch to 8 bits of photographs of 9 to 16 bits a channel, from a sample of their pixel values.

    It depends on the photographs and their order alone. Raises ImageError where one cannot be read or has 8 bits, there
    are none, or all pixels of the sample have the same value.
    """
    if not paths:
        raise ImageError("no photographs to find a stretch of: give their paths")
    step = max(1, -(-len(paths) // SAMPLED))
    sample = [Path(path) for path in paths[::step]]
    with ThreadPoolExecutor(1) as own:
        counts = sum((executor or own).map(_counts, sample), np.zeros(LARGEST_VALUE + 1, np.int64))
    return _stretch_of(counts, sample)


def _counts(path: Path) -> IntArray:
    return np.bincount(sample_values(path), minlength=LARGEST_VALUE + 1)


def _stretch_of(counts: IntArray, sample: Sequence[Path]) -> Stretch:
    """Return the stretch that the frequency of each pixel value gives."""
    present = np.flatnonzero(counts)
    darkest, brightest = int(present[0]), int(present[-1])
    if darkest == brightest:
        more = f", and those of {things(len(sample) - 1, 'further photograph')} too" if len(sample) > 1 else ""
        raise ImageError(
            f"photograph {sample[0]}: all its pixels have the value {darkest}{more}, so they show nothing: "
            "check how they were exported"
        )
    below = np.cumsum(counts)
    low, high = (int(np.searchsorted(below, share * below[-1])) for share in (SHARE, 1.0 - SHARE))
    margin = round(MARGIN * (high - low))
    low, high = max(low - margin, darkest), min(high + margin, brightest)
    return Stretch(low, high) if low < high else Stretch(darkest, brightest)


def mixed_depths(names: Sequence[str], bits: Sequence[int]) -> str:
    """Return in words which of the photographs of one camera, given by name and bits a channel, differ from the others
    in these; empty where none does."""
    counted = Counter(bits).most_common()
    if len(counted) < 2:
        return ""
    usual = counted[0][0]
    others = [name for name, own in zip(names, bits, strict=True) if own != usual]
    depths = " or ".join(str(depth) for depth in sorted({own for own in bits if own != usual}))
    return (
        f"{things(len(others), 'photograph')} of {len(names)} ({some(others)}) {'has' if len(others) == 1 else 'have'} "
        f"{depths} bits a channel, the others {usual}"
    )


MIXED_REMEDY = "export all photographs of a camera alike, or give these a camera of their own"


def camera_stretches(
    photographs: Sequence[tuple[str, Path]],
    cameras: Sequence[int],
    camera_names: Sequence[str],
    bits: Sequence[int],
    executor: Executor,
) -> dict[str, Stretch]:
    """Return the stretch of each camera whose photographs have more than 8 bits a channel, by its name.

    ``photographs`` are names and paths, ``cameras`` the numbers of their cameras, ``bits`` those of their tags. Raises
    ImageError with every camera whose photographs differ in these, and as ``find_stretch``.
    """
    stretches, errors = dict[str, Stretch](), list[str]()
    for number, camera in enumerate(camera_names):
        own = [i for i, c in enumerate(cameras) if c == number]
        mixed = mixed_depths([photographs[i][0] for i in own], [bits[i] for i in own])
        if mixed:
            errors.append(f"camera {camera}: {mixed}: {MIXED_REMEDY}")
        elif own and bits[own[0]] > 8:
            stretches[camera] = find_stretch([photographs[i][1] for i in own], executor)
    if errors:
        raise ImageError("\n".join(errors))
    return stretches
