"""Where a survey has no surface in plan, and why: its photographs look sideways, or its network has no scale."""

import numpy as np

from photogram.survey import Block

LEFT_OUT, RIM_FILE = "left_out.json", "rim.json"
"""Why a product is not made; how many cells the rim of the orthophoto holds, and how many of them show nothing."""

LEAST_DEPRESSION_DEG = 20.0
"""Of the median optical axis, below the horizon: what looks flatter shows upright surfaces, which have many heights in
one place."""


def reason_of(block: Block, *, always: bool = False) -> str:
    """Return why an adjusted block gives no surface in plan, empty where it does: none without a scale; of photographs
    that look sideways one where it is wanted ``always``."""
    if not block.has_scale:
        return "the network has no scale: give a distance for a surface model, an orthophoto and contour lines"
    down = np.array([-pose.rotation_world_from_camera[2, 2] for pose in block.poses if pose is not None])
    depression_deg = float(np.rad2deg(np.arcsin(np.clip(np.median(down), -1.0, 1.0)))) if len(down) else 90.0
    if always or depression_deg >= LEAST_DEPRESSION_DEG:
        return ""
    side = f"{depression_deg:.0f}° below" if depression_deg >= 0 else f"{-depression_deg:.0f}° above"
    return (
        f"the photographs look sideways (median optical axis {side} the horizon): what is upright has many heights in "
        "one place of the plan; surface: {plane: auto} makes surface and orthophoto on a plane fitted to the tie "
        "points, {in_plan: always} a surface in plan all the same"
    )
