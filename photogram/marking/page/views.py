"""What the page shows, as plain records: the points and how far each is, and the photographs of one in order."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TypedDict

import numpy as np

from photogram.amendments.gross_errors.blunder_naming import Blunder
from photogram.arrays import FloatArray
from photogram.camera import Camera, Pose
from photogram.files.tables.surveyed_points import Mark, MarkKey
from photogram.languages.said import Figures, Said
from photogram.marking.mark_comparison import ComparedMark
from photogram.marking.page.assessment import RAW_SIGMA_PX, Assessment, isotropic_px
from photogram.marking.page.ordering import azimuth_rad, best_first, in_short, in_words, is_enough, share_gained
from photogram.marking.page.session import ADJUSTED, MarkingSession, Snapshot, agreeing
from photogram.marking.page.snapping import Snapped, ground_scale
from photogram.marking.predictions import SURE, PredictedPlaces
from photogram.marking.targets.kinds import Kind, title_of
from photogram.survey import Block

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

_CLICKED = "raw", "imported"
"""Kinds of marks that are on no target."""

_NUMBERS: Mapping[int, str] = {
    2: Said("two"),
    3: Said("three"),
    4: Said("four"),
    5: Said("five"),
    6: Said("six"),
    7: Said("seven"),
    8: Said("eight"),
    9: Said("nine"),
    10: Said("ten"),
}


class EllipseRecord(TypedDict):
    """Where a place lies in 95 of 100: half its axes in px, and the direction of the longer one from u towards v."""

    long_px: float
    short_px: float
    angle_rad: float


class PixelRecord(TypedDict):
    """A place in a photograph, as the target that a click taken as it is has missed."""

    u: float
    v: float


class MeasuredRecord(PixelRecord):
    """A place that was measured, and how."""

    sigma_px: float | None
    kind: str


class MarkRecord(MeasuredRecord):
    """A mark."""

    doubtful: bool


class ProposalRecord(MeasuredRecord):
    """A target that may be the point."""

    agrees: bool


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
    off_target: PixelRecord | None
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
    short: str
    """The same for the list."""


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
    computing: bool
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


def _measured(mark: Mark) -> MeasuredRecord:
    u, v = mark.pixel
    return {
        "u": u,
        "v": v,
        "sigma_px": None if mark.sigma_px is None else isotropic_px(mark),
        "kind": mark.kind if mark.kind in _CLICKED else Said(title_of(mark.kind)),
    }


def _proposal(snapshot: Snapshot, key: MarkKey) -> ProposalRecord | None:
    proposal = snapshot.proposals.get(key)
    return None if proposal is None else {**_measured(proposal.mark), "agrees": key in agreeing(snapshot)}


def accused(blunder: Blunder) -> tuple[str, ...]:
    """Return the points that a blunder is of: whose target a mark is on is innocent."""
    return blunder.points if blunder.kind == "exchanged points" else blunder.points[:1]


def off_target_words(mark: Mark, target: Snapped) -> str:
    """Return what is said of a click that was taken as it is and missed a target."""
    distance = Figures(f"{float(np.hypot(*np.subtract(mark.pixel, target.pixel))):.1f}")
    if target.kind == Kind.MATCHED.value:
        return Said("{distance} px off what the other marks show", distance=distance)
    return Said("{distance} px off the centre of a {kind}", distance=distance, kind=Said(title_of(target.kind)))


def said_of(compared: ComparedMark, others: int, is_calibrated: bool = True) -> str:
    """Return what is said of a mark compared with the others of its point, of which there are so many: beside its
    distance the one to be expected (RMS), which before calibration has the uncertainty of the cameras in it."""
    many, distance = _NUMBERS.get(others, str(others)), Figures(f"{compared.distance_px:.1f}")
    figure = Figures(f"{compared.expected_px:.1f}")
    expected = (
        Said("{figure} px expected", figure=figure)
        if is_calibrated
        else Said("{figure} px expected before calibration", figure=figure)
    )
    if not compared.rejected:
        if others < 2:
            return ""
        return Said("{distance} px from the {many} others, {expected}", distance=distance, many=many, expected=expected)
    if others < 1:
        text = Said("{distance} px from where the other marks put it, {expected}", distance=distance, expected=expected)
    elif others == 1:
        text = Said("{distance} px from where the other puts it, {expected}", distance=distance, expected=expected)
    else:
        text = Said(
            "{distance} px from where the {many} others put it, {expected}",
            distance=distance,
            many=many,
            expected=expected,
        )
    match compared.fits[:2]:
        case [first, second]:
            return Said("{text}; it would fit {first} or {second}", text=text, first=first, second=second)
        case [first]:
            return Said("{text}; it would fit {point}", text=text, point=first)
    return text


class Views:
    """Makes the records of a session."""

    def __init__(self, session: MarkingSession) -> None:
        self._session = session
        self._gains: tuple[Assessment | None, dict[str, dict[int, float]]] = (None, {})

    def state(self) -> StateView:
        """Return the whole session."""
        snapshot = self._session.snapshot()
        assessment = snapshot.assessment
        comparison = None if assessment is None else assessment.comparison
        points = [self._point(snapshot, name) for name in snapshot.roles]
        return {
            "version": snapshot.version,
            "points": points,
            "first": next((p["name"] for p in points if not p["enough"]), points[0]["name"] if points else None),
            "photographs": len(self._session.block.photographs),
            "proposals": len(snapshot.proposals),
            "agreeing": len(agreeing(snapshot)),
            "searching": snapshot.search.is_running,
            "search": snapshot.search.words,
            "undoable": snapshot.undoable,
            "redoable": snapshot.state.redoable,
            "computing": snapshot.is_computing,
            "basis": snapshot.basis,
            "problem": "" if assessment is None else assessment.problem,
            "blunders": [] if comparison is None else [b.sentence for b in comparison.blunders],
            "warnings": self._warnings(snapshot),
        }

    def _warnings(self, snapshot: Snapshot) -> list[str]:
        """Return what is weak about the control that is marked in two photographs or more."""
        counts = _counts(snapshot)
        assessment = snapshot.assessment
        control = [n for n, role in snapshot.roles.items() if role == "control" and counts[n] >= 2]
        if assessment is None or not control:
            return []
        if len(control) < 3:
            return [
                Said.plural(
                    "{n} control point marked in two photographs or more: three are needed",
                    "{n} control points marked in two photographs or more: three are needed",
                    len(control),
                )
            ]
        at = np.array([assessment.position_of(name) for name in control])
        at = at[np.isfinite(at).all(axis=1)]
        if len(at) < 3:
            return []
        spread = np.linalg.svd(at[:, :2] - at[:, :2].mean(axis=0), compute_uv=False)
        if spread[1] < IN_LINE * spread[0]:
            return [Said("the control points marked so far lie nearly in one line: mark one off it")]
        flown = [pose.position_world_m[2] for pose in self._session.block.poses if pose is not None]
        above = float(np.median(flown) - np.median(at[:, 2])) if flown else 0.0
        if np.ptp(at[:, 2]) < AT_ONE_HEIGHT * above:
            return [
                Said(
                    "the control points marked so far lie nearly at one height: a focal length that is wrong shows "
                    "only at others, so mark one that lies higher or lower"
                )
            ]
        return []

    def _point(self, snapshot: Snapshot, name: str) -> PointRecord:
        role = snapshot.roles[name]
        assessment, marks = snapshot.assessment, _counts(snapshot)[name]
        own = [m for m in snapshot.state.marks.values() if m.point == name]
        wrong = assessment is not None and (
            any(self._of_mark(assessment, m) is not None and assessment.compared[m.key].rejected for m in own)
            or any(self._off_target(assessment, m) is not None for m in own)
            or (assessment.comparison is not None and any(name in accused(b) for b in assessment.comparison.blunders))
        )
        gains = list(self._gains_of(assessment, name, snapshot).values())
        enough = assessment is not None and not wrong and is_enough(marks, gains)
        sigma_m = None if assessment is None else assessment.sigma_m(name)
        words, short = in_words(marks, sigma_m), in_short(marks, sigma_m)
        return {
            "name": name,
            "role": role,
            "surveyed": role != "tie",
            "marks": marks,
            "proposals": sum(point == name for point, _ in snapshot.proposals),
            "wrong": wrong,
            "doubtful": sum(m.is_doubtful for m in own),
            "enough": enough,
            "words": Said("{words}: more gain little", words=words) if enough else words,
            "short": Said("{words}: more gain little", words=short) if enough else short,
        }

    def _of_mark(self, assessment: Assessment, mark: Mark) -> ComparedMark | None:
        """Return the comparison of a mark, None where it is another one now."""
        return assessment.compared.get(mark.key) if assessment.marks.get(mark.key) == mark else None

    def _off_target(self, assessment: Assessment, mark: Mark) -> Snapped | None:
        """Return the target that a mark has missed, None where it is another one now."""
        return assessment.off_target.get(mark.key) if assessment.marks.get(mark.key) == mark else None

    def _gains_of(self, assessment: Assessment | None, name: str, snapshot: Snapshot) -> dict[int, float]:
        """Return by photograph what one more mark of a point would gain, where it is not marked and may be seen."""
        if assessment is None or assessment.places is None or assessment.sigma_m(name) is None:
            return {}
        if self._gains[0] is not assessment:
            self._gains = (assessment, {})
        known = self._gains[1]
        if name not in known:
            known[name] = self._computed_gains(assessment, name)
        state, photographs = snapshot.state, self._session.block.photographs
        return {
            i: gain
            for i, gain in known[name].items()
            if (name, photographs[i].name) not in state.marks and (name, photographs[i].name) not in state.not_visible
        }

    def _computed_gains(self, assessment: Assessment, name: str) -> dict[int, float]:
        places = assessment.places
        sigma_m = assessment.sigma_m(name)
        block = self._session.block
        position = assessment.position_of(name)
        if places is None or sigma_m is None or not np.isfinite(position).all():
            return {}
        axes = block.frame.rotation_world_from_map(np.zeros(3))
        covariance = axes @ np.diag(sigma_m**2) @ axes.T
        gains = {}
        for k in places.of_point(assessment.names.index(name)).tolist():
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
        snapshot = self._session.snapshot()
        record = self._point(snapshot, name)
        photographs, radii = self._photographs(snapshot, name)
        return {
            "version": snapshot.version,
            "point": record,
            "span_px": span_px(radii, [(p["width_px"], p["height_px"]) for p in photographs]),
            "photographs": photographs,
            "next": self._following(snapshot, name),
            "problem": "" if snapshot.assessment is None else snapshot.assessment.problem,
        }

    def _following(self, snapshot: Snapshot, name: str) -> str | None:
        """Return which other point to mark next, the one whose marks would gain most; None where all have enough."""
        names = list(snapshot.roles)
        after = names[names.index(name) + 1 :] + names[: names.index(name)]
        left = [other for other in after if not self._point(snapshot, other)["enough"]]
        return max(left, key=lambda other: self._information_nats(snapshot, other), default=None)

    def _information_nats(self, snapshot: Snapshot, name: str) -> float:
        """Return what marks of a point in FEW photographs would add to these, ½ ln det (I + C / σ²) of each (Shannon),
        those that add most; minus infinity where nothing says where the point is."""
        assessment = snapshot.assessment
        places = None if assessment is None else assessment.places
        if assessment is None or places is None or name not in assessment.names:
            return -np.inf
        photographs = self._session.block.photographs
        marks = snapshot.state.marks
        hidden = snapshot.state.not_visible
        gains = []
        for k in places.of_point(assessment.names.index(name)).tolist():
            place = name, photographs[int(places.photograph[k])].name
            if places.inside[k] and place not in marks and place not in hidden:
                share = np.eye(2) + places.covariance_px2[k] / RAW_SIGMA_PX**2
                gains.append(0.5 * float(np.linalg.slogdet(share)[1]))
        return sum(sorted(gains, reverse=True)[:FEW]) if gains else -np.inf

    def _photographs(self, snapshot: Snapshot, name: str) -> tuple[list[PhotographRecord], list[float]]:
        block, assessment = self._session.block, snapshot.assessment
        places = None if assessment is None else assessment.places
        at: dict[int, int] = {}
        if places is not None and assessment is not None and name in assessment.names:
            own = places.of_point(assessment.names.index(name))
            at = {int(places.photograph[k]): int(k) for k in own if self._may_show(places, int(k))}
        places_with_one = (*snapshot.state.marks, *snapshot.proposals)
        numbers = self._session.numbers
        marked = [numbers[title] for point, title in places_with_one if point == name and title in numbers]
        # where nothing says where the point is all photographs may show it; what is not computed yet is waited for
        listed = sorted({*at, *marked}) if at or assessment is None else list(range(len(block.photographs)))
        gains = self._gains_of(assessment, name, snapshot)
        records = list[PhotographRecord]()
        radii = list[float]()
        pixel = list[tuple[float, float]]()
        for i in listed:
            record = self._photograph(snapshot, name, i, at.get(i), gains.get(i))
            records.append(record)
            if record["ellipse"] is not None and record["mark"] is None and record["inside"]:
                radii.append(record["ellipse"]["long_px"])
            mark, camera = record["mark"] or record["proposal"], _camera(block, i)
            u, v = (mark["u"], mark["v"]) if mark else (record["u"], record["v"])
            middle = (camera.width_px - 1) / 2, (camera.height_px - 1) / 2
            pixel.append(middle if u is None or v is None else (u, v))
        if not listed:
            return [], radii
        order = best_first(
            np.array(pixel, dtype=np.float64),
            np.array([[r["width_px"], r["height_px"]] for r in records], dtype=np.float64),
            self._azimuths(assessment, name, listed),
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

    def _azimuths(self, assessment: Assessment | None, name: str, photographs: Sequence[int]) -> FloatArray:
        poses: list[Pose | None] = [self._session.block.poses[i] for i in photographs]
        position = None if assessment is None else assessment.position_of(name)
        if position is None or not np.isfinite(position).all():
            return np.zeros(len(poses))
        return np.array([0.0 if pose is None else azimuth_rad(position, pose) for pose in poses])

    def _photograph(
        self, snapshot: Snapshot, name: str, photograph: int, place: int | None, gain: float | None
    ) -> PhotographRecord:
        block, assessment = self._session.block, snapshot.assessment
        places = None if assessment is None else assessment.places
        camera, title = _camera(block, photograph), block.photographs[photograph].name
        mark = snapshot.state.marks.get((name, title))
        compared = None if mark is None or assessment is None else self._of_mark(assessment, mark)
        words = (
            ""
            if compared is None
            else said_of(compared, max(_counts(snapshot)[name] - 1, 0), snapshot.basis == ADJUSTED)
        )
        off_target = None if mark is None or assessment is None else self._off_target(assessment, mark)
        if mark is not None and off_target is not None and not (compared is not None and compared.rejected):
            words = off_target_words(mark, off_target)
        return {
            "name": title,
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "u": float(places.pixel[place, 0]) if places is not None and place is not None else None,
            "v": float(places.pixel[place, 1]) if places is not None and place is not None else None,
            "ellipse": _ellipse(places.covariance_px2[place]) if places is not None and place is not None else None,
            "north_rad": self._north_rad(assessment, name, photograph),
            "inside": bool(places.inside[place]) if places is not None and place is not None else True,
            "hidden": (name, title) in snapshot.state.not_visible,
            "gain": gain,
            "proposal": _proposal(snapshot, (name, title)),
            "mark": None if mark is None else {**_measured(mark), "doubtful": mark.is_doubtful},
            "off_target": None if off_target is None else {"u": off_target.pixel[0], "v": off_target.pixel[1]},
            "rejected": compared is not None and compared.rejected,
            "w": None if compared is None else compared.w,
            "off_px": None if compared is None else compared.distance_px,
            "fits": [] if compared is None else list(compared.fits),
            "words": words,
        }

    def _north_rad(self, assessment: Assessment | None, name: str, photograph: int) -> float | None:
        """Return the direction of north at a point in a photograph, None where nothing says it."""
        block = self._session.block
        if assessment is None:
            return None
        position = assessment.position_of(name)
        scale = ground_scale(_camera(block, photograph), block.poses[photograph], position)
        return None if scale is None else float(np.arctan2(scale[1, 1], scale[0, 1]))

    def plan(self) -> PlanView:
        """Return the survey in plan: surveyed points, and photographs that have a position."""
        snapshot, block = self._session.snapshot(), self._session.block
        given = block.control_points
        points = [_place(n, given.position_world_m[g]) for g, n in enumerate(given.name)]
        for name, point in snapshot.state.points.items():
            if point.position is not None:
                points.append(
                    _place(name, block.frame.world_from_map(block.frame.map_from_unit(np.array([point.position])))[0])
                )
        seen = [
            _place(p.name, pose.position_world_m)
            for p, pose in zip(block.photographs, block.poses, strict=True)
            if pose is not None
        ]
        return {"points": [p for p in points if np.isfinite(p["east_m"])], "photographs": seen}


def _place(name: str, position_world_m: FloatArray) -> PlaceRecord:
    return {"name": name, "east_m": float(position_world_m[0]), "north_m": float(position_world_m[1])}


def _counts(snapshot: Snapshot) -> Counter[str]:
    return Counter(mark.point for mark in snapshot.state.marks.values())


def span_px(radii_px: Sequence[float], sizes_px: Sequence[tuple[int, int]]) -> float:
    """Return the side of the patches of a point in pixels of the photographs: the ellipses of places that are still to
    be marked fill ELLIPSE_SHARE of it; without any prediction, whole photographs."""
    largest = float(max((max(size) for size in sizes_px), default=LEAST_SPAN_PX))
    if not radii_px:
        return largest if not sizes_px else min(LEAST_SPAN_PX, largest)
    return float(np.clip(2.0 * np.median(radii_px) / ELLIPSE_SHARE, min(LEAST_SPAN_PX, largest), largest))
