"""The height systems of a survey for report.json: what came in, what goes out, and the geoid between them."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from photogram.geodesy.crs import product_crs, written_crs
from photogram.geodesy.frames import LocalFrame
from photogram.geodesy.height_systems import DeclaredHeights, HeightSystem
from photogram.report.record.positions import (
    HeightCountsRecord,
    HeightDifferenceRecord,
    HeightInputsRecord,
    HeightsRecord,
)
from photogram.report.values import record_of
from photogram.results import HeightDecision

_WORDS: dict[HeightSystem | None, str] = {
    "ellipsoidal": "above the ellipsoid",
    "orthometric": "above the geoid",
    None: "not declared",
}


def _input(systems: Sequence[HeightSystem | None]) -> HeightCountsRecord:
    """Return how many heights are of each system."""
    counts = Counter(systems)
    return {
        "ellipsoidal": counts["ellipsoidal"],
        "orthometric": counts["orthometric"],
        "undeclared": counts[None],
    }


def _sentence(
    heights: DeclaredHeights,
    name: str,
    geoid_m: float | None,
    inputs: HeightInputsRecord,
    decision: HeightDecision | None,
) -> str:
    decided = "" if decision is None else f" {decision.sentence[0].upper()}{decision.sentence[1:]}."
    if heights.output is None:
        return (
            "The vertical reference is not declared: heights are those of the control points and GNSS positions "
            f"as given, and the products name no height system.{decided}"
        )
    text = f"All heights are {_WORDS[heights.output]}"
    text += f" {heights.map_geoid.name} ({name})" if heights.map_geoid is not None else f" ({name})"
    if geoid_m is not None and heights.geoid is not None:
        side = "above" if geoid_m >= 0 else "below"
        text += f"; the geoid lies {abs(geoid_m):.2f} m {side} the ellipsoid at the middle of the survey"
    changed, bare = list[str](), list[str]()
    for what, given in (("GNSS heights", inputs["gnss"]), ("heights of ground points", inputs["control_points"])):
        other: HeightSystem = "ellipsoidal" if heights.output == "orthometric" else "orthometric"
        if given[other]:
            changed.append(f"{given[other]} {what} were given {_WORDS[other]}")
        if given["undeclared"]:
            bare.append(f"{given['undeclared']} {what}")
    brought = "transformed to it" if heights.geoid is not None else "used as given, since no geoid is named"
    text += "".join(f"; {part} and {brought}" for part in changed)
    text += f"; {' and '.join(bare)} with undeclared reference were used as given" if bare else ""
    return f"{text}.{decided}"


def height_numbers(
    heights: DeclaredHeights,
    frame: LocalFrame,
    gnss: Sequence[HeightSystem | None],
    control_points: Sequence[HeightSystem | None],
    decision: HeightDecision | None = None,
) -> HeightsRecord:
    """Return the height systems: of the results, of every GNSS height and of every ground point's height as given.

    ``decision`` is what the adjustment decided where nobody declares them; ``geoid_height_m`` is that at the origin of
    ``frame``, null without a geoid and where its grid does not reach.
    """
    crs = written_crs(product_crs(frame.crs, heights))
    name = "local frame" if crs is None else str(crs.name)
    geoid_m = None
    if heights.geoid is not None:
        place = LocalFrame(frame.crs, frame.origin_map_m, "grid", heights.geoid)
        geoid_m = float(place.geoid_height_m(np.array([frame.origin_map_m]))[0])
    inputs: HeightInputsRecord = {"gnss": _input(gnss), "control_points": _input(control_points)}
    return {
        "output": heights.output,
        "geoid": None if heights.geoid is None else heights.geoid.name,
        "geoid_height_m": geoid_m,
        "crs": {
            "name": name,
            "epsg": None if crs is None else crs.to_epsg(),
            "wkt": "" if crs is None else crs.to_wkt(),
        },
        "inputs": inputs,
        "difference": None if decision is None else record_of(HeightDifferenceRecord, decision),
        "sentence": _sentence(heights, name, geoid_m, inputs, decision),
    }
