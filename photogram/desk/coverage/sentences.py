"""What is said of a survey's coverage, in sentences."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NotRequired

import numpy as np
from typing_extensions import TypedDict

from photogram.arrays import BoolArray, FloatArray, IntArray
from photogram.desk.coverage.field_check import ENOUGH, WELL_SEEN
from photogram.desk.coverage.overlaps import Overlaps
from photogram.desk.coverage.tagged_flight import TaggedFlight
from photogram.languages.said import Figures, Said, some_of
from photogram.wording import percent

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
    lang: NotRequired[Literal["en"]]
    """Where the engine says it, which speaks English alone."""


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


def area_words(area_m2: float) -> Figures:
    """Return an area in words."""
    return Figures(f"{area_m2 / 1e4:.2f} ha" if area_m2 >= 1e4 else f"{area_m2:.0f} m²")


def nowhere() -> Sentence:
    """Return what is said where no photograph has a position."""
    return _warning(
        Said("No photograph has a position, in its tags or in the project: what they cover cannot be told.")
    )


def level_unknown(flight: TaggedFlight) -> Sentence:
    """Return what is said where nothing tells how high photographs flew, or none looks down."""
    if flight.ground_world_m is None:
        return _warning(
            Said(
                "Nothing tells how high the photographs flew above the ground, neither tags nor ground points: "
                "what they cover cannot be told."
            )
        )
    return _warning(Said("No photograph looks down at the ground from above it: what they cover is not told on a map."))


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
        return [
            _note(Said("The photographs stand in one line: there is no ground within the survey to look for gaps."))
        ]
    if not areas:
        return [_note(Said("No gap: {least} photographs or more look everywhere within the survey.", least=ENOUGH))]
    return [
        _warning(
            Said.plural(
                "{n} gap within the survey, {area}: fewer than {least} photographs look there. Fly it again before you "
                "leave.",
                "{n} gaps within the survey, {area} together, the largest of {largest}: fewer than {least} photographs "
                "look there. Fly it again before you leave.",
                len(areas),
                area=area_words(sum(areas)),
                largest=area_words(areas[0]),
                least=ENOUGH,
            )
        )
    ]


def _sides(counted: Counted) -> list[Sentence]:
    names = {"north": Said("north"), "east": Said("east"), "south": Said("south"), "west": Said("west")}
    weak = [names[side] for side, share in counted.weak.items() if share > MOSTLY]
    if not weak:
        return []
    return [
        _warning(
            Said.plural(
                "Weak on one side, {sides}: fewer than {least} photographs see most of that edge of the survey.",
                "Weak on {n} sides, {sides}: fewer than {least} photographs see most of these edges of the survey.",
                len(weak),
                sides=weak,
                least=WELL_SEEN,
            )
        )
    ]


def _areas(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    height_m = float(np.median(flight.height_m[counted.down]))
    below = f"{height_m:.0f}"
    level = (
        Said(
            "Counted on level ground {below} m below the photographs, by the heights above take-off in the tags.",
            below=below,
        )
        if flight.ground_by_tags
        else Said("Counted on level ground {below} m below the photographs, by the ground points.", below=below)
    )
    told = [
        _note(level),
        _note(
            Said(
                "Seen by two photographs or more: {two}; by three: {three}; by five: {five}.",
                two=area_words(counted.seen_m2[2]),
                three=area_words(counted.seen_m2[3]),
                five=area_words(counted.seen_m2[5]),
            )
        ),
    ]
    if len(counted.gsd_m):
        best, worst = (float(v) * 100 for v in (np.median(counted.gsd_m), counted.gsd_m.max()))
        ratio, least = float(np.median(counted.base_ratio)), float(counted.base_ratio.min())
        told += [
            _note(
                Said(
                    "Within the survey a pixel is {median} cm on the ground (median), {most} cm at most.",
                    median=Figures(f"{best:.2f}"),
                    most=Figures(f"{worst:.2f}"),
                )
            ),
            _note(
                Said(
                    "Best base/height ratio within the survey: {median} (median), {least} at least.",
                    median=Figures(f"{ratio:.2f}"),
                    least=Figures(f"{least:.2f}"),
                )
            ),
        ]
    return told


def _overlaps(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    known, told = counted.overlaps, list[Sentence]()
    for is_forward, share, pair in ((True, known.forward, known.pair), (False, known.side, known.across)):
        if len(share):
            worst = int(np.argmin(share))
            first, second = (flight.name[i] for i in pair[worst].tolist())
            median, least = (Figures(percent(float(s))) for s in (np.median(share), share[worst]))
            told.append(_note(_overlap(is_forward, median, least, first, second)))
    return told


def _overlap(is_forward: bool, median: Figures, least: Figures, first: str, second: str) -> Said:
    if is_forward:
        return Said(
            "Forward overlap {median} (median), {least} at least, of {first} and {second}.",
            median=median, least=least, first=first, second=second,
        )  # fmt: skip
    return Said(
        "Side overlap {median} (median), {least} at least, of {first} and {second}.",
        median=median, least=least, first=first, second=second,
    )  # fmt: skip


def _left_out(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    told, aside = list[Sentence](), len(flight.name) - len(counted.down)
    unturned = int(np.count_nonzero(~flight.turned))
    if flight.unplaced:
        told.append(
            _warning(
                Said.plural(
                    "Not counted: {n} photograph without a position.",
                    "Not counted: {n} photographs without a position.",
                    flight.unplaced,
                )
            )
        )
    if aside:
        told.append(
            _note(
                Said.plural(
                    "Not counted: {n} photograph not looking down at the ground.",
                    "Not counted: {n} photographs not looking down at the ground.",
                    aside,
                )
            )
        )
    if unturned:
        told.append(
            _note(
                Said.plural(
                    "{n} photograph without an attitude in the tags: counted as if it looked straight down, its top in "
                    "the direction of flight.",
                    "{n} photographs without an attitude in the tags: counted as if they looked straight down, their "
                    "top in the direction of flight.",
                    unturned,
                )
            )
        )
    return told


def _fixes(flight: TaggedFlight) -> list[Sentence]:
    said = [(name, kind) for name, kind in zip(flight.name, flight.solution, strict=True) if kind != "unknown"]
    bare = [name for name, kind in said if kind != "fix"]
    if not bare:
        return []
    if len(bare) == len(said):
        return [_note(Said("No photograph has an RTK fix."))]
    return [
        _warning(
            Said.plural(
                "Without an RTK fix: {n} photograph of {all}, {names}.",
                "Without an RTK fix: {n} photographs of {all}, {names}.",
                len(bare),
                all=len(said),
                names=some_of(bare),
            )
        )
    ]


def _unusual(flight: TaggedFlight, counted: Counted) -> list[Sentence]:
    down, told = counted.down, list[Sentence]()
    height_m = flight.height_m[down]
    usual_m = float(np.median(height_m))
    usual = f"{usual_m:.0f}"
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

    def named(which: BoolArray) -> list[str]:
        return [flight.name[down[i]] for i in np.flatnonzero(which).tolist()]

    if names := named(np.abs(height_m / usual_m - 1.0) > OTHER_HEIGHT):
        told.append(
            _note(
                Said.plural(
                    "Much higher or lower above the ground than the usual {usual} m: {n} photograph, {names}.",
                    "Much higher or lower above the ground than the usual {usual} m: {n} photographs, {names}.",
                    len(names),
                    usual=usual,
                    names=some_of(names),
                )
            )
        )
    if names := named(measured & (np.abs(tilt - np.median(tilt)) > OTHER_TILT_DEG)):
        told.append(
            _note(
                Said.plural(
                    "Tilted otherwise than most: {n} photograph, {names}.",
                    "Tilted otherwise than most: {n} photographs, {names}.",
                    len(names),
                    names=some_of(names),
                )
            )
        )
    if names := named(measured & (off > OTHER_YAW_DEG)):
        told.append(
            _note(
                Said.plural(
                    "Turned against the direction of flight otherwise than most: {n} photograph, {names}.",
                    "Turned against the direction of flight otherwise than most: {n} photographs, {names}.",
                    len(names),
                    names=some_of(names),
                )
            )
        )
    return told
