"""What the page is told, as plain records: the points and how far each is, and the photographs of one in order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.files.tables.surveyed_points import Mark, Place
from photogram.marking.mark_comparison import ComparedMark
from photogram.marking.page.ordering import azimuth_rad, best_first, in_words, is_enough, share_gained
from photogram.marking.page.outlook import RAW_SIGMA_PX, Outlook
from photogram.marking.page.session import MarkingSession, Moment, agreeing
from photogram.marking.page.snapping import Snapped, ground_scale
from photogram.marking.predictions import SURE, PredictedPlaces
from photogram.marking.targets.kinds import Kind
from photogram.quality.gross_errors.blunder_naming import Blunder
from photogram.survey import Block
from photogram.wording import things

ELLIPSE_SHARE = 1.0 / 3.0
"""Of the side of a patch, what the ellipse of a predicted place fills."""

LEAST_SPAN_PX = 80.0
"""Of a photograph, in a patch at least: a target and what surrounds it."""

IN_LINE = 0.1
"""Ratio of the spread of control points across to that along, below which they lie nearly in one line."""

FEW = 4
"""Photographs of a point by which points are compared that could be marked next."""

AT_ONE_HEIGHT = 0.002
"""Range of the heights of control points, in flying heights, below which they lie nearly at one."""

_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


class EllipseRecord(TypedDict):
    """Where a place lies in 95 of 100: half its axes in px, and the direction of the longer one from u towards v."""

    long_px: float
    short_px: float
    angle_rad: float


class MarkRecord(TypedDict):
    """A mark."""

    u: float
    v: float
    sigma_px: float | None
    kind: str
    doubtful: bool


class ProposalRecord(TypedDict):
    """A target that may be the point."""

    u: float
    v: float
    sigma_px: float | None
    kind: str
    agrees: bool


class BesideRecord(TypedDict):
    """A target beside which a click was taken as it is."""

    u: float
    v: float


class PhotographRecord(TypedDict):
    """A photograph of a point; ``u``, ``v`` is where the point is predicted, None where nothing predicts it;
    ``north_rad`` the direction of north there, from u towards v."""

    name: str
    width_px: int
    height_px: int
    u: float | None
    v: float | None
    ellipse: EllipseRecord | None
    north_rad: float | None
    inside: bool
    hidden: bool
    gain: float | None
    proposal: ProposalRecord | None
    mark: MarkRecord | None
    beside: BesideRecord | None
    rejected: bool
    w: float | None
    off_px: float | None
    fits: list[str]
    words: str


class PointRecord(TypedDict):
    """A point in the list."""

    name: str
    role: str
    surveyed: bool
    marks: int
    proposals: int
    wrong: bool
    doubtful: int
    enough: bool
    words: str


class PointView(TypedDict):
    """A point and its photographs."""

    version: int
    point: PointRecord
    span_px: float
    photographs: list[PhotographRecord]
    next: str | None
    problem: str


class StateView(TypedDict):
    """The whole session."""

    version: int
    points: list[PointRecord]
    first: str | None
    """The point to begin with: the first that wants more marks, else the first of all; None without points."""
    photographs: int
    proposals: int
    agreeing: int
    searching: bool
    search: str
    undoable: int
    redoable: int
    reckoning: bool
    basis: str
    problem: str
    blunders: list[str]
    warnings: list[str]


class PlaceRecord(TypedDict):
    """A point or photograph in plan, metres east and north."""

    name: str
    east_m: float
    north_m: float


class PlanView(TypedDict):
    """The survey in plan."""

    points: list[PlaceRecord]
    photographs: list[PlaceRecord]


def _camera(block: Block, photograph: int) -> Camera:
    return block.cameras[block.photographs[photograph].camera]


def _ellipse(covariance_px2: FloatArray) -> EllipseRecord:
    variance, axes = np.linalg.eigh(covariance_px2)
    short, long = np.sqrt(SURE * np.maximum(variance, 0.0))
    return {
        "long_px": float(long),
        "short_px": float(short),
        "angle_rad": float(np.arctan2(axes[1, 1], axes[0, 1])),
    }


def _mark(mark: Mark) -> MarkRecord:
    sigma = None if mark.sigma_px is None else float(np.sqrt(np.mean(np.square(mark.sigma_px))))
    return {
        "u": mark.pixel[0], "v": mark.pixel[1], "sigma_px": sigma, "kind": mark.kind, "doubtful": mark.is_doubtful,
    }  # fmt: skip


def _proposal(moment: Moment, place: Place) -> ProposalRecord | None:
    proposal = moment.proposals.get(place)
    if proposal is None:
        return None
    mark = _mark(proposal.mark)
    return {
        "u": mark["u"], "v": mark["v"], "sigma_px": mark["sigma_px"], "kind": mark["kind"],
        "agrees": place in agreeing(moment),
    }  # fmt: skip


def accused(blunder: Blunder) -> tuple[str, ...]:
    """Return the points that a blunder is of: whose target a mark is on is innocent."""
    return blunder.points if blunder.kind == "exchanged points" else blunder.points[:1]


def said_beside(mark: Mark, found: Snapped) -> str:
    """Return what is said of a click that was taken as it is beside a target."""
    distance = float(np.hypot(*np.subtract(mark.pixel, found.pixel)))
    what = "what the other marks show" if found.kind == Kind.MATCHED.value else f"the centre of a target ({found.kind})"
    return f"{distance:.1f} px beside {what}"


def said_of(compared: ComparedMark, others: int) -> str:
    """Return what is said of a mark beside the others of its point, of which there are so many."""
    many = _NUMBERS[others] if others < len(_NUMBERS) else str(others)
    if not compared.rejected:
        return f"{compared.distance_px:.1f} px from the {many} others" if others > 1 else ""
    who = "the other marks put it" if others < 1 else f"the {many} others put it" if others > 1 else "the other puts it"
    text = f"{compared.distance_px:.1f} px from where {who}"
    if compared.fits:
        return f"{text}; it would fit {' or '.join(compared.fits[:2])}"
    return text


class Views:
    """Makes the records of a session."""

    def __init__(self, session: MarkingSession) -> None:
        self._session = session
        self._gains: tuple[Outlook | None, dict[str, dict[int, float]]] = (None, {})

    def state(self) -> StateView:
        """Return the whole session."""
        moment = self._session.moment()
        outlook = moment.outlook
        comparison = None if outlook is None else outlook.comparison
        points = [self._point(moment, name) for name in moment.roles]
        return {
            "version": moment.version,
            "points": points,
            "first": next((p["name"] for p in points if not p["enough"]), points[0]["name"] if points else None),
            "photographs": len(self._session.block.photographs),
            "proposals": len(moment.proposals),
            "agreeing": len(agreeing(moment)),
            "searching": moment.search.is_running,
            "search": moment.search.words,
            "undoable": moment.undoable,
            "redoable": moment.state.redoable,
            "reckoning": moment.is_reckoning,
            "basis": moment.basis,
            "problem": "" if outlook is None else outlook.problem,
            "blunders": [] if comparison is None else [b.sentence for b in comparison.blunders],
            "warnings": self._warnings(moment),
        }

    def _warnings(self, moment: Moment) -> list[str]:
        """Return what is weak about the control that is marked in two photographs or more."""
        counts = _counts(moment)
        outlook = moment.outlook
        control = [n for n, role in moment.roles.items() if role == "control" and counts.get(n, 0) >= 2]
        if outlook is None or not control:
            return []
        if len(control) < 3:
            return [f"{things(len(control), 'control point')} marked in two photographs or more: three are needed"]
        at = outlook.position_world_m[[outlook.names.index(n) for n in control if n in outlook.names]]
        at = at[np.isfinite(at).all(axis=1)]
        if len(at) < 3:
            return []
        spread = np.linalg.svd(at[:, :2] - at[:, :2].mean(axis=0), compute_uv=False)
        if spread[1] < IN_LINE * spread[0]:
            return ["the control points marked so far lie nearly in one line: mark one beside it"]
        flown = [pose.position_world_m[2] for pose in self._session.block.poses if pose is not None]
        above = float(np.median(flown) - np.median(at[:, 2])) if flown else 0.0
        if np.ptp(at[:, 2]) < AT_ONE_HEIGHT * above:
            return [
                "the control points marked so far lie nearly at one height: a focal length that is wrong shows only "
                "at others, so mark one that lies higher or lower"
            ]
        return []

    def _point(self, moment: Moment, name: str) -> PointRecord:
        outlook, marks = moment.outlook, _counts(moment).get(name, 0)
        own = [m for m in moment.state.marks.values() if m.point == name]
        wrong = outlook is not None and (
            any(self._of_mark(outlook, m) is not None and outlook.compared[m.place].rejected for m in own)
            or any(self._beside(outlook, m) is not None for m in own)
            or (outlook.comparison is not None and any(name in accused(b) for b in outlook.comparison.blunders))
        )
        gains = list(self._gains_of(outlook, name, moment).values())
        enough = outlook is not None and not wrong and is_enough(marks, gains)
        words = in_words(marks, None if outlook is None else outlook.sigma_m(name))
        return {
            "name": name,
            "role": moment.roles[name],
            "surveyed": moment.roles[name] != "tie",
            "marks": marks,
            "proposals": sum(point == name for point, _ in moment.proposals),
            "wrong": wrong,
            "doubtful": sum(m.is_doubtful for m in own),
            "enough": enough,
            "words": f"{words}: more gain little" if enough else words,
        }

    def _of_mark(self, outlook: Outlook, mark: Mark) -> ComparedMark | None:
        """Return what was found of a mark, None where it is another one now."""
        return outlook.compared.get(mark.place) if outlook.marks.get(mark.place) == mark else None

    def _beside(self, outlook: Outlook, mark: Mark) -> Snapped | None:
        """Return what a mark lies beside, None where it is another one now."""
        return outlook.beside.get(mark.place) if outlook.marks.get(mark.place) == mark else None

    def _gains_of(self, outlook: Outlook | None, name: str, moment: Moment) -> dict[int, float]:
        """Return by photograph what one more mark of a point would gain, where it is not marked and may be seen."""
        if outlook is None or outlook.places is None or outlook.sigma_m(name) is None:
            return {}
        if self._gains[0] is not outlook:
            self._gains = (outlook, {})
        known = self._gains[1]
        if name not in known:
            known[name] = self._reckoned_gains(outlook, name)
        state, photographs = moment.state, self._session.block.photographs
        return {
            i: gain
            for i, gain in known[name].items()
            if (name, photographs[i].name) not in state.marks and (name, photographs[i].name) not in state.not_visible
        }

    def _reckoned_gains(self, outlook: Outlook, name: str) -> dict[int, float]:
        places, sigma_m, block = outlook.places, outlook.sigma_m(name), self._session.block
        g = outlook.names.index(name)
        position = outlook.position_world_m[g]
        if places is None or sigma_m is None or not np.isfinite(position).all():
            return {}
        axes = block.frame.rotation_world_from_map(np.zeros(3))
        covariance = axes @ np.diag(sigma_m**2) @ axes.T
        gains = {}
        for k in places.of_point(g).tolist():
            i = int(places.photograph[k])
            pose = block.poses[i]
            if pose is None or not places.inside[k]:
                continue
            gain = share_gained(_camera(block, i), pose, position, covariance, places.covariance_px2[k], RAW_SIGMA_PX)
            gains[i] = 0.0 if np.isnan(gain) else gain
        return gains

    def point(self, name: str) -> PointView:
        """Return a point and its photographs, in the order in which they are shown. Raises KeyError where there is no
        such point."""
        moment = self._session.moment()
        record = self._point(moment, name) if name in moment.roles else None
        if record is None:
            raise KeyError(name)
        photographs, radii = self._photographs(moment, name)
        return {
            "version": moment.version,
            "point": record,
            "span_px": span_px(radii, [(p["width_px"], p["height_px"]) for p in photographs]),
            "photographs": photographs,
            "next": self._following(moment, name),
            "problem": "" if moment.outlook is None else moment.outlook.problem,
        }

    def _following(self, moment: Moment, name: str) -> str | None:
        """Return which other point to mark next, the one whose marks would tell most; None where all have enough."""
        names = list(moment.roles)
        after = names[names.index(name) + 1 :] + names[: names.index(name)]
        left = [other for other in after if not self._point(moment, other)["enough"]]
        return max(left, key=lambda other: self._told_nats(moment, other), default=None)

    def _told_nats(self, moment: Moment, name: str) -> float:
        """Return what marks of a point in FEW photographs would tell of these, ½ ln det (I + C / σ²) of each (Shannon),
        those that tell most; minus infinity where nothing says where the point is."""
        outlook = moment.outlook
        places = None if outlook is None else outlook.places
        if outlook is None or places is None or name not in outlook.names:
            return -np.inf
        photographs, marks, hidden = self._session.block.photographs, moment.state.marks, moment.state.not_visible
        told = []
        for k in places.of_point(outlook.names.index(name)).tolist():
            place = name, photographs[int(places.photograph[k])].name
            if places.inside[k] and place not in marks and place not in hidden:
                share = np.eye(2) + places.covariance_px2[k] / RAW_SIGMA_PX**2
                told.append(0.5 * float(np.linalg.slogdet(share)[1]))
        return sum(sorted(told, reverse=True)[:FEW]) if told else -np.inf

    def _photographs(self, moment: Moment, name: str) -> tuple[list[PhotographRecord], list[float]]:
        block, outlook = self._session.block, moment.outlook
        places = None if outlook is None else outlook.places
        at: dict[int, int] = {}
        if places is not None and outlook is not None and name in outlook.names:
            own = places.of_point(outlook.names.index(name))
            at = {int(places.photograph[k]): int(k) for k in own if self._may_show(places, int(k))}
        places_with_one = (*moment.state.marks, *moment.proposals)
        numbers = self._session.numbers
        marked = [numbers[title] for point, title in places_with_one if point == name and title in numbers]
        # where nothing says where the point is all photographs may show it; what is not reckoned yet is waited for
        shown = sorted({*at, *marked}) if at or outlook is None else list(range(len(block.photographs)))
        gains = self._gains_of(outlook, name, moment)
        records, radii, pixel = list[PhotographRecord](), list[float](), list[tuple[float, float]]()
        for i in shown:
            record = self._photograph(moment, name, i, at.get(i), gains.get(i))
            records.append(record)
            if record["ellipse"] is not None and record["mark"] is None and record["inside"]:
                radii.append(record["ellipse"]["long_px"])
            mark, camera = record["mark"] or record["proposal"], _camera(block, i)
            u, v = (mark["u"], mark["v"]) if mark else (record["u"], record["v"])
            middle = (camera.width_px - 1) / 2, (camera.height_px - 1) / 2
            pixel.append(middle if u is None or v is None else (u, v))
        if not shown:
            return [], radii
        order = best_first(
            np.array(pixel, dtype=np.float64),
            np.array([[r["width_px"], r["height_px"]] for r in records], dtype=np.float64),
            self._azimuths(outlook, name, shown),
            np.array([r["inside"] and not r["hidden"] for r in records], dtype=bool),
            np.array([r["mark"] is not None for r in records], dtype=bool),
        )
        return [records[k] for k in order], radii

    def _may_show(self, places: PredictedPlaces, place: int) -> bool:
        """Return whether the ellipse of a place reaches into its photograph."""
        camera = _camera(self._session.block, int(places.photograph[place]))
        reach = np.sqrt(SURE * np.diag(places.covariance_px2[place]))
        size, pixel = np.array([camera.width_px, camera.height_px]), places.pixel[place]
        return bool(np.all((pixel + reach >= -0.5) & (pixel - reach <= size - 0.5)))

    def _azimuths(self, outlook: Outlook | None, name: str, photographs: Sequence[int]) -> FloatArray:
        block, position = self._session.block, np.full(3, np.nan)
        if outlook is not None and name in outlook.names:
            position = outlook.position_world_m[outlook.names.index(name)]
        poses: list[Pose | None] = [block.poses[i] for i in photographs]
        if not np.isfinite(position).all():
            return np.zeros(len(poses))
        return np.array([0.0 if pose is None else azimuth_rad(position, pose) for pose in poses])

    def _photograph(
        self, moment: Moment, name: str, photograph: int, place: int | None, gain: float | None
    ) -> PhotographRecord:
        block, outlook = self._session.block, moment.outlook
        places = None if outlook is None else outlook.places
        camera, title = _camera(block, photograph), block.photographs[photograph].name
        mark = moment.state.marks.get((name, title))
        compared = None if mark is None or outlook is None else self._of_mark(outlook, mark)
        words = "" if compared is None else said_of(compared, max(_counts(moment)[name] - 1, 0))
        beside = None if mark is None or outlook is None else self._beside(outlook, mark)
        if mark is not None and beside is not None and not (compared is not None and compared.rejected):
            words = said_beside(mark, beside)
        return {
            "name": title,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "u": float(places.pixel[place, 0]) if places is not None and place is not None else None,
            "v": float(places.pixel[place, 1]) if places is not None and place is not None else None,
            "ellipse": _ellipse(places.covariance_px2[place]) if places is not None and place is not None else None,
            "north_rad": self._north_rad(outlook, name, photograph),
            "inside": bool(places.inside[place]) if places is not None and place is not None else True,
            "hidden": (name, title) in moment.state.not_visible,
            "gain": gain,
            "proposal": _proposal(moment, (name, title)),
            "mark": None if mark is None else _mark(mark),
            "beside": None if beside is None else {"u": beside.pixel[0], "v": beside.pixel[1]},
            "rejected": compared is not None and compared.rejected,
            "w": None if compared is None else compared.w,
            "off_px": None if compared is None else compared.distance_px,
            "fits": [] if compared is None else list(compared.fits),
            "words": words,
        }

    def _north_rad(self, outlook: Outlook | None, name: str, photograph: int) -> float | None:
        """Return the direction of north at a point in a photograph, None where nothing says it."""
        block = self._session.block
        if outlook is None or name not in outlook.names:
            return None
        position = outlook.position_world_m[outlook.names.index(name)]
        scale = ground_scale(_camera(block, photograph), block.poses[photograph], position)
        return None if scale is None else float(np.arctan2(scale[1, 1], scale[0, 1]))

    def plan(self) -> PlanView:
        """Return the survey in plan: surveyed points, and photographs that have a position."""
        moment, block = self._session.moment(), self._session.block
        given = block.control_points
        points = [_place(n, given.position_world_m[g]) for g, n in enumerate(given.name)]
        for name, point in moment.state.points.items():
            if point.position is not None:
                points.append(
                    _place(name, block.frame.world_from_map(block.frame.map_from_unit(np.array([point.position])))[0])
                )
        seen = [_place(p.name, pose.position_world_m) for p, pose in zip(block.photographs, block.poses, strict=True)
                if pose is not None]  # fmt: skip
        return {"points": [p for p in points if np.isfinite(p["east_m"])], "photographs": seen}


def _place(name: str, position_world_m: FloatArray) -> PlaceRecord:
    return {"name": name, "east_m": float(position_world_m[0]), "north_m": float(position_world_m[1])}


def _counts(moment: Moment) -> dict[str, int]:
    counts: dict[str, int] = {}
    for mark in moment.state.marks.values():
        counts[mark.point] = counts.get(mark.point, 0) + 1
    return counts


def span_px(radii_px: Sequence[float], sizes_px: Sequence[tuple[int, int]]) -> float:
    """Return the side of the patches of a point in pixels of the photographs: the ellipses of places that are still to
    be marked fill ELLIPSE_SHARE of it; without any prediction, whole photographs."""
    largest = float(max((max(size) for size in sizes_px), default=LEAST_SPAN_PX))
    if not radii_px:
        return largest if not sizes_px else min(LEAST_SPAN_PX, largest)
    return float(np.clip(2.0 * np.median(radii_px) / ELLIPSE_SHARE, min(LEAST_SPAN_PX, largest), largest))
