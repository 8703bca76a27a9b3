"""Poses of companions from their masters: bands that match no other photograph are oriented by the body they sit on."""

from dataclasses import replace

import numpy as np

from photogram.camera import Pose
from photogram.sfm.orientation import Orientation
from photogram.survey import Block


def carried_by_masters(block: Block, orientation: Orientation) -> Orientation:
    """Return an orientation in which the companions without a pose have that of their master with the relative pose
    that is given; where offset or rotation is free there is nothing to place them by, and they stay without."""
    numbers = {photograph.name: i for i, photograph in enumerate(block.photographs)}
    poses = list(orientation.poses)
    component = orientation.component.copy()
    reason = list(orientation.reason)
    for rig in block.rigs:
        given = rig.pose
        if given is None:
            continue
        for companion, master in rig.exposures:
            i, pose = numbers.get(companion, -1), orientation.poses[numbers[master]] if master in numbers else None
            if i < 0 or poses[i] is not None or pose is None:
                continue
            R, X = given.companions(pose.rotation_world_from_camera[None], pose.position_world_m[None])
            poses[i] = Pose(np.asarray(R[0]), np.asarray(X[0]))
            component[i], reason[i] = orientation.component[numbers[master]], ""
    return replace(orientation, poses=tuple(poses), component=component, reason=tuple(reason))
