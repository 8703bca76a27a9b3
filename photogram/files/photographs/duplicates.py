"""Photographs that are there twice: files of the same content, and saved anew under another name."""

from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

import numpy as np

from photogram.errors import ImageError
from photogram.files.photographs.headers import equal_files
from photogram.files.photographs.images import thumbnail
from photogram.files.photographs.stretches import find_stretch
from photogram.files.photographs.tags import PhotographTags

SAME_GREY = 4.0
"""Mean difference of two thumbnails in grey values: a picture saved anew changes by 1, the next of a flight by 10."""


def same_moment(tags: Sequence[PhotographTags | None], cameras: Sequence[object]) -> list[tuple[int, ...]]:
    """Return groups of indices of photographs with the same camera, time, position and attitude in their tags.

    ``cameras`` tells cameras apart that the tags do not, by photograph. Clocks of whole seconds and positions of 1 Hz
    put successive photographs of a burst into one group too.
    """
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, (tag, camera) in enumerate(zip(tags, cameras, strict=True)):
        if tag is None or tag.time is None or tag.longitude_deg is None:
            continue
        body = (camera, tag.make, tag.model, tag.serial, tag.lens, tag.lens_serial, tag.band, tag.kind)
        place = (tag.time, tag.longitude_deg, tag.latitude_deg, tag.height_m)
        angles = (tag.gimbal_yaw_deg, tag.gimbal_pitch_deg, tag.gimbal_roll_deg)
        groups.setdefault((*body, *place, *angles, tag.width_px, tag.height_px), []).append(i)
    return [tuple(group) for group in groups.values() if len(group) > 1]


def _looks_like(first: Path, second: Path, bits: tuple[int, int]) -> bool:
    """Return whether two photographs look the same; those of more than 8 bits are stretched as the first is."""
    if bits[0] != bits[1]:
        return False
    try:
        stretch = find_stretch([first]) if bits[0] > 8 else None
        return float(np.mean(np.abs(thumbnail(first, stretch) - thumbnail(second, stretch)))) < SAME_GREY
    except ImageError:
        return False  # the reading of the photographs says which of them is damaged


def _names_within(number: int, group: Sequence[int], paths: Sequence[Path]) -> int:
    """Return in how many names of a group that of one photograph is contained: copies are called "IMG_1 (1).JPG" or
    "IMG_1_copy.JPG", and marks name the original."""
    return sum(paths[number].stem in paths[other].stem for other in group)


def find_duplicates(
    paths: Sequence[Path], tags: Sequence[PhotographTags | None], cameras: Sequence[object], executor: Executor
) -> list[tuple[int, ...]]:
    """Return groups of indices of photographs that are the same, the one to be used first.

    Those are files of the same content, and photographs of one camera, time, position and attitude that look the same,
    which are compared at an eighth of their size. Photographs that cannot be read are in no group.
    """
    first = {i: group[0] for group in equal_files(paths, executor) for i in group}
    pairs = [(group[0], i) for group in same_moment(tags, cameras) for i in group[1:] if i not in first]
    depths = [0 if tag is None else tag.bits for tag in tags]
    same = executor.map(
        _looks_like,
        [paths[a] for a, _ in pairs],
        [paths[b] for _, b in pairs],
        [(depths[a], depths[b]) for a, b in pairs],
    )
    for (a, b), alike in zip(pairs, same, strict=True):
        if alike:
            first[a] = first.get(a, a)
            first[b] = first[a]
    groups: dict[int, list[int]] = {}
    for i in sorted(first):
        groups.setdefault(first[i], []).append(i)
    return [tuple(sorted(group, key=lambda i: (-_names_within(i, group, paths), i))) for group in groups.values()]
