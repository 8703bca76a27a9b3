"""Rigs in a project file: a master camera, its companions with what is given of where they sit, and how photographs are
grouped to exposures."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from photogram.arrays import FloatArray
from photogram.constraints.rigs import RelativePose
from photogram.project.document import Document, Key, suggestion
from photogram.project.schema import CompanionEntry, ExposureGrouping, ProjectFile, RigEntry


@dataclass(frozen=True, eq=False)
class ProjectCompanion:
    """A companion camera as the project file gives it."""

    camera: str
    """Its name under ``cameras``."""
    given: RelativePose | None
    """The relative pose that is given, NaN in the part that is not; None where nothing is."""
    sigma: FloatArray
    """Standard deviations (6,) of rotation, rad, and offset, m; infinite for what is free."""
    products: bool
    """Whether surface and orthophoto are made of its photographs too."""


@dataclass(frozen=True, eq=False)
class ProjectRig:
    """Cameras on one body as the project file gives them."""

    master: str
    """Name of the master under ``cameras``."""
    companions: tuple[ProjectCompanion, ...]
    """The other cameras of the body."""
    exposures: ExposureGrouping
    """By what photographs are grouped to exposures."""
    name_pattern: str
    """Regular expression whose groups in a photograph's name are its exposure; empty where names do not count."""
    tolerance_s: float
    """Longest time between photographs of one exposure; 0 where times do not count."""
    exposure_sigma: FloatArray
    """Standard deviations (6,) by which the relative pose of an exposure scatters, rad and m."""
    cameras: tuple[str, ...]
    """Name of the camera of each of the project's photographs."""


def _companions(file: ProjectFile) -> Iterator[tuple[Key, RigEntry, CompanionEntry]]:
    for i, rig in enumerate(file.rigs):
        for j, companion in enumerate(rig.companions or ()):
            yield ("rigs", i, "companions", j), rig, companion


def check_rigs(document: Document, file: ProjectFile) -> None:
    """Note the errors of rigs: cameras that are none, or twice in one, values without their standard deviations, and
    what is missing to group photographs to exposures."""
    taken: dict[str, Key] = {}
    for i, rig in enumerate(file.rigs):
        _check_camera(document, ("rigs", i, "master"), file, rig.master, taken)
        if rig.companions is not None and not rig.companions:
            document.add_error(("rigs", i, "companions"), "is empty: a rig needs a companion beside its master")
        _check_grouping(document, ("rigs", i), rig)
    for key, _, companion in _companions(file):
        _check_camera(document, (*key, "camera"), file, companion.camera, taken)
        for value, sigma, words in (
            ("offset_m", "offset_sigma_m", "metres"),
            ("rotation_deg", "rotation_sigma_deg", "degrees"),
        ):
            if (getattr(companion, value) is None) != (getattr(companion, sigma) is None):
                given, lacking = (sigma, value) if getattr(companion, value) is None else (value, sigma)
                remedy = f"give both, the standard deviation in {words}, or neither where it is free"
                document.add_error((*key, given), f"stands without {lacking}: {remedy}")


def _check_camera(document: Document, key: Key, file: ProjectFile, name: str | None, taken: dict[str, Key]) -> None:
    if name is None:
        return
    if name not in file.cameras:
        document.add_error(key, f"there is no camera {name!r}: {suggestion(name, file.cameras)}")
        return
    if taken.setdefault(name, key) != key:
        line = document.line(taken[name])
        document.add_error(key, f"camera {name!r} is in a rig already, in line {line}: name each camera once")


def _check_grouping(document: Document, key: Key, rig: RigEntry) -> None:
    if rig.exposures == "name" and rig.name_pattern is None:
        text = r"name needs name_pattern, whose groups are what the names of one exposure have in common: 'IMG_(\d+)_'"
        document.add_error((*key, "exposures"), text)
    if rig.exposures == "time" and rig.tolerance_s is None:
        document.add_error((*key, "exposures"), "time needs tolerance_s, the longest time between photographs of one")
    for name, kind in (("name_pattern", "name"), ("tolerance_s", "time")):
        if getattr(rig, name) is not None and rig.exposures not in (None, kind):
            document.add_error(
                (*key, name), f"says nothing beside exposures: {rig.exposures}: remove it, or write {kind}"
            )
    if rig.name_pattern is not None:
        try:
            if not re.compile(rig.name_pattern).groups:
                text = "has no group in parentheses: put what the names of one exposure have in common in parentheses"
                document.add_error((*key, "name_pattern"), text)
        except re.error as error:
            document.add_error((*key, "name_pattern"), f"is no regular expression ({error}): correct it")


def rigs_of(file: ProjectFile, cameras: Sequence[str]) -> tuple[ProjectRig, ...]:
    """Return the rigs of a file without errors; ``cameras`` are the names of the cameras of its photographs."""
    return tuple(
        ProjectRig(
            rig.master or "",
            tuple(_companion(companion) for companion in rig.companions or ()),
            rig.exposures or "capture",
            rig.name_pattern or "",
            rig.tolerance_s or 0.0,
            np.repeat([np.deg2rad(rig.sigma_deg or 0.0), rig.sigma_m or 0.0], 3),
            tuple(cameras),
        )
        for rig in file.rigs
    )


def _companion(entry: CompanionEntry) -> ProjectCompanion:
    offset_m, rotation = np.full(3, np.nan), np.full((3, 3), np.nan)
    sigma = np.full(6, np.inf)
    if entry.rotation_deg is not None and entry.rotation_sigma_deg is not None:
        rotation = Rotation.from_euler("XYZ", entry.rotation_deg, degrees=True).as_matrix()
        sigma[:3] = np.deg2rad(entry.rotation_sigma_deg)
    if entry.offset_m is not None and entry.offset_sigma_m is not None:
        offset_m, sigma[3:] = np.array(entry.offset_m), entry.offset_sigma_m
    given = RelativePose(offset_m, rotation) if np.isfinite(sigma).any() else None
    return ProjectCompanion(entry.camera or "", given, sigma, entry.products)


def bands_of(rigs: Sequence[ProjectRig]) -> dict[str, frozenset[int]]:
    """Return the companions of which no surface and no colours are made, with the numbers of their photographs."""
    return {
        companion.camera: frozenset(i for i, camera in enumerate(rig.cameras) if camera == companion.camera)
        for rig in rigs
        for companion in rig.companions
        if not companion.products
    }


def without_products(rigs: Sequence[ProjectRig]) -> frozenset[int]:
    """Return the numbers of the photographs of a project of which no surface and no colours are made."""
    return frozenset().union(*bands_of(rigs).values())
