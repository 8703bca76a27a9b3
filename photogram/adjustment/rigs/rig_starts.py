"""What a block is adjusted with where cameras are fixed to one body: starts of free relative poses, positions once."""

from dataclasses import replace

import numpy as np

from photogram.constraints.rigs import Companion, RelativePose, middle_of, relative_poses
from photogram.factors.rigs.exposures import taking_part
from photogram.survey import Block, Photograph


def with_rig_starts(block: Block) -> Block:
    """Return the block with a start for every relative pose, or offset or rotation, of which nothing is known: the
    middle of those that the poses of its exposures have. All photographs are oriented."""
    if all(rig.given is not None and rig.given.is_known for rig in block.rigs):
        return block
    every, cameras = taking_part(block), block.oriented_cameras()
    rigs = list[Companion]()
    for k, rig in enumerate(block.rigs):
        own = every.select(every.rig == k)
        if (rig.given is None or not rig.given.is_known) and len(own):
            first, second = ((cameras.rotation[i], cameras.position[i]) for i in (own.master, own.companion))
            start = middle_of(*relative_poses(first, second))
            rig = replace(rig, given=_filled(rig.given or start, start), value=np.zeros(6))
        rigs.append(rig)
    return replace(block, rigs=tuple(rigs))


def _filled(given: RelativePose, start: RelativePose) -> RelativePose:
    """Return a relative pose with offset and rotation of ``start`` where its own is not known."""
    return RelativePose(
        np.where(np.isnan(given.offset_m), start.offset_m, given.offset_m),
        np.where(
            np.isnan(given.rotation_master_from_companion),
            start.rotation_master_from_companion,
            given.rotation_master_from_companion,
        ),
    )


def without_companion_positions(block: Block) -> Block:
    """Return the block in which positions and attitudes that companions have from the same receiver as their master
    count once, as the master's: a second time they would be no second measurement, and off by the rig's offset."""
    names = {photograph.name: photograph for photograph in block.photographs}
    masters = {companion: names[master] for rig in block.rigs for companion, master in rig.exposures if master in names}

    def bare(photograph: Photograph) -> Photograph:
        master = masters.get(photograph.name)
        if master is None:
            return photograph
        if master.gnss_world_m is not None:
            photograph = replace(photograph, gnss_world_m=None, gnss_sigma_m=None, lever_arm_camera_m=None)
        if master.attitude_world_from_camera is not None:
            photograph = replace(photograph, attitude_world_from_camera=None, attitude_sigma_rad=None)
        return photograph

    return replace(block, photographs=tuple(bare(photograph) for photograph in block.photographs))
