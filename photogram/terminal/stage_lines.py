"""What the terminal says of a finished stage, in a sentence with units."""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from statistics import median

from photogram.pipeline.store.stage_summary import StageSummary
from photogram.wording import things

_METHODS = {
    "control": "from control points",
    "attitude": "from measured positions and attitudes",
    "growth": "from a first pair, photograph by photograph",
    "start": "from the solution that the project starts from",
}


def _cells(summary: StageSummary) -> str:
    return f"{summary['columns']} × {summary['rows']} cells of {summary['cell_m']:g} m"


def _photographs(summary: StageSummary) -> str:
    parts = [f"{things(summary['photographs'], 'photograph')} read"]
    if summary.get("copies"):
        parts.append(f"{things(summary['copies'], 'copy', 'copies')} left out")
    if summary.get("frozen_positions"):
        parts.append(f"{things(summary['frozen_positions'], 'position')} of a stopped receiver not used")
    return ", ".join(parts)


def _features(summary: StageSummary) -> str:
    counts = summary["key_points"]
    text = f"{median(counts):.0f} key points per photograph (median)" if counts else "no key points"
    masks = summary.get("masks", 0)
    return f"{text}, {things(masks, 'mask')} of {summary['masked_share']:.0%} on average" if masks else text


def _pairs(summary: StageSummary) -> str:
    return f"{things(summary['pairs'], 'pair')} selected"


def _matches(summary: StageSummary) -> str:
    return f"{summary['verified_pairs']} of {things(summary['pairs'], 'pair')} verified"


def _tie_points(summary: StageSummary) -> str:
    left_out = summary["conflicts"]
    return f"{things(summary['tie_points'], 'tie point')}" + (
        f", {left_out} contradictory rejected" if left_out else ""
    )


def _orientation(summary: StageSummary) -> str:
    how = _METHODS.get(summary["method"], f"by {summary['method']}")
    return f"{things(summary['registered'], 'photograph')} oriented, {how}"


def _transfer(summary: StageSummary) -> str:
    sky = f", sky masked in {things(summary['sky'], 'photograph')}" if "sky" in summary else ""
    if not summary["transferred"]:
        return f"{things(summary['tie_points'], 'tie point')}, no further observations{sky}"
    further = things(summary["transferred"], "further observation")
    return f"{further} of {things(summary['tie_points'], 'tie point')}{sky}"


def _intersection(summary: StageSummary) -> str:
    return f"{summary['linear_2view']} points from two views, {summary['linear_3view']} from three"


def _adjustment(summary: StageSummary) -> str:
    iterations = things(summary["iterations"], "iteration")
    parts = [f"converged after {iterations}" if summary["converged"] else f"NOT converged after {iterations}"]
    sigma0 = summary["sigma0"]
    parts.append(f"sigma0 {nan if sigma0 is None else sigma0:.3f}")
    if summary.get("blunders"):
        parts.append(f"{things(summary['blunders'], 'blunder')} rejected")
    headings, attitudes = summary.get("disbelieved_headings", 0), summary.get("disbelieved_attitudes", 0)
    parts += [f"{things(n, what)} not used" for n, what in ((headings, "heading"), (attitudes, "attitude")) if n]
    return ", ".join(parts)


def _dense(summary: StageSummary) -> str:
    return f"{_cells(summary)}, {things(summary['levels'], 'level')}" if "columns" in summary else "not requested"


def _surface(summary: StageSummary) -> str:
    if "left_out" in summary:
        return f"left out: {summary['left_out']}"
    wet = summary.get("water_of_grid")
    water = "" if wet is None else ", no water found" if not wet else f", {things(wet, 'cell')} on water"
    return f"{_cells(summary)}{water}"


def _relief(summary: StageSummary) -> str:
    if "left_out" in summary:
        return f"left out: {summary['left_out']}"
    parts = []
    if "interpolated" in summary:
        parts.append(f"terrain with {things(summary['interpolated'], 'interpolated cell')}")
    if "contours" in summary:
        lines = things(summary["contours"], "contour line")
        parts.append(f"{lines} every {summary['interval_m']:g} m of the {summary['of']}")
    return ", ".join(parts) or "not requested"


def _orthophoto(summary: StageSummary) -> str:
    if "left_out" in summary:
        return f"left out: {summary['left_out']}"
    if "columns" not in summary:
        return "not requested"
    return f"{_cells(summary)} from {things(summary['photographs'], 'photograph')}"


def _comparison(summary: StageSummary) -> str:
    clouds = summary["clouds"]
    return f"{things(clouds, 'cloud')} compared with the reference" if clouds else "no reference given"


def _results(summary: StageSummary) -> str:
    return f"{things(len(summary['products']), 'file')} written"


SENTENCES: dict[str, Callable[[StageSummary], str]] = {
    "photographs": _photographs,
    "features": _features,
    "pairs": _pairs,
    "matches": _matches,
    "tie_points": _tie_points,
    "orientation": _orientation,
    "transfer": _transfer,
    "intersection": _intersection,
    "adjustment": _adjustment,
    "dense": _dense,
    "surface": _surface,
    "relief": _relief,
    "orthophoto": _orthophoto,
    "comparison": _comparison,
    "results": _results,
}
"""By the name of the stage."""


def sentence(stage: str, summary: StageSummary) -> str:
    """Return what a finished stage did, from the summary that it left."""
    return f"not needed: {summary['not_needed']}" if "not_needed" in summary else SENTENCES[stage](summary)
