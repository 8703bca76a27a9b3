"""What lies in a folder of photographs, by its names: photographs, pictures that are passed over and why, other files,
and folders within that were not searched."""

from collections.abc import Iterator
from dataclasses import dataclass
from os.path import isdir  # false, not an exception, for a name that cannot be
from pathlib import Path

from photogram.errors import ImageError
from photogram.files.photographs.masks import is_called_mask
from photogram.files.photographs.names import PNG, SUFFIXES, UNREAD, twins
from photogram.project.draft.draft import LeftOut
from photogram.wording import some, things

MASKS_FOLDER = "masks"
"""Name of a folder beside the photographs, or in their folder, that is taken for that of their masks."""

_UNREAD = "pictures of this kind are not read: convert them to JPEG or TIFF, with their tags"
_TWIN = "another picture of its name shows the same exposure, and is used"
_MASK = f"called as a mask, which are used from a folder {MASKS_FOLDER}: move it there"
_RESULTS = "report.json"


@dataclass(frozen=True)
class PhotographFolder:
    """Names relative to the folder. ``pngs`` are photographs only if their tags name a camera, since photographs of
    another kind lie beside them."""

    names: tuple[str, ...]
    pngs: frozenset[str]
    left_out: tuple[LeftOut, ...]
    others: tuple[str, ...]
    """Files that are no pictures."""
    unsearched: tuple[str, ...]
    """Folders with pictures, and how many, where these are not searched."""


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _is_picture(name: str) -> bool:
    return name.lower().endswith((*SUFFIXES, *UNREAD))


def _files(folder: Path, recursive: bool) -> list[str]:
    """Return the files of a folder, or of those within too, without hidden ones and masks."""
    try:
        paths = [p.relative_to(folder) for p in (folder.rglob("*") if recursive else folder.iterdir()) if p.is_file()]
    except OSError as error:
        raise ImageError(f"{folder}: cannot be read ({error.strerror}): check its permissions") from error
    return sorted(p.as_posix() for p in paths if not _is_hidden(p) and MASKS_FOLDER not in p.parts[:-1])


def _unsearched(folder: Path) -> Iterator[str]:
    for path in sorted(p for p in folder.iterdir() if p.is_dir() and not _is_hidden(p.relative_to(folder))):
        try:
            within = [p.name for p in path.iterdir()]
        except OSError as error:
            yield f"{path.name} (cannot be read: {error.strerror})"
            continue
        pictures = sum(map(_is_picture, within))
        if pictures and path.name != MASKS_FOLDER and _RESULTS not in within:
            yield f"{path.name} ({things(pictures, 'picture')})"


def look_into(folder: Path, *, recursive: bool) -> PhotographFolder:
    """Return what lies in a folder, or in those within too. Raises ImageError where it holds no photographs."""
    if not isdir(folder):
        raise ImageError(f"{folder}: folder not found: give the folder of the photographs")
    files = _files(folder, recursive)
    pictures = [name for name in files if _is_picture(name)]
    pngs = {name for name in pictures if name.lower().endswith(PNG)}
    masks = {name for name in pngs if is_called_mask(name)}
    second = twins(pictures)
    own = [name for name in pictures if name not in masks and name not in second]
    names = [name for name in own if name.lower().endswith(SUFFIXES)]
    unread = [name for name in own if name.lower().endswith(UNREAD)]
    unsearched = () if recursive else tuple(_unsearched(folder))
    if not names:
        within = "" if recursive else "; --recursive searches subfolders"
        if unread:
            raise ImageError(
                f"{folder}: {things(len(unread), 'picture')} ({some(unread)}) of kinds that are not "
                f"read: convert them to JPEG or TIFF, with their tags{within}"
            )
        raise ImageError(
            f"{folder}: no photographs (JPEG, TIFF, DNG, HEIC or PNG) found: give the folder of the photographs{within}"
        )
    left_out = [*((n, _TWIN) for n in second), *((n, _MASK) for n in masks), *((n, _UNREAD) for n in unread)]
    return PhotographFolder(
        tuple(names),
        frozenset(pngs if any(name not in pngs for name in names) else ()),
        tuple(LeftOut(name, reason) for name, reason in sorted(left_out)),
        tuple(name for name in files if not _is_picture(name)),
        unsearched,
    )
