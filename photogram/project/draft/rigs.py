"""Rigs of a draft: cameras whose photographs have the identifiers of their exposures in common."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from photogram.project.draft.yaml_text import comment, scalar
from photogram.wording import things

FEWEST = 3
"""Exposures in common from which on two cameras are taken for one body."""

SIGMA_M, SIGMA_DEG = 0.01, 0.02
"""What is written for the scatter of an exposure: a millisecond between the shutters at 10 m/s, and a stiff mount."""


@dataclass(frozen=True)
class DraftRig:
    """A rig by the names of its cameras, and the number of exposures with two of them and more."""

    master: str
    companions: tuple[str, ...]
    exposures: int


def draft_rigs(
    cameras: Sequence[str], captures: Sequence[str | None], pixels: Mapping[str, int]
) -> tuple[DraftRig, ...]:
    """Return the rigs of photographs by their cameras and the identifiers of their exposures; the master is the camera
    of the most ``pixels``, of those alike the first. Cameras that have two photographs in one exposure are none."""
    members: defaultdict[str, list[str]] = defaultdict(list)
    for camera, capture in zip(cameras, captures, strict=True):
        if capture is not None:
            members[capture].append(camera)
    if any(len(set(own)) < len(own) for own in members.values()):
        return ()
    exposures: defaultdict[tuple[str, str], int] = defaultdict(int)
    order = list(pixels)
    for own in members.values():
        own.sort(key=order.index)
        for i, first in enumerate(own):
            for second in own[i + 1 :]:
                exposures[first, second] += 1
    groups = {camera: {camera} for camera in order}
    for (first, second), count in exposures.items():
        if count >= FEWEST and groups[first] is not groups[second]:
            joined = groups[first] | groups[second]
            for camera in joined:
                groups[camera] = joined
    rigs, done = [], set[str]()
    for camera in order:
        if camera in done or len(groups[camera]) < 2:
            continue
        done |= groups[camera]
        own = sorted(groups[camera], key=lambda name: (-pixels[name], order.index(name)))
        common = sum(len(set(taken) & groups[camera]) > 1 for taken in members.values())
        rigs.append(DraftRig(own[0], tuple(sorted(own[1:], key=order.index)), common))
    return tuple(rigs)


def rig_lines(rigs: Sequence[DraftRig]) -> list[str]:
    """Return the lines of the rigs in a project file, none where there are none."""
    if not rigs:
        return []
    lines = ["rigs:"]
    for rig in rigs:
        lines += [
            *comment(
                f"Cameras on one body, by the identifiers in the tags of {things(rig.exposures, 'exposure')}. Where a "
                "companion sits beside the master is free: give offset_m and rotation_deg with their sigmas where they "
                "are known.",
                2,
            ),
            f"  - master: {scalar(rig.master)}",
            "    exposures: capture",
            *comment(
                "Assumed: shutters that open within a millisecond at 10 m/s, and a stiff mount. State what is known of "
                "yours.",
                4,
            ),
            f"    sigma_m: {SIGMA_M:g}",
            f"    sigma_deg: {SIGMA_DEG:g}",
            "    companions:",
            *(f"      - camera: {scalar(name)}" for name in rig.companions),
        ]
    return [*lines, ""]
