"""Files of photographs by their names: which can be photographs, and which show the same exposure."""

from collections.abc import Sequence
from pathlib import PurePosixPath

PNG = ".png"
_RAW = ".dng"

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", PNG, _RAW)
"""Of files that can be photographs, in small letters."""


def _exposure(name: str) -> str:
    """Return what the files of one exposure have in common: IMG_1.JPG, IMG_1.DNG."""
    return str(PurePosixPath(name).with_suffix("")).casefold()


def without_raw_twins(names: Sequence[str]) -> list[str]:
    """Return the names without those of DNG files that lie beside another picture of the same exposure: cameras write
    both, and the picture is what a DNG file would give."""
    pictures = {_exposure(name) for name in names if not name.lower().endswith(_RAW)}
    return [name for name in names if not name.lower().endswith(_RAW) or _exposure(name) not in pictures]


def deep_twins(names: Sequence[str], bits: Sequence[int]) -> dict[str, str]:
    """Return the photographs of more than 8 bits a channel that lie beside one of 8 of the same exposure, and this."""
    shallow = {_exposure(name): name for name, own in zip(names, bits, strict=True) if own <= 8}
    return {
        name: shallow[_exposure(name)]
        for name, own in zip(names, bits, strict=True)
        if own > 8 and _exposure(name) in shallow
    }
