"""What can be done when points are marked in photographs, and the state that follows from doing it in order."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from photogram.errors import ControlPointError
from photogram.files.tables.surveyed_points import (
    IMPORTED,
    REMOVED,
    ROLES,
    Mark,
    MarkKey,
    PointRole,
    Proposal,
    SurveyedPoint,
    check_key,
    check_name,
)

KeyT = TypeVar("KeyT")
ValueT = TypeVar("ValueT")


@dataclass(frozen=True, slots=True)
class PlaceMarks:
    """Marks are made, in place of those of the same point and photograph; one action for a whole file's import."""

    marks: tuple[Mark, ...]


@dataclass(frozen=True, slots=True)
class RemoveMarks:
    """Marks are removed."""

    keys: tuple[MarkKey, ...]

    def __post_init__(self) -> None:
        for key in self.keys:
            check_key(*key)


@dataclass(frozen=True, slots=True)
class SetNotVisible:
    """A point is said not to be visible in a photograph, which removes its mark; or that is taken back."""

    point: str
    photograph: str
    is_visible: bool = False
    """True takes it back."""

    def __post_init__(self) -> None:
        check_key(self.point, self.photograph)


@dataclass(frozen=True, slots=True)
class SetRole:
    """A point gets a role."""

    point: str
    role: PointRole

    def __post_init__(self) -> None:
        check_name("point", self.point)
        if self.role not in ROLES:
            raise ControlPointError(f"point {self.point}: role must be control, check or tie, found {self.role!r}")


@dataclass(frozen=True, slots=True)
class AddPoint:
    """A point is added, or its coordinates are changed."""

    point: SurveyedPoint

    def __post_init__(self) -> None:
        self.point.check()
        if None in self.point.sigma_m and any(self.point.sigma_m):
            raise ControlPointError(f"standard deviations of {self.point.name}: give all three, or none")


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


def touched_keys(actions: Iterable[Action]) -> set[MarkKey]:
    """Return the keys of marks that were ever made or removed, whatever was undone since."""
    keys = set[MarkKey]()
    for action in actions:
        if isinstance(action, PlaceMarks):
            keys |= {mark.key for mark in action.marks}
        elif isinstance(action, ConfirmProposals):
            keys |= {proposal.mark.key for proposal in action.proposals}
        elif isinstance(action, RemoveMarks):
            keys |= set(action.keys)
        elif isinstance(action, SetNotVisible):
            keys.add((action.point, action.photograph))
    return keys


# ---- state ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MarkState:
    """What follows from the actions so far."""

    marks: Mapping[MarkKey, Mark]
    """The marks, by point and photograph."""
    not_visible: frozenset[MarkKey]
    """Where a point was said not to be visible."""
    roles: Mapping[str, PointRole]
    """Roles of points, where one was given."""
    points: Mapping[str, SurveyedPoint]
    """Points that were added."""
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

    _marks: dict[MarkKey, Mark] = field(default_factory=dict)
    _hidden: dict[MarkKey, bool] = field(default_factory=dict)
    _roles: dict[str, PointRole] = field(default_factory=dict)
    _points: dict[str, SurveyedPoint] = field(default_factory=dict)
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
                self._place(mark, changes)
        elif isinstance(action, ConfirmProposals):
            for proposal in action.proposals:
                self._place(proposal.mark, changes)
        elif isinstance(action, RemoveMarks):
            for key in action.keys:
                _put(self._marks, key, None, changes)
        elif isinstance(action, SetNotVisible):
            key = (action.point, action.photograph)
            _put(self._hidden, key, None if action.is_visible else True, changes)
            if not action.is_visible:
                _put(self._marks, key, None, changes)
        elif isinstance(action, SetRole):
            _put(self._roles, action.point, action.role, changes)
        else:
            _put(self._points, action.point.name, action.point, changes)

    def _place(self, mark: Mark, changes: list[_Change]) -> None:
        _put(self._marks, mark.key, mark, changes)
        _put(self._hidden, mark.key, None, changes)


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


def table_of(marks: Mapping[MarkKey, Mark], actions: Iterable[Action]) -> tuple[Mark, ...]:
    """Return the ``marks`` after actions as their table has them: also those of the project that were removed, as such,
    for a file that holds them would bring them back."""
    given = {m.key: m for a in actions if isinstance(a, PlaceMarks) for m in a.marks if m.kind == IMPORTED}
    removed = (replace(mark, kind=REMOVED, is_doubtful=False) for key, mark in given.items() if key not in marks)
    return (*marks.values(), *removed)


def state_of(actions: Iterable[Action]) -> MarkState:
    """Return the state after actions, in their order."""
    replay = Replay()
    for action in actions:
        replay.do(action)
    return replay.state()
