"""Orientation from poses that are known already, another program's for example, confirmed by the tie points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from photogram.camera import Camera, Pose
from photogram.errors import OrientationError
from photogram.sfm.incremental import extend
from photogram.sfm.reconstruction import Structure, StructureSettings
from photogram.survey import Block
from photogram.wording import percent

AGREEING_SHARE = 0.5  # of the image points of known poses, below which they are none of the photographs
FEWEST_POINTS = 4  # agreeing in a photograph: three leave up to four poses open


@dataclass(frozen=True, eq=False)
class KnownPoses:
    """Poses (F) in a frame of their own, None where there is none, and the cameras (C) as calibrated with them."""

    poses: tuple[Pose | None, ...]
    cameras: tuple[Camera, ...]

    def only(self, photographs: Sequence[int]) -> KnownPoses:
        """Return those of some photographs."""
        return KnownPoses(tuple(self.poses[i] for i in photographs), self.cameras)


def known_structure(block: Block, settings: StructureSettings, known: KnownPoses) -> Structure:
    """Return the structure of known poses and of what else their tie points join to them.

    A pose that fewer than half of its own image points agree with is found anew. Raises OrientationError where fewer
    than half of all agree.
    """
    structure = Structure.oriented(block.tie_points, known.cameras, block.camera_of, settings, known.poses)
    tie, seen = block.tie_points, structure.intersectable
    agreeing = float(structure.good[seen].mean()) if seen.any() else 0.0
    if agreeing < AGREEING_SHARE:
        raise OrientationError(
            f"the poses that the project starts from do not fit the tie points: {percent(agreeing)} of the image "
            f"points lie within {settings.threshold_px:g} px of what they say: set start: {{poses: own}}, and check "
            "that the solution is one of these photographs"
        )
    good = structure.agreeing
    visible = np.bincount(tie.photograph[seen], minlength=len(block.photographs))
    structure.withdraw(structure.registered & ((good < FEWEST_POINTS) | (good < AGREEING_SHARE * visible)))
    rays = np.bincount(tie.photograph, minlength=len(block.photographs))
    wanted = ~structure.registered & (rays >= settings.minimum_points)
    if wanted.any():
        extend(structure, wanted, lambda *_: None)
    return structure
