"""Sizes of photographs, for formats that do not hold them."""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from photogram.errors import ExchangeError, PhotogramError
from photogram.files.photographs.images import read_tags
from photogram.wording import printable, shortened

Sizes = Mapping[str, tuple[int, int]]
"""Width and height in pixels by the file names of photographs."""


def size_of(listed_in: Path, file: PurePosixPath, sizes_px: Sizes) -> tuple[int, int]:
    """Return width and height of a photograph, px: the one given, else that of the file, which lies where the list
    names it. Raises ExchangeError where neither is there, or the name leads up from a folder."""
    if file.name in sizes_px:
        return sizes_px[file.name]
    if ".." in file.parts:
        raise ExchangeError(
            f"{listed_in}: {printable(shortened(str(file)))!r} is not looked for: name the photograph without '..', or "
            "give its size"
        )
    try:
        tags = read_tags(listed_in.parent / file)
    except PhotogramError as error:
        raise ExchangeError(
            f"{listed_in}: the size of {file.name} is not known: put the photograph there, or give its size ({error})"
        ) from error
    if tags.width_px is None or tags.height_px is None:
        raise ExchangeError(f"{listed_in}: the size of {file.name} is not known: give it")
    return tags.width_px, tags.height_px


def centre_px(size_px: tuple[int, int]) -> tuple[float, float]:
    """Return the centre of a picture in photogram's pixels."""
    return (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
