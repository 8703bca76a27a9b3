"""Shutters by the models that tags name, and what a drafted camera states of one.

Most drones read their pictures row by row, some have a mechanical or a global shutter. Where one of the first kind is
known, its read-out time is a prior that the photographs may outvote; otherwise it is looked for. A model's name does
not rule it out: in bright light, by a setting or by other firmware some mechanical shutters stay open.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.files.photographs.tags import PhotographTags

READOUT_MS = {
    **dict.fromkeys(("FC300S", "FC300C", "FC300X", "FC330"), 33),
    **{"FC200": 74, "FC350": 30, "FC7203": 20, "FC3170": 27, "FC3411": 32, "L1D-20c": 56, "FC3582": 26},
}
"""Read-out times of whole pictures, as the users of OpenDroneMap have measured them (its table of rolling shutters)."""

ALL_AT_ONCE = frozenset(
    {"FC6310", "FC6310S", "FC6310R", "FC6360", "FC6510", "M3E", "M3M", "ZenmuseP1", "S.O.D.A.", "aeria X"}
)
"""Models with a mechanical or a global shutter, from the makers' data sheets."""

STATED_SHARE, STATED_S = 0.2, 0.005
"""Prior standard deviation of a read-out time in the table, which counts other modes and firmware: a share of it, and
what is added."""

UNKNOWN_S = 0.03
"""Prior standard deviation of one that is looked for."""

MOVING_SHARE = 0.8
"""Of a camera's photographs, that must tell their velocity, or position and time, to fractions of a second."""


@dataclass(frozen=True)
class Shutter:
    """What is known of a shutter: the prior of its read-out time, s, 0 and 0 for none, and where it comes from."""

    readout_s: float
    sigma_s: float
    source: str


def shutter_of(tags: Sequence[PhotographTags]) -> Shutter | None:
    """Return what the tags of a camera's photographs tell of its shutter, None where its photographs do not tell how
    they moved, so that nothing can be told of it."""
    model = (tags[0].model or "").strip()
    fine = any(t.time is not None and t.time.microsecond for t in tags)
    moving = sum(
        t.velocity_m_s is not None or (fine and t.time is not None and t.longitude_deg is not None) for t in tags
    )
    told = len(tags) >= 2 and moving >= MOVING_SHARE * len(tags)
    if model in ALL_AT_ONCE:
        source = f"by its data sheet the {model} has a mechanical or global shutter"
        if not told:
            return Shutter(0.0, 0.0, source)
        return Shutter(0.0, UNKNOWN_S, f"{source}; whether it was used, the photographs say")
    if not told:
        return None
    if model in READOUT_MS:
        readout_s = READOUT_MS[model] / 1000.0
        source = f"the {model} has a rolling shutter, read out in {READOUT_MS[model]} ms by the table of OpenDroneMap"
        return Shutter(readout_s, STATED_SHARE * readout_s + STATED_S, source)
    return Shutter(0.0, UNKNOWN_S, "a rolling shutter is looked for: write readout_s: 0 without a sigma if it has none")
