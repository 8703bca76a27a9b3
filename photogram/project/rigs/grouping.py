"""Which photographs of a rig are one exposure: by the identifier in their tags, by their names, or by time."""

import re
from collections import defaultdict
from collections.abc import Collection, Hashable, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Protocol

import numpy as np

from photogram.constraints.rigs import Companion, RelativePose, exposures
from photogram.project.rigs.entries import ProjectRig
from photogram.survey import Photograph
from photogram.wording import some, things

_MOST_NAMED = 3


class Exposed(Protocol):
    """What groups a photograph: its name, the identifier of its exposure, and its time, s."""

    @property
    def name(self) -> str:
        """Return the file name."""

    @property
    def capture(self) -> str | None:
        """Return the identifier of the exposure, None without one."""

    @property
    def time_s(self) -> float | None:
        """Return the time of exposure, None without one."""


@dataclass(frozen=True)
class Grouped:
    """The rigs of a survey as its photographs show them."""

    companions: tuple[Companion, ...]
    """The companions with their exposures, rig after rig."""
    alone: tuple[tuple[str, ...], ...]
    """Names of the photographs of each that have no photograph of their master."""
    errors: tuple[str, ...]
    """What makes exposures ambiguous, or a rig none."""


def _keys(rig: ProjectRig, photographs: Sequence[Exposed]) -> list[Hashable | None]:
    """Return by photograph what is the same for all of one exposure, None where it is not known."""
    if rig.exposures == "capture":
        return [p.capture or None for p in photographs]
    if rig.exposures == "name":
        pattern = re.compile(rig.name_pattern)
        paths = [PurePath(p.name) for p in photographs]
        matches = [pattern.search(path.name) for path in paths]
        return [None if m is None else (path.parent, m.groups()) for path, m in zip(paths, matches, strict=True)]
    return _by_time(rig, photographs)


def _by_time(rig: ProjectRig, photographs: Sequence[Exposed]) -> list[Hashable | None]:
    """Return by photograph the number of the nearest master in time, within the tolerance."""
    masters = [
        (photograph.time_s, i)
        for i, (photograph, camera) in enumerate(zip(photographs, rig.cameras, strict=True))
        if camera == rig.master and photograph.time_s is not None
    ]
    times = np.array([time_s for time_s, _ in masters])
    keys: list[Hashable | None] = []
    for i, (photograph, camera) in enumerate(zip(photographs, rig.cameras, strict=True)):
        if camera == rig.master:
            keys.append(i)
            continue
        if photograph.time_s is None or not masters:
            keys.append(None)
            continue
        apart = np.abs(times - photograph.time_s)
        nearest = int(np.argmin(apart))
        keys.append(masters[nearest][1] if apart[nearest] <= rig.tolerance_s else None)
    return keys


def _twice(rig: ProjectRig, names: Sequence[str], cameras: Sequence[str], keys: Sequence[Hashable | None]) -> list[str]:
    """Return the photographs of one camera that would be one exposure, in words."""
    groups: defaultdict[tuple[str, Hashable], list[str]] = defaultdict(list)
    for name, camera, key in zip(names, cameras, keys, strict=True):
        if key is not None:
            groups[camera, key].append(name)
    wrong = [(camera, group) for (camera, _), group in groups.items() if len(group) > 1]
    by = {"capture": "the identifiers in their tags", "name": "name_pattern", "time": "tolerance_s"}[rig.exposures]
    texts = [
        f"{things(len(group), 'photograph')} of camera {camera} are one exposure, {some(group)}: check {by}, "
        "or leave all but one out"
        for camera, group in wrong[:_MOST_NAMED]
    ]
    return texts + ([f"and {len(wrong) - _MOST_NAMED} more exposures like this"] if len(wrong) > _MOST_NAMED else [])


def grouped(rigs: Sequence[ProjectRig], photographs: Sequence[Exposed], without: Collection[int] = ()) -> Grouped:
    """Group the photographs of a project to the exposures of its rigs; those of the numbers ``without`` are no
    photographs of their own, being copies of others."""
    companions: list[Companion] = []
    alone: list[tuple[str, ...]] = []
    errors: list[str] = []
    for rig in rigs:
        of_rig = {rig.master, *(companion.camera for companion in rig.companions)}
        own = [i for i, camera in enumerate(rig.cameras) if camera in of_rig and i not in without]
        every = _keys(rig, photographs)
        names, cameras = [photographs[i].name for i in own], [rig.cameras[i] for i in own]
        keys = [every[i] for i in own]
        twice = _twice(rig, names, cameras, keys)
        if twice:
            errors += [f"rig of {rig.master}: {text}" for text in twice]
            continue
        groups = exposures(cameras, keys, rig.master)
        for companion in rig.companions:
            pairs = tuple(
                (names[i], names[master]) for i, master in groups.companion_master if cameras[i] == companion.camera
            )
            companions.append(
                Companion(
                    companion.camera,
                    rig.master,
                    companion.given,
                    companion.sigma,
                    pairs,
                    np.tile(rig.exposure_sigma, (len(pairs), 1)),
                )
            )
            alone.append(tuple(names[i] for i in groups.without_master if cameras[i] == companion.camera))
            if not pairs:
                errors.append(f"rig of {rig.master}: {_nothing(rig, companion.camera)}")
    return Grouped(tuple(companions), tuple(alone), tuple(errors))


def measured_by_master(photographs: Sequence[Photograph], rigs: Sequence[Companion]) -> tuple[Photograph, ...]:
    """Return photographs of which companions have the attitude that their master's measured one and the given relative
    pose make, and a position that is off by the given offset.

    What a gimbal measures is the master's attitude, whichever photograph has it in its tags: where the relative
    rotation is free, a companion has none.
    """
    masters = {photograph.name: photograph for photograph in photographs}
    pairs = {name: (rig, masters[master]) for rig in rigs for name, master in rig.exposures}
    return tuple(_carried(p, *pairs[p.name]) if p.name in pairs else p for p in photographs)


def _carried(photograph: Photograph, rig: Companion, master: Photograph) -> Photograph:
    """Return a photograph of a companion with what its master measures."""
    measured, sigma_rad = master.attitude_world_from_camera, master.attitude_sigma_rad
    given = rig.given or RelativePose(np.full(3, np.nan), np.full((3, 3), np.nan))
    bare = replace(photograph, attitude_world_from_camera=None, attitude_sigma_rad=None)
    if measured is None or sigma_rad is None:
        return bare
    if photograph.gnss_world_m is not None and np.isfinite(given.offset_m).all():
        bare = replace(bare, gnss_world_m=photograph.gnss_world_m + measured @ given.offset_m)
    if not np.isfinite(given.rotation_master_from_companion).all():
        return bare
    return replace(
        bare,
        attitude_world_from_camera=measured @ given.rotation_master_from_companion,
        attitude_sigma_rad=float(np.hypot(sigma_rad, rig.sigma[:3].max())),
        heading_known=master.heading_known,
    )


def _nothing(rig: ProjectRig, camera: str) -> str:
    """Return why a companion may have no exposure with its master."""
    remedy = {
        "capture": "their tags have no identifier in common: write exposures: name or time",
        "name": f"no two names have the groups of {rig.name_pattern!r} in common: correct name_pattern",
        "time": f"none were taken within {rig.tolerance_s:g} s: correct tolerance_s, or write exposures: name",
    }
    return f"no photograph of camera {camera} is one exposure with one of camera {rig.master}: {remedy[rig.exposures]}"
