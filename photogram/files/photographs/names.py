"""Files of photographs by their names: which can be photographs, which show the same exposure, and which is meant by a
name as another program writes it."""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from photogram.wording import some

PNG = ".png"
_RAW = ".dng"
_HEIC = (".heic", ".heif", ".hif")

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", PNG, _RAW, *_HEIC)
"""Of files that can be photographs, in small letters."""


UNREAD = (
    ".avif", ".webp", ".bmp", ".gif", ".jp2", ".insp", ".cr2", ".cr3", ".nef", ".arw",
    ".raf", ".orf", ".rw2", ".pef", ".srw", ".iiq", ".3fr",
)  # fmt: skip
"""Of files that are pictures and are not read, in small letters."""


def _exposure(name: str) -> str:
    """Return what the files of one exposure have in common: IMG_1.JPG, IMG_1.DNG."""
    return str(PurePosixPath(name).with_suffix("")).casefold()


def twins(names: Sequence[str]) -> dict[str, str]:
    """Return the files that another one of the same exposure stands for, and this: for HEIF a picture of another kind,
    for DNG one of either, for what is not read any of these; cameras write both, or a program has converted them."""
    first = {_exposure(name): name for name in sorted(names, key=_rank, reverse=True)}
    return {name: own for name in names if _rank(name) > _rank(own := first[_exposure(name)])}


def _rank(name: str) -> int:
    kinds = (_HEIC, (_RAW,), UNREAD)
    return next((rank for rank, kind in enumerate(kinds, 1) if name.lower().endswith(kind)), 0)


def deep_twins(names: Sequence[str], bits: Sequence[int]) -> dict[str, str]:
    """Return the photographs of more than 8 bits a channel that lie beside one of 8 of the same exposure, and this."""
    shallow = {_exposure(name): name for name, own in zip(names, bits, strict=True) if own <= 8}
    return {
        name: shallow[_exposure(name)]
        for name, own in zip(names, bits, strict=True)
        if own > 8 and _exposure(name) in shallow
    }


@dataclass(frozen=True)
class JoinedNames:
    """The photographs of a project ``of`` names as other programs write them, and of ``ambiguous`` ones the photographs
    that each may be. A name that is none is in neither."""

    of: Mapping[str, str]
    ambiguous: Mapping[str, tuple[str, ...]]

    @property
    def ambiguities(self) -> str:
        """Return in words which names fit several photographs, with these, or one that another name fits too."""
        return some([f"{name} ({' or '.join(fitting[:3])})" for name, fitting in self.ambiguous.items()])


def joined_names(given: Iterable[str], names: Sequence[str]) -> JoinedNames:
    """Return which of the photographs ``names`` each name is: as it is, else the one whose path ends as it does or
    that ends its path, whatever the case and the separators, else the one of its file's name without suffix, else
    without leading zeros; of several the one that spells the file's name alike. Where several photographs fit alike, or
    several names fit one, nothing is guessed."""
    whole, forms = set(names), [_forms_of(names, form) for form in (_parts, _stem, _unpadded)]
    joined, ambiguous = dict[str, str](), dict[str, tuple[str, ...]]()
    for name in dict.fromkeys(given):
        if name in whole:
            joined[name] = name
            continue
        for form, known in zip((_parts, _stem, _unpadded), forms, strict=True):
            fitting = _longest(known, form(name))
            alike = [own for own in fitting if _file_name(own) == _file_name(name)]
            fitting = alike if len(alike) == 1 else fitting
            if len(fitting) == 1:
                joined[name] = fitting[0]
            elif fitting:
                ambiguous[name] = tuple(fitting)
            if fitting:
                break
    count = Counter(joined.values())
    several = {name: (own,) for name, own in joined.items() if count[own] > 1 and name != own}
    return JoinedNames({n: own for n, own in joined.items() if n not in several}, ambiguous | several)


_Form = tuple[str, ...]


def _file_name(name: str) -> str:
    return name.strip().replace("\\", "/").rpartition("/")[2]


def _parts(name: str) -> _Form:
    """Return folders and file name from the end, in one spelling."""
    return tuple(
        reversed([part for part in name.strip().replace("\\", "/").casefold().split("/") if part not in ("", ".")])
    )


def _stem(name: str) -> _Form:
    parts = _parts(name)
    suffix = PurePosixPath(parts[0]).suffix if parts else ""
    return (parts[0].removesuffix(suffix), *parts[1:]) if suffix in (*SUFFIXES, *UNREAD) else parts


def _unpadded(name: str) -> _Form:
    return tuple(re.sub(r"(?<!\d)0+(?=\d)", "", part) for part in _stem(name))


def _forms_of(names: Sequence[str], form: Callable[[str], _Form]) -> dict[str, list[tuple[_Form, str]]]:
    """Return the photographs by the first part of their form, their file's name."""
    known = defaultdict[str, list[tuple[_Form, str]]](list)
    for name in names:
        own = form(name)
        known[own[0]].append((own, name))
    return known


def _longest(known: Mapping[str, Sequence[tuple[_Form, str]]], given: _Form) -> list[str]:
    """Return the photographs of a file's name that have most folders in common with a name, from the end."""
    if not given:
        return []
    alike = [(_common(form, given), name) for form, name in known.get(given[0], ())]
    most = max((length for length, _ in alike), default=0)
    return [name for length, name in alike if length == most]


def _common(one: _Form, other: _Form) -> int:
    return next((i for i, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
