"""Positions from the tags of photographs: how good they are along each axis, and what they may be off by together."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from photogram.files.photographs.tags import PhotographTags
from photogram.gnss import FLOOR_M, RTK_OFFSET_SIGMA_M, Sigma3, Solution, at_least, solution_of_rtk_flag

GnssKind = Literal["RTK fix", "RTK float", "single (autonomous)", "with stated accuracy", "without stated accuracy"]

RTK_SIGMA_M = 0.1
"""Positions whose stated plan accuracy is this good come from RTK or PPK, whatever their tags call it."""

AUTONOMOUS_M: Sigma3 = (2.0, 2.0, 3.0)
"""Standard deviations of a single position, taken where nothing states any."""

_ASSUMED: Mapping[Solution, tuple[GnssKind, Sigma3]] = {
    "fix": ("RTK fix", (0.02, 0.02, 0.03)),
    "float": ("RTK float", (0.5, 0.5, 1.0)),
    "single": ("single (autonomous)", AUTONOMOUS_M),
}


@dataclass(frozen=True)
class Gnss:
    """How good a photograph's position is: ``sigma_m`` along easting, northing and height, ``assumed`` where nothing
    states it and the receiver is no better than a consumer's."""

    kind: GnssKind
    sigma_m: Sigma3
    assumed: bool = False


def gnss_with(solution: Solution, sigma_m: Sigma3 | None) -> Gnss | None:
    """Return how good a position of a stated solution is, None where the solution is not known.

    Its sigmas are the stated ones along each axis, but not below those that such a solution can have at best.
    """
    if solution == "unknown":
        return None
    kind, assumed_m = _ASSUMED[solution]
    sigma = _rounded(at_least(sigma_m or assumed_m, FLOOR_M[solution]))
    return Gnss(kind, sigma, sigma_m is None and solution == "single")


def gnss_stated(sigma_m: Sigma3 | None) -> Gnss:
    """Return how good a position is of which nothing but its sigmas may be known."""
    if sigma_m is None:
        return Gnss("without stated accuracy", AUTONOMOUS_M, assumed=True)
    return Gnss("with stated accuracy", _rounded(at_least(sigma_m, FLOOR_M["fix"])))


def _rounded(sigma_m: Sigma3) -> Sigma3:
    east, north, up = (round(s, 3) for s in sigma_m)
    return east, north, up


def gnss_of(tags: PhotographTags) -> Gnss | None:
    """Return how good the position in the tags is, None where there is none.

    The sigmas of RTK are those of the tags, along each axis, but not below FLOOR_M of their solution.
    """
    if tags.longitude_deg is None or tags.latitude_deg is None or tags.height_m is None:
        return None
    sigma, flag, error = tags.gnss_sigma_m, tags.rtk_flag, tags.gnss_horizontal_error_m
    if flag is not None and flag > 0:
        return gnss_with(solution_of_rtk_flag(flag), sigma)
    if flag is None and sigma is not None:
        return gnss_stated(sigma)
    return gnss_stated(None if error is None else (error, error, 2.0 * error))


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
            "Heights above a geoid differ from those of RTK by tens of metres: that is not an offset: "
            "declare the systems under heights."
        )
    if has_control:
        return (3.0, 3.0, 30.0), (
            "Without RTK a whole flight is off by metres in plan and, with barometric heights, by tens of "
            "metres in height. The control points determine these offsets, one per flight."
        )
    if precise:
        return RTK_OFFSET_SIGMA_M, (
            "RTK without control points: base station and corrections may be off by this much for a whole flight, "
            "undetected; the absolute accuracies of the report include it."
        )
    return (2.0, 2.0, 10.0), (
        "Without RTK and without control points a whole flight may be off by this much, undetected; the "
        "absolute accuracies of the report include it."
    )


def height_reference(tags: Sequence[PhotographTags]) -> str:
    """Return in words from what the heights in the tags are counted; empty where there are none."""
    kinds = Counter(t.height_is_ellipsoidal for t in tags if t.height_m is not None)
    if not kinds:
        return ""
    texts: dict[bool | None, str] = {
        True: "above the ellipsoid",
        False: "near sea level, according to the tags",
        None: "near sea level or barometric: the tags do not say",
    }
    return "Their heights are " + "; ".join(
        texts[kind] + (f" ({count} photographs)" if len(kinds) > 1 else "") for kind, count in kinds.most_common()
    )
