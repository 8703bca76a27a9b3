"""Positions from the tags of photographs: how good they are along each axis, and what they may be off by together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from photogram.files.tags import PhotographTags

Sigma3 = tuple[float, float, float]
GnssKind = Literal["RTK fix", "RTK float", "single receiver", "with stated accuracy", "without stated accuracy"]

RTK_SIGMA_M = 0.1
"""Positions whose stated plan accuracy is this good come from RTK or PPK, whatever their tags call it."""

_AUTONOMOUS: Sigma3 = (2.0, 2.0, 3.0)
_FINEST: Sigma3 = (0.01, 0.01, 0.015)


@dataclass(frozen=True)
class Gnss:
    """How good a photograph's position is: ``sigma_m`` along easting, northing and height."""

    kind: GnssKind
    sigma_m: Sigma3


def _at_least(sigma_m: Sigma3 | None, otherwise: Sigma3, floor: Sigma3) -> Sigma3:
    east, north, up = (round(max(s, f), 3) for s, f in zip(sigma_m or otherwise, floor, strict=True))
    return east, north, up


def gnss_of(tags: PhotographTags) -> Gnss | None:
    """Return how good the position in the tags is, None where there is none.

    The sigmas of RTK are those of the tags, along each axis, but not below what antennas, clocks and the lever arm
    leave: 1 cm in plan and 1.5 cm in height with fixed ambiguities, 0.2 and 0.4 m without, 1.5 and 3 m of one receiver.
    """
    if tags.longitude_deg is None or tags.latitude_deg is None or tags.height_m is None:
        return None
    sigma, flag, error = tags.gnss_sigma_m, tags.rtk_flag, tags.gnss_horizontal_error_m
    if flag is not None and flag >= 50:
        return Gnss("RTK fix", _at_least(sigma, (0.02, 0.02, 0.03), _FINEST))
    if flag is not None and flag >= 32:
        return Gnss("RTK float", _at_least(sigma, (0.5, 0.5, 1.0), (0.2, 0.2, 0.4)))
    if flag is not None and flag > 0:
        return Gnss("single receiver", _at_least(sigma, _AUTONOMOUS, (1.5, 1.5, 3.0)))
    if flag is None and sigma is not None:
        return Gnss("with stated accuracy", _at_least(sigma, sigma, _FINEST))
    if error is not None:
        return Gnss("with stated accuracy", _at_least((error, error, 2.0 * error), _AUTONOMOUS, _FINEST))
    return Gnss("without stated accuracy", _AUTONOMOUS)


def _is_precise(gnss: Gnss | None) -> bool:
    return gnss is not None and (
        gnss.kind == "RTK fix" or (gnss.kind == "with stated accuracy" and max(gnss.sigma_m[:2]) <= RTK_SIGMA_M)
    )


def offset_prior(gnss: Sequence[Gnss | None], has_control: bool) -> tuple[Sigma3, str]:
    """Return the prior sigmas of the offset of each flight's positions, along easting, northing and height, and why."""
    known = [g for g in gnss if g is not None]
    precise = bool(known) and sum(_is_precise(g) for g in known) * 2 > len(known)
    if has_control and precise:
        return (0.1, 0.1, 0.15), (
            "RTK positions against the control points: the base's coordinates, the lever arm between antenna and lens. "
            "Heights above a geoid differ from those of RTK by tens of metres: that is no offset, declare the systems "
            "under heights."
        )
    if has_control:
        return (3.0, 3.0, 30.0), (
            "Without RTK a whole flight is off by metres in plan, and its heights, from a barometer, by tens of "
            "metres. The control points find these offsets, one for each flight."
        )
    if precise:
        reason = "RTK and no control points: the positions are taken as they are, without a common offset."
        return (0.0, 0.0, 0.0), reason
    return (2.0, 2.0, 10.0), (
        "Without RTK and without control points a whole flight may be off by this much; nothing can find it, so the "
        "report's absolute accuracies contain it."
    )


def height_reference(tags: Sequence[PhotographTags]) -> str:
    """Return in words from what the heights in the tags are counted; empty where there are none."""
    kinds = Counter(t.height_is_ellipsoidal for t in tags if t.height_m is not None)
    if not kinds:
        return ""
    texts: dict[bool | None, str] = {
        True: "above the ellipsoid",
        False: "near sea level, as the tags say",
        None: "near sea level or of a barometer, the tags do not say",
    }
    return "Their heights are " + "; ".join(
        texts[kind] + (f" ({count} photographs)" if len(kinds) > 1 else "") for kind, count in kinds.most_common()
    )
