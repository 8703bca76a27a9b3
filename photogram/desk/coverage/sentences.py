"""What is said of a survey's coverage, in sentences."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import FloatArray, IntArray
from photogram.desk.coverage.field_check import ENOUGH, WELL_SEEN
from photogram.desk.coverage.overlaps import Overlaps
from photogram.desk.coverage.tagged_flight import TaggedFlight
from photogram.wording import percent, some, things

OTHER_HEIGHT = 0.25
"""Share by which a height above ground differs strongly from the median."""
OTHER_TILT_DEG, OTHER_YAW_DEG = 10.0, 20.0
"""Angles by which a photograph's tilt, and its turn against the track, differ from the usual ones."""
MOSTLY = 0.5
"""Of a side of the survey, from which it is weak."""


class Sentence(TypedDict):
    """What is said, and whether it asks for something."""

    severity: Literal["warning", "note"]
    text: str


@dataclass(frozen=True, eq=False)
class Counted:
    """What was counted: ``down`` (D,) photographs that look down; area in m² that so many see; areas of gaps; the
    finest ground sampling distance and the best base over height of places (K,) within the survey that two see;
    whether the photographs span an area; the part of each side that few see; overlaps; ``track`` (F, 2) directions of
    flight."""

    down: IntArray
    seen_m2: Mapping[int, float]
    gaps_m2: tuple[float, ...]
    gsd_m: FloatArray
    base_ratio: FloatArray
    has_hull: bool
    weak: Mapping[str, float]
    overlaps: Overlaps
    track: FloatArray


def area_words(area_m2: float) -> str:
    """Return an area in words."""
    return f"{area_m2 / 1e4:.2f} ha" if area_m2 >= 1e4 else f"{area_m2:.0f} m²"


def nowhere() -> Sentence:
    """Return what is said where no photograph has a position."""
    return _warning("No photograph has a position, in its tags or in the project: what they cover cannot be told.")


def level_unknown(flight: TaggedFlight) -> Sentence:
    """Return what is said where nothing tells how high photographs flew, or none looks down."""
    if flight.ground_world_m is None:
        return _warning(
            "Nothing tells how high the photographs flew above the ground, neither tags nor ground points: "
            "what they cover cannot be told."
        )
    return _warning("No photograph looks down at the ground from above it: what they cover is not told on a map.")


def sentences(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    """Return what is said of a survey, what asks for something first."""
    told = [
        *_gaps(counted),
        *_sides(counted),
        *_areas(flight, counted),
        *_overlaps(flight, counted),
        *_left_out(flight, counted),
        *_fixes(flight),
        *_unusual(flight, counted),
    ]
    return sorted(told, key=lambda sentence: sentence["severity"] == "note")


def _warning(text: str) -> Sentence:
    return {"severity": "warning", "text": text}


def _note(text: str) -> Sentence:
    return {"severity": "note", "text": text}


def _gaps(counted: Counted) -> list[Sentence]:
    areas = counted.gaps_m2
    if not counted.has_hull:
        return [_note("The photographs stand in one line: there is no ground within the survey to look for gaps.")]
    if not areas:
        return [_note(f"No gap: {ENOUGH} photographs or more look everywhere within the survey.")]
    largest = f", the largest of {area_words(areas[0])}" if len(areas) > 1 else ""
    return [
        _warning(
            f"{things(len(areas), 'gap')} within the survey, {area_words(sum(areas))}{' together' * (len(areas) > 1)}"
            f"{largest}: fewer than {ENOUGH} photographs look there. Fly it again before you leave."
        )
    ]


def _sides(counted: Counted) -> list[Sentence]:
    weak = [name for name, share in counted.weak.items() if share > MOSTLY]
    if not weak:
        return []
    sides = f"{' and '.join(weak)} side{'s' * (len(weak) > 1)}"
    return [_warning(f"Weak at the {sides}: fewer than {WELL_SEEN} photographs see most of that edge of the survey.")]


def _areas(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    height_m = float(np.median(flight.height_m[counted.down]))
    by = "the heights above take-off in the tags" if flight.ground_by_tags else "the ground points"
    told = [
        _note(f"Counted on level ground {height_m:.0f} m below the photographs, by {by}."),
        _note(
            "Seen by two photographs or more: "
            + "; by ".join(
                f"{word}{area_words(counted.seen_m2[least])}"
                for least, word in ((2, ""), (3, "three: "), (5, "five: "))
            )
            + "."
        ),
    ]
    if len(counted.gsd_m):
        best, worst = (float(v) * 100 for v in (np.median(counted.gsd_m), counted.gsd_m.max()))
        ratio, least = float(np.median(counted.base_ratio)), float(counted.base_ratio.min())
        told += [
            _note(f"Within the survey a pixel is {best:.2f} cm on the ground (median), {worst:.2f} cm at most."),
            _note(f"Best base/height ratio within the survey: {ratio:.2f} (median), {least:.2f} at least."),
        ]
    return told


def _overlaps(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    known, told = counted.overlaps, list[Sentence]()
    pairs = (("Forward", known.forward, known.pair), ("Side", known.side, known.across))
    for title, share, pair in pairs:
        if len(share):
            least = int(np.argmin(share))
            first, second = (flight.name[i] for i in pair[least].tolist())
            told.append(
                _note(
                    f"{title} overlap {percent(float(np.median(share)))} (median), {percent(float(share[least]))} at "
                    f"least, of {first} and {second}."
                )
            )
    return told


def _left_out(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    told, aside = list[Sentence](), len(flight.name) - len(counted.down)
    unturned = int(np.count_nonzero(~flight.turned))
    if flight.unplaced:
        told.append(_warning(f"Not counted: {things(flight.unplaced, 'photograph')} without a position."))
    if aside:
        told.append(_note(f"Not counted: {things(aside, 'photograph')} not looking down at the ground."))
    if unturned:
        told.append(
            _note(
                f"{things(unturned, 'photograph')} without an attitude in the tags: counted as if they looked straight "
                "down, their top in the direction of flight."
            )
        )
    return told


def _fixes(flight: TaggedFlight) -> list[Sentence]:
    said = [(name, kind) for name, kind in zip(flight.name, flight.solution, strict=True) if kind != "unknown"]
    bare = [name for name, kind in said if kind != "fix"]
    if not bare:
        return []
    if len(bare) == len(said):
        return [_note("No photograph has an RTK fix.")]
    return [_warning(f"Without an RTK fix: {things(len(bare), 'photograph')} of {len(said)}, {some(bare)}.")]


def _unusual(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    down, told = counted.down, list[Sentence]()
    height_m = flight.height_m[down]
    usual_m = float(np.median(height_m))
    tilt = np.degrees(np.arccos(np.clip(-flight.rotation[down][:, 2, 2], -1.0, 1.0)))
    top = -flight.rotation[down][:, :2, 1]
    track = counted.track[down]
    # strips to and fro, with the camera turned or not: a turn and its opposite are alike
    turn = 2.0 * (np.arctan2(top[:, 0], top[:, 1]) - np.arctan2(track[:, 0], track[:, 1]))
    steady = np.isfinite(turn) & (tilt < OTHER_TILT_DEG)
    off = np.zeros(len(down))
    if steady.any():
        middle = np.angle(np.exp(1j * turn[steady]).sum())
        off[steady] = np.abs(np.degrees(np.angle(np.exp(1j * (turn[steady] - middle))))) / 2
    measured = flight.turned[down]
    cases = (
        (
            np.abs(height_m / usual_m - 1.0) > OTHER_HEIGHT,
            f"Much higher or lower above the ground than the usual {usual_m:.0f} m",
        ),
        (measured & (np.abs(tilt - np.median(tilt)) > OTHER_TILT_DEG), "Tilted otherwise than most"),
        (measured & (off > OTHER_YAW_DEG), "Turned against the direction of flight otherwise than most"),
    )
    for which, what in cases:
        names = [flight.name[down[i]] for i in np.flatnonzero(which).tolist()]
        if names:
            told.append(_note(f"{what}: {things(len(names), 'photograph')}, {some(names)}."))
    return told
