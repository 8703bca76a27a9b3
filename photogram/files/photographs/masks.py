"""Masks: pictures of the size of a photograph, black where it is left out.

A mask is called after its photograph, as other programs have it: ``IMG_1.png``, ``IMG_1.JPG.png`` (COLMAP, OpenSfM),
``IMG_1_mask.png`` (Metashape's ``{filename}_mask.png``), ``IMG_1_mask.JPG`` (OpenDroneMap, PIX4D), ``IMG_1.mask.png``,
``IMG_1.JPG.mask.png`` (RealityCapture), ``IMG_1_Masq.tif`` (MicMac). Capitals do not matter. As photographs, masks are
taken as they are stored: the EXIF orientation is never applied.
"""

import hashlib
import io
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from PIL import Image, UnidentifiedImageError

from photogram.arrays import BoolArray
from photogram.errors import ImageError
from photogram.files.atomic import replacing
from photogram.files.photographs.identification import FORMATS, JPEGS, LARGEST_PIXELS, MOST_BYTES, jpeg_is_whole
from photogram.files.photographs.names import JoinedNames, joined_names
from photogram.files.photographs.tag_packets import DAMAGE, recorded_warnings
from photogram.files.reading import read_whole
from photogram.wording import some

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg")
"""Of files that can be masks."""

JPEG_BLACK = 128
"""Grey value below which a JPEG is black: its compression moves black by some values beside white."""

_MARKED = re.compile(r"[._\- ]?mas[kq]\Z", re.IGNORECASE)
_MODES = ("1", "L", "LA", "P", "PA", "RGB", "RGBA", "I;16", "I;16B", "I")


@dataclass(frozen=True)
class MaskFiles:
    """The masks of a folder: the file of each photograph that has one, by its name, and the names of files that belong
    to none."""

    of_photograph: dict[str, Path]
    others: tuple[str, ...]


def find_masks(folder: Path, photographs: Sequence[str]) -> MaskFiles:
    """Return which files of a folder, or of folders within, are the masks of photographs, given by their names.

    A mask in a folder within belongs to the photograph in the folder of that name, or else to the one that is called
    so, as other programs write names (``joined_names``); that of `100MEDIA/IMG_1.JPG` may be called
    `100MEDIA_IMG_1_mask.png` too. Raises ImageError, a line for each
    error, where the folder cannot be read, no name fits, one fits several photographs, or several fit one.
    """
    try:
        paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    except OSError as error:
        raise ImageError(f"the folder {folder} cannot be read ({error.strerror})") from error
    names = [path.relative_to(folder).as_posix() for path in paths]
    named, number = _photographs_by_key(photographs), {name: i for i, name in enumerate(photographs)}
    joined = joined_names((called for name in names for called in _photographs_called(name)), photographs)
    masks = defaultdict[int, list[str]](list)
    others, errors = list[str](), list[str]()
    for name in names:
        if any(part.startswith(".") for part in PurePosixPath(name).parts):
            continue
        fits = next((fit for called in _photographs_called(name) if (fit := named.get(called.casefold()))), [])
        fits = fits or [number[own] for own in _joined(_photographs_called(name), joined)]
        if len(fits) > 1:
            several = some([photographs[i] for i in fits])
            errors.append(f"{name} fits several photographs, {several}: call it {name_of_mask(photographs[fits[0]])}")
        elif fits:
            masks[fits[0]].append(name)
        else:
            others.append(name)
    for i, names in sorted(masks.items()):
        if len(names) > 1:
            errors.append(f"{photographs[i]} has {len(names)} masks, {some(names)}: keep one")
    if not masks and not errors:
        there = (
            f"{some(others)} {'fits' if len(others) == 1 else 'fit'} none" if others else "there is no picture in it"
        )
        errors.append(
            f"no mask in {folder} is called after a photograph: {there}; "
            f"call them {PurePosixPath(photographs[0]).stem if photographs else 'IMG_1'}_mask.png, for example"
        )
    if errors:
        raise ImageError("\n".join(errors))
    return MaskFiles({photographs[i]: folder / names[0] for i, names in sorted(masks.items())}, tuple(others))


def _photographs_by_key(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the numbers of photographs by what their masks may be called: their names, and those without a suffix."""
    keys = defaultdict[str, list[int]](list)
    for i, name in enumerate(names):
        whole, stem = name.casefold(), str(PurePosixPath(name).with_suffix("")).casefold()
        for key in dict.fromkeys((whole, stem, whole.replace("/", "_"), stem.replace("/", "_"))):
            keys[key].append(i)
    return keys


def is_called_mask(name: str) -> bool:
    """Return whether a file is called as programs call masks: ``IMG_1_mask.png``."""
    return _MARKED.search(PurePosixPath(name).stem.casefold()) is not None


def name_of_mask(photograph: str) -> str:
    """Return what the mask of a photograph is called here, folders in its name or not: ``IMG_1.JPG.png``."""
    return f"{photograph.replace('/', '_')}.png"


def _photographs_called(mask: str) -> tuple[str, str]:
    """Return what the photograph of a mask may be called: the whole name counts before the one without `_mask`."""
    whole = str(PurePosixPath(mask).with_suffix(""))
    return whole, _MARKED.sub("", whole)


def _joined(called: Sequence[str], joined: JoinedNames) -> tuple[str, ...]:
    """Return the photographs that the first of the names fits that fits any."""
    return next(
        (fit for name in called if (fit := (joined.of[name],) if name in joined.of else joined.ambiguous.get(name))), ()
    )


def _opened(path: Path, size_px: tuple[int, int] | None, sha256: str | None) -> Image.Image:
    """Return a mask, not decoded yet."""
    try:
        data = read_whole(path, MOST_BYTES)
    except FileNotFoundError as error:
        raise ImageError(f"mask {path}: file not found") from error
    except OSError as error:
        raise ImageError(f"mask {path}: cannot be read ({error.strerror}): check its permissions") from error
    if sha256 is not None and hashlib.sha256(data).hexdigest() != sha256:
        raise ImageError(
            f"mask {path}: was modified since the run began: do not change masks during a run, and run again"
        )
    try:
        with recorded_warnings():
            picture = Image.open(io.BytesIO(data), formats=FORMATS)
    except UnidentifiedImageError as error:
        raise _damaged(path, f"{len(data)} bytes in no known image format") from error
    except DAMAGE as error:
        raise _damaged(path, error) from error
    width, height = picture.size
    if width * height > LARGEST_PIXELS:
        raise ImageError(f"mask {path}: {width} × {height} px are too many: give the mask of a single photograph")
    if size_px is not None and (width, height) != size_px:
        turned = ", turned by 90°" if (height, width) == size_px else ""
        raise ImageError(
            f"mask {path}: {width} × {height} px{turned}, its photograph has {size_px[0]} × {size_px[1]} px: "
            "export it at the photograph's size, as the pixels are stored"
        )
    if picture.mode not in _MODES:
        raise ImageError(
            f"mask {path}: pixel type {picture.mode}, photogram reads 1-bit, grey and colour: export it as 8-bit PNG"
        )
    if picture.format in JPEGS and not jpeg_is_whole(data):
        raise _damaged(path, "its image data is truncated")
    return picture


def _damaged(path: Path, reason: object) -> ImageError:
    return ImageError(
        f"mask {path}: cannot be decoded ({reason}), the file is truncated or damaged: export it again, or remove it"
    )


def check_mask(path: Path, size_px: tuple[int, int]) -> None:
    """Raise ImageError where a mask is missing, is no picture or not of ``size_px``, width and height, or the checksums
    of a PNG show damage; nothing is decoded."""
    picture = _opened(path, size_px, None)
    try:
        picture.verify()
    except DAMAGE as error:
        raise _damaged(path, error) from error


def read_mask(path: Path | str, size_px: tuple[int, int] | None = None, sha256: str | None = None) -> BoolArray:
    """Return which pixels (height, width) of a photograph a mask leaves: all that are not black.

    Of a JPEG all that are not nearly black (JPEG_BLACK). Transparency counts where it alone says something, or says the
    same as black. Raises ImageError as ``check_mask``, where the pixels cannot be decoded, nothing is left, black and
    transparency contradict each other, or the SHA-256 of the content is not ``sha256``, in hex.
    """
    path = Path(path)
    picture = _opened(path, size_px, sha256)
    try:
        picture.load()
    except DAMAGE as error:
        raise _damaged(path, error) from error
    used = _used(path, picture)
    if not used.any():
        raise ImageError(
            f"mask {path}: all of it is black, which leaves nothing of the photograph: if black and white are "
            "exchanged, invert it; else leave the photograph out"
        )
    return used


def read_masks(
    paths: Sequence[Path], size_px: tuple[int, int] | None = None, sha256: Sequence[str] | None = None
) -> BoolArray:
    """Return which pixels (height, width) all masks of a photograph leave, at least one of them. Raises ImageError as
    ``read_mask``, with the ``sha256`` of each, and where together they leave nothing."""
    marks: Sequence[str | None] = sha256 or [None] * len(paths)
    used = read_mask(paths[0], size_px, marks[0])
    for path, mark in zip(paths[1:], marks[1:], strict=True):
        used = used & read_mask(path, size_px, mark)
    if not used.any():
        raise ImageError(
            f"mask {paths[0]}: together with {', '.join(map(str, paths[1:]))} it leaves nothing of the photograph: "
            "leave the photograph out"
        )
    return used


def _used(path: Path, picture: Image.Image) -> BoolArray:
    if picture.format in JPEGS:
        return np.asarray(np.asarray(picture.convert("L")) >= JPEG_BLACK)
    if picture.mode in ("1", "I", "I;16", "I;16B"):
        return np.asarray(np.asarray(picture) != 0)
    if picture.mode in ("LA", "PA", "RGBA") or "transparency" in picture.info:
        pixels = np.asarray(picture.convert("RGBA"))
        colour, opaque = (pixels[..., :3] != 0).any(axis=2), pixels[..., 3] != 0
        if opaque.all():
            return np.asarray(colour)
        if colour.all() or np.array_equal(colour, opaque):
            return np.asarray(opaque)
        raise ImageError(
            f"mask {path}: black pixels and transparent ones are not the same, so that it is not clear what is left "
            "out: export it without transparency, black for what is left out and white for the rest"
        )
    if picture.mode == "L":
        return np.asarray(np.asarray(picture) != 0)
    return np.asarray((np.asarray(picture.convert("RGB")) != 0).any(axis=2))


def write_mask(path: Path | str, used: BoolArray) -> None:
    """Write which pixels (height, width) of a photograph are used as an 8-bit grey PNG, 255 for these and 0 for what is
    left out; whole or not at all. Raises WorkspaceError where the file cannot be written."""
    picture = Image.fromarray(np.where(used, np.uint8(255), np.uint8(0)))
    with replacing(Path(path)) as partial:
        picture.save(partial, "PNG", compress_level=3)
