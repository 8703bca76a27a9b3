"""What can be done when points are marked in photographs, and the state that follows from doing it in order.

Pixels are photogram's: u right, v down, the centre of the top-left pixel is (0, 0), of the photograph's own size.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeVar, get_args

from photogram.errors import ControlPointError
from photogram.files.text_lines import LONGEST_NAME, MARK_KIND, SIGMA_M, SIGMA_PX
from photogram.wording import printable, shortened

PointRole = Literal["control", "check", "tie"]
ROLES: tuple[PointRole, ...] = get_args(PointRole)
Place = tuple[str, str]
"""A point and a photograph, by their names."""

_TIME = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?Z")
_LOW, _HIGH = -1e9, 1e9
KeyT = TypeVar("KeyT")
ValueT = TypeVar("ValueT")


@lru_cache(maxsize=65536)
def _is_name(name: str) -> bool:
    return bool(name) and name == name.strip() and name.isprintable() and len(name) <= LONGEST_NAME


def _check_name(what: str, name: str) -> None:
    if not _is_name(name):
        raise ControlPointError(
            f"{what} {shortened(printable(name))!r}: must be 1 to {LONGEST_NAME} printable characters without blanks "
            "around them: choose another name"
        )


@lru_cache(maxsize=1024)
def _is_kind(kind: str) -> bool:
    return MARK_KIND.fullmatch(kind) is not None


def _check_place(point: str, photograph: str) -> None:
    _check_name("point", point)
    _check_name("photograph", photograph)


def _check_numbers(what: str, values: Iterable[float], low: float, high: float) -> None:
    for value in values:
        if not low <= value <= high:  # nor is NaN
            raise ControlPointError(f"{what} must be from {low:g} to {high:g}, found {value!r}: correct it")


@dataclass(frozen=True, slots=True)
class Mark:
    """A point measured in a photograph. Raises ControlPointError where a field is out of its range."""

    point: str
    """Name of the point."""
    photograph: str
    """Name of the photograph, as the project has it."""
    pixel: tuple[float, float]
    """u, v of the point."""
    sigma_px: tuple[float, float] | None = None
    """Standard deviations of u and v, None where nothing says them."""
    rho: float = 0.0
    """Correlation of u and v."""
    kind: str = "raw"
    """How it was measured, a word: raw for a click as it is, else quartered, circle, matched, coded, imported …"""
    time: str = ""
    """When, UTC as 2026-05-01T10:20:30Z; empty where it is not known."""
    raw_pixel: tuple[float, float] | None = None
    """u, v of the click that the measurement began with, None where there was none."""
    is_doubtful: bool = False
    """Whether somebody should look at it again."""

    def __post_init__(self) -> None:
        _check_place(self.point, self.photograph)
        try:
            if not (_LOW < self.pixel[0] < _HIGH and _LOW < self.pixel[1] < _HIGH):
                raise ControlPointError(
                    f"u and v must be from {_LOW:g} to {_HIGH:g}, found {self.pixel!r}: correct them"
                )
            if self.raw_pixel is not None and not all(_LOW < value < _HIGH for value in self.raw_pixel):
                found = self.raw_pixel
                raise ControlPointError(
                    f"raw_u and raw_v must be from {_LOW:g} to {_HIGH:g}, found {found!r}: correct them"
                )
            if self.sigma_px is not None:
                _check_numbers("standard deviations (px)", self.sigma_px, *SIGMA_PX)
            if not -1.0 < self.rho < 1.0:
                raise ControlPointError(f"rho must lie between -1 and 1, found {self.rho!r}: correct it")
            if not _is_kind(self.kind):
                raise ControlPointError(
                    f"kind must be a word in lower case, found {shortened(self.kind)!r}: correct it"
                )
            if self.time and not _TIME.fullmatch(self.time):
                raise ControlPointError(
                    f"time must be UTC as 2026-05-01T10:20:30Z, found {shortened(self.time)!r}: correct it"
                )
        except ControlPointError as fault:
            raise ControlPointError(f"mark of {self.point} in {self.photograph}: {fault}") from None

    @property
    def place(self) -> Place:
        """The point and the photograph."""
        return self.point, self.photograph


@dataclass(frozen=True, slots=True)
class Proposal:
    """A mark that somebody has to confirm."""

    mark: Mark
    """Where the point is expected, or was found by itself."""
    score: float
    """How well it was found: larger is better, 0 for a mere prediction."""

    def __post_init__(self) -> None:
        _check_numbers(f"proposal of {self.mark.point} in {self.mark.photograph}: score", (self.score,), -1e9, 1e9)


@dataclass(frozen=True, slots=True)
class NewPoint:
    """A point that was added while marking."""

    name: str
    """Name."""
    position: tuple[float, float, float] | None = None
    """Easting or longitude, northing or latitude, and height, in ``crs``; None for a point without coordinates."""
    sigma_m: tuple[float, float, float] | None = None
    """Standard deviations along easting, northing and height."""
    crs: str | None = None
    """CRS of the position, None for the project's."""

    def __post_init__(self) -> None:
        _check_name("point", self.name)
        if self.position is not None:
            _check_numbers(f"position of {self.name}", self.position, -1e12, 1e12)
        if self.crs is not None and not self.crs.isprintable():
            raise ControlPointError(f"CRS of {self.name} {shortened(printable(self.crs))!r}: must be printable")
        if self.sigma_m is not None:
            _check_numbers(f"standard deviations of {self.name} (m)", self.sigma_m, *SIGMA_M)


# ---- actions -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PlaceMarks:
    """Marks are made, in place of those of the same point and photograph; one action for a whole file's import."""

    marks: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class RemoveMarks:
    """Marks are removed."""

    places: tuple[Place, ...]

    def __post_init__(self) -> None:
        for place in self.places:
            _check_place(*place)


@dataclass(frozen=True, slots=True)
class SetNotVisible:
    """A point is said not to be visible in a photograph, which removes its mark; or that is taken back."""

    point: str
    photograph: str
    is_visible: bool = False
    """True takes it back."""

    def __post_init__(self) -> None:
        _check_place(self.point, self.photograph)


@dataclass(frozen=True, slots=True)
class SetRole:
    """A point gets a role."""

    point: str
    role: PointRole

    def __post_init__(self) -> None:
        _check_name("point", self.point)
        if self.role not in ROLES:
            raise ControlPointError(f"point {self.point}: role must be control, check or tie, found {self.role!r}")


@dataclass(frozen=True, slots=True)
class AddPoint:
    """A point is added, or its coordinates are changed."""

    point: NewPoint


@dataclass(frozen=True, slots=True)
class ConfirmProposals:
    """Proposals become marks."""

    proposals: tuple[Proposal, ...]


@dataclass(frozen=True, slots=True)
class Undo:
    """The last action that changed something, and was not undone yet, is undone; without one nothing happens."""


@dataclass(frozen=True, slots=True)
class Redo:
    """The action undone last is done again, unless something else was done since."""


Action = PlaceMarks | RemoveMarks | SetNotVisible | SetRole | AddPoint | ConfirmProposals | Undo | Redo


def touched_places(actions: Iterable[Action]) -> set[Place]:
    """Return the places where a mark was ever made or taken away, whatever was undone since."""
    places = set[Place]()
    for action in actions:
        if isinstance(action, PlaceMarks):
            places |= {mark.place for mark in action.marks}
        elif isinstance(action, ConfirmProposals):
            places |= {proposal.mark.place for proposal in action.proposals}
        elif isinstance(action, RemoveMarks):
            places |= set(action.places)
        elif isinstance(action, SetNotVisible):
            places.add((action.point, action.photograph))
    return places


# ---- state ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MarkState:
    """What follows from the actions so far."""

    marks: Mapping[Place, Mark]
    """The marks, by point and photograph."""
    not_visible: frozenset[Place]
    """Where a point was said not to be visible."""
    roles: Mapping[str, PointRole]
    """Roles of points, where one was given."""
    points: Mapping[str, NewPoint]
    """Points that were added."""
    confirmed: Mapping[Place, float]
    """The score of those marks that were proposals."""
    undoable: int = 0
    """How many actions can be undone."""
    redoable: int = 0
    """How many can be done again."""


class _Change(NamedTuple):
    """An entry of a table, ``None`` for its absence, before and after."""

    table: dict[object, object]
    key: object
    before: object
    after: object


@dataclass
class Replay:
    """The state while actions are done one after the other, with what is needed to undo each."""

    _marks: dict[Place, Mark] = field(default_factory=dict)
    _hidden: dict[Place, bool] = field(default_factory=dict)
    _roles: dict[str, PointRole] = field(default_factory=dict)
    _points: dict[str, NewPoint] = field(default_factory=dict)
    _confirmed: dict[Place, float] = field(default_factory=dict)
    _done: list[list[_Change]] = field(default_factory=list)
    _undone: list[list[_Change]] = field(default_factory=list)

    def do(self, action: Action) -> None:
        """Do an action."""
        if isinstance(action, Undo):
            if self._done:
                self._undone.append(self._done.pop())
                for change in reversed(self._undone[-1]):
                    _enter(change.table, change.key, change.before)
        elif isinstance(action, Redo):
            if self._undone:
                self._done.append(self._undone.pop())
                for change in self._done[-1]:
                    _enter(change.table, change.key, change.after)
        else:
            changes: list[_Change] = []
            self._change(action, changes)
            changes = _summed(changes) if len(changes) > 1 else changes
            if changes:  # what changes nothing is no step to undo
                self._done.append(changes)
                self._undone.clear()

    def state(self) -> MarkState:
        """Return the state as it is now."""
        return MarkState(
            MappingProxyType(dict(self._marks)),
            frozenset(self._hidden),
            MappingProxyType(dict(self._roles)),
            MappingProxyType(dict(self._points)),
            MappingProxyType(dict(self._confirmed)),
            len(self._done),
            len(self._undone),
        )

    def _change(
        self,
        action: PlaceMarks | RemoveMarks | SetNotVisible | SetRole | AddPoint | ConfirmProposals,
        changes: list[_Change],
    ) -> None:
        if isinstance(action, PlaceMarks):
            for mark in action.marks:
                self._place(mark, None, changes)
        elif isinstance(action, ConfirmProposals):
            for proposal in action.proposals:
                self._place(proposal.mark, proposal.score, changes)
        elif isinstance(action, RemoveMarks):
            for place in action.places:
                _put(self._marks, place, None, changes)
                _put(self._confirmed, place, None, changes)
        elif isinstance(action, SetNotVisible):
            place = (action.point, action.photograph)
            _put(self._hidden, place, None if action.is_visible else True, changes)
            if not action.is_visible:
                _put(self._marks, place, None, changes)
                _put(self._confirmed, place, None, changes)
        elif isinstance(action, SetRole):
            _put(self._roles, action.point, action.role, changes)
        else:
            _put(self._points, action.point.name, action.point, changes)

    def _place(self, mark: Mark, score: float | None, changes: list[_Change]) -> None:
        _put(self._marks, mark.place, mark, changes)
        _put(self._confirmed, mark.place, score, changes)
        _put(self._hidden, mark.place, None, changes)


def _summed(changes: Iterable[_Change]) -> list[_Change]:
    """Return one change of each entry, and none of those that come back to what they were."""
    first: dict[tuple[int, object], _Change] = {}
    for change in changes:
        entry = (id(change.table), change.key)
        before = first.get(entry, change).before
        first[entry] = _Change(change.table, change.key, before, change.after)
    return [change for change in first.values() if change.before != change.after]


def _put(table: dict[KeyT, ValueT], key: KeyT, value: ValueT | None, changes: list[_Change]) -> None:
    before = table.get(key)
    if before is not value and before != value:
        changes.append(_Change(table, key, before, value))  # type: ignore[arg-type]  # entries go back as they came
        _enter(table, key, value)


def _enter(table: dict[KeyT, ValueT], key: KeyT, value: ValueT | None) -> None:
    if value is None:
        table.pop(key, None)
    else:
        table[key] = value


def state_of(actions: Iterable[Action]) -> MarkState:
    """Return the state after actions, in their order."""
    replay = Replay()
    for action in actions:
        replay.do(action)
    return replay.state()
