"""One session of marking: the marks and how they came, kept at once, and what they say, computed in the background.

Every change is on the disk, in the journal and then in the table of marks, before it is answered. What follows from it,
the predicted places and the tests of the marks, is computed by one thread from the newest state; nobody waits for it.
"""

import re
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from photogram.errors import ControlPointError, ImageError, PhotogramError, WorkspaceError
from photogram.files.atomic import remove_leftovers
from photogram.files.marks.mark_table import read_proposals, write_marks, write_proposals
from photogram.files.tables.surveyed_points import (
    FORMER_KINDS,
    IMPORTED,
    RAW,
    Mark,
    MarkKey,
    PointRole,
    Proposal,
    SurveyedPoint,
)
from photogram.languages.said import Said
from photogram.marking.files.actions import (
    Action,
    AddPoint,
    ConfirmProposals,
    MarkState,
    PlaceMarks,
    Redo,
    RemoveMarks,
    Replay,
    SetNotVisible,
    SetRole,
    Undo,
    state_of,
    table_of,
    touched_keys,
)
from photogram.marking.files.journal import Journal, utc_now
from photogram.marking.page.assessment import (
    RAW_SIGMA_PX,
    Assessment,
    agreeing_proposals,
    assessed,
    is_off_target,
    isotropic_px,
    marked_block,
)
from photogram.marking.page.proposing import SearchResult, SearchState, TargetSearch
from photogram.marking.page.snapping import Click, OtherMark, Snap, Snapped
from photogram.measures.mark_covariances import stated_pairs
from photogram.survey import Block, Role
from photogram.wording import Progress

ADJUSTED = "adjustment"
"""What predictions come from where the survey has been adjusted."""

PROPOSALS = "proposals.csv"
"""File of the proposals, in the folder of the journal."""

Propose = Callable[[Block, frozenset[MarkKey], Progress], SearchResult]
"""Proposes marks of the points of a block where they have none, but not at the places that cannot be seen."""

KeepRoles = Callable[[Mapping[str, Role]], None]
"""Keeps roles of points of the project, by their names."""

SAME_PX = 1e-3
"""How far apart the same mark of the project may be when it is read again."""

OFF_TARGET_PX = 12.0
"""How far from such a click a target is looked for."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The session at one moment: all of one version."""

    version: int
    state: MarkState
    roles: Mapping[str, PointRole]
    """The role of every point, in the order of the points."""
    assessment: Assessment | None
    """What was computed last, perhaps of an earlier state; None before the first."""
    is_computing: bool
    """Whether it is being computed anew."""
    basis: str
    """What the predictions come from, in a word: tags or adjustment."""
    undoable: int
    """Steps that can be undone: not back behind what the project gave."""
    proposals: Mapping[MarkKey, Proposal]
    """Proposals that nobody has confirmed, where there is no mark and the point may be seen."""
    search: SearchState
    """Whether targets are being looked for, and what is said of it."""


def _given_marks(block: Block) -> list[Mark]:
    points, now = block.control_points, utc_now()
    names = block.photograph_names
    columns = (points.mark_point, points.mark_photograph, points.mark_pixel)
    stated = stated_pairs(points.mark_covariance_px2)
    return [
        Mark(points.name[g], names[i], (u, v), sigma_px, rho, IMPORTED, now)
        for g, i, (u, v), (sigma_px, rho) in zip(*(column.tolist() for column in columns), stated, strict=True)
    ]


def _is_corrected(given: Mark, mark: Mark | None) -> bool:
    """Return whether a mark that was taken over and not changed here is another one in the project now."""
    if mark is None or mark.kind != IMPORTED or mark.is_doubtful:
        return False
    return float(np.hypot(*np.subtract(given.pixel, mark.pixel))) > SAME_PX


def _steps_until_import(actions: tuple[Action, ...]) -> int:
    """Return how many steps could be undone after the last import."""
    replay = Replay()
    steps = 0
    for action in actions:
        replay.do(action)
        marks = action.marks if isinstance(action, PlaceMarks) else ()
        if marks and all(mark.kind == IMPORTED and not mark.is_doubtful for mark in marks):
            steps = replay.state().undoable
    return steps


def _set_aside(table: Path, scratch: Path, actions: tuple[Action, ...]) -> Path | None:
    """Keep a table that is not what the actions have made, somebody's own or one that was edited, under another name;
    returns that, None where there is nothing to keep. The last action may have been cut off before its table."""
    if not table.exists():
        return None
    present, own = table.read_bytes(), scratch / f"{table.stem}.own{table.suffix}"
    for former, now in FORMER_KINDS.items():
        present = present.replace(f",{former},".encode(), f",{now},".encode())
    for made in (actions, actions[:-1]):
        write_marks(own, table_of(state_of(made).marks, made))
        is_own = own.read_bytes() == present
        own.unlink()
        if is_own:
            return None
    kept = table.with_name(f"{table.stem}.{re.sub('[^0-9]', '', utc_now())}{table.suffix}")
    if kept.exists():
        raise WorkspaceError(f"{kept}: is there already: wait a second, and begin again")
    table.rename(kept)
    return kept


class MarkingSession:
    """The marks of a survey while they are made; threads may use it at the same time.

    Opening takes over the marks of ``block`` that the journal has not seen, or has seen before they were corrected in
    the project. A table that is not the journal's own is kept under another name, ``set_aside``. Without a table,
    ``marks`` None, the session only looks: it may propose, and neither table nor journal changes. ``better`` is asked
    once, in the background, for a block that knows more, an adjusted one, and says why there is none. ``keep_roles``
    writes the roles of the project's points into the project, which is right where an earlier session says otherwise.
    Raises WorkspaceError where the journal or the table cannot be written or another process has the journal open.
    """

    def __init__(
        self,
        block: Block,
        journal: Path,
        marks: Path | None,
        snap: Snap | None = None,
        better: Callable[[], Block | None] | None = None,
        propose: Propose | None = None,
        keep_roles: KeepRoles | None = None,
    ) -> None:
        self.block = block
        self._keep_roles = keep_roles
        self._table = marks
        self._snap = snap
        self._better = better
        self._propose = propose
        self.numbers = {photograph.name: i for i, photograph in enumerate(block.photographs)}
        self._journal = Journal(journal)
        seen = self._journal.earlier
        touched = touched_keys(seen)
        self._actions = list(seen)
        self._floor = _steps_until_import(seen)
        for place in (journal, marks):  # of sessions that were killed: no other one has the journal
            if place is not None:
                remove_leftovers(place.parent)
        before = self._journal.state.marks
        new = tuple(m for m in _given_marks(block) if m.key not in touched or _is_corrected(m, before.get(m.key)))
        if new and marks is not None:
            self._journal.append(PlaceMarks(new))
            self._actions.append(PlaceMarks(new))
            self._floor = self._journal.state.undoable
        self.proposed_in = journal.with_name(PROPOSALS)
        proposals = read_proposals(self.proposed_in) if self.proposed_in.exists() else ()
        self._proposals = {proposal.mark.key: proposal for proposal in proposals}
        self._changed = threading.Condition()
        self._search = TargetSearch(self._notify)
        self._version = 1
        self._is_stale, self._is_computing = True, False
        self._assessment: Assessment | None = None
        self._basis, self._known = "tags", block
        self._meant: dict[Mark, Snapped | None] = {}
        self._ended = False
        self._acting = threading.Lock()
        self._state = self._journal.state if marks is not None else state_of((*seen, PlaceMarks(new)))
        self._overruled = {} if keep_roles is None else dict(self._state.roles)
        self.set_aside = None if marks is None else _set_aside(marks, journal.parent, seen)
        self._write()
        self._assessor = threading.Thread(target=self._assess_always, name="marks", daemon=True)

    def start(self) -> None:
        """Begin to compute."""
        self._assessor.start()

    def ask_for_better(self) -> None:
        """Ask for the block that knows more now, where nobody has yet."""
        better, self._better = self._better, None
        if better is None:
            return
        try:
            block = better()
        except PhotogramError as error:
            self._note_basis(f"tags ({error})", self._known)
            return
        if block is not None:
            self._note_basis(ADJUSTED, block)

    def close(self) -> None:
        """End the session; what was done is on the disk already."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        if self._assessor.is_alive():
            self._assessor.join(timeout=2.0)
        self._journal.close()

    @property
    def roles(self) -> dict[str, PointRole]:
        """Return the role of every point: of the project, then of those that were added."""
        given = self.block.control_points
        surveyed = np.asarray(np.isfinite(given.position_world_m).all(axis=1))
        roles: dict[str, PointRole] = {
            name: given.role[g] if surveyed[g] else "tie" for g, name in enumerate(given.name)
        }
        chosen = dict(self._state.roles)
        for name in roles:
            if chosen.get(name) == self._overruled.get(name):
                chosen.pop(name, None)
        for name, point in self._state.points.items():
            roles[name] = "tie" if point.position is None else roles.get(name, "control")
        return {name: chosen.get(name, role) for name, role in roles.items()}

    def snapshot(self) -> Snapshot:
        """Return the session as it is now."""
        with self._changed:
            return Snapshot(
                self._version,
                self._state,
                self.roles,
                self._assessment,
                self._is_stale or self._is_computing,
                self._basis,
                max(self._state.undoable - self._floor, 0),
                self._open_proposals(),
                self._search.state,
            )

    def _open_proposals(self) -> dict[MarkKey, Proposal]:
        state = self._state
        return {
            place: proposal
            for place, proposal in self._proposals.items()
            if place not in state.marks and place not in state.not_visible
        }

    def wait(self, version: int, seconds: float) -> int:
        """Wait until there is another version than this one, at most so long, and return the newest."""
        with self._changed:
            self._changed.wait_for(lambda: self._version != version or self._ended, seconds)
            return self._version

    def wait_for_assessment(self) -> bool:
        """Wait until something has been computed; returns False where the session has ended before."""
        with self._changed:
            self._changed.wait_for(lambda: self._assessment is not None or self._ended)
            return self._assessment is not None

    # ---- what is done --------------------------------------------------------------------------------------------

    def mark(
        self,
        point: str,
        photograph: str,
        pixel: tuple[float, float],
        *,
        raw: bool = False,
        reach_px: float = 10.0,
    ) -> Mark:
        """Mark a point where somebody clicked, at the place that the click means, which lies at most ``reach_px`` from
        it, unless ``raw``. Raises ControlPointError where there is no such point or photograph, or the pixel lies
        outside of it."""
        number = self._check(point, photograph)
        if not self._contains(number, pixel):
            raise ControlPointError(
                f"({pixel[0]:.1f}, {pixel[1]:.1f}) px lies outside of {photograph}: click within the photograph"
            )
        mark = Mark(point, photograph, pixel, (RAW_SIGMA_PX, RAW_SIGMA_PX), kind=RAW, time=utc_now(), raw_pixel=pixel)
        target = None if raw or self._snap is None else self._snap(self._click(point, number, pixel, reach_px))
        if target is not None and self._contains(number, target.pixel):
            mark = measured_mark(mark, target)
        self._do(PlaceMarks((mark,)))
        return mark

    def _contains(self, photograph: int, pixel: tuple[float, float]) -> bool:
        camera = self.block.cameras[self.block.photographs[photograph].camera]
        return bool(np.all(camera.contains(np.array([pixel]))))

    def _click(self, point: str, photograph: int, pixel: tuple[float, float], reach_px: float) -> Click:
        with self._changed:
            state = self._state
            assessment = self._assessment
            known = self._known
        others = tuple(
            OtherMark(self.numbers[m.photograph], m.pixel, isotropic_px(m))
            for m in state.marks.values()
            if m.point == point
            and m.photograph in self.numbers
            and not m.is_doubtful
            and not (assessment is not None and m.key in assessment.compared and assessment.compared[m.key].rejected)
        )
        position = np.full(3, np.nan) if assessment is None else assessment.position_of(point)
        return Click(known, photograph, pixel, reach_px, others, position)

    def remove(self, point: str, photograph: str) -> None:
        """Remove a mark. Raises ControlPointError as ``mark``."""
        self._check(point, photograph)
        self._do(RemoveMarks(((point, photograph),)))

    def set_visible(self, point: str, photograph: str, is_visible: bool) -> None:
        """Say that a photograph does not show a point, or that it does. Raises ControlPointError as ``mark``."""
        self._check(point, photograph)
        self._do(SetNotVisible(point, photograph, is_visible))

    def set_doubtful(self, point: str, photograph: str, is_doubtful: bool) -> None:
        """Say that a mark should be looked at again, or need not. Raises ControlPointError as ``mark``, and where there
        is no mark."""
        self._check(point, photograph)
        mark = self._state.marks.get((point, photograph))
        if mark is None:
            raise ControlPointError(
                Said(
                    "{point} has no mark in {photograph} that could be doubtful: mark it first",
                    point=point,
                    photograph=photograph,
                )
            )
        self._do(PlaceMarks((replace(mark, is_doubtful=is_doubtful),)))

    def set_role(self, point: str, role: PointRole) -> None:
        """Give a point a role. Raises ControlPointError where there is no such point, or it has no coordinates."""
        self._check(point)
        if role != "tie" and not self._is_surveyed(point):
            raise ControlPointError(
                Said("{name} has no coordinates, so it can only be a tie point: give coordinates", name=point)
            )
        self._do(SetRole(point, role))

    def add_point(self, point: SurveyedPoint) -> None:
        """Add a point, with coordinates in the map of the survey or without. Raises ControlPointError where there is
        one of its name, or coordinates lack standard deviations, FrameError where they lie outside of the map."""
        if point.name in self.roles:
            raise ControlPointError(Said("there is a point {name} already: choose another name", name=repr(point.name)))
        if point.position is not None:
            if None in point.sigma_m:
                raise ControlPointError(Said("{name}: give standard deviations with the coordinates", name=point.name))
            self.block.frame.world_from_map(self.block.frame.map_from_unit(np.array([point.position])))
        self._do(AddPoint(point))

    def undo(self) -> None:
        """Undo the last step of marking; the marks that the project gave stay."""
        if self.snapshot().undoable:
            self._do(Undo())

    def redo(self) -> None:
        """Do again what was undone last."""
        if self._state.redoable:
            self._do(Redo())

    # ---- proposals -----------------------------------------------------------------------------------------------

    def search(self) -> None:
        """Look for targets in the background. Raises ControlPointError where a search is under way, or nothing can
        look."""
        if self._propose is None:
            raise ControlPointError(Said("targets cannot be looked for here: mark the points"))
        if not self._search.begin(lambda progress: str(self.look(progress))):
            raise ControlPointError(Said("targets are being looked for already: wait until that has ended"))

    def look(self, progress: Progress) -> SearchResult:
        """Look for targets where points may be, keep them as proposals, and return what was found. Raises
        AdjustmentError where nothing says where points may be, ImageError where a photograph cannot be read."""
        if self._propose is None:
            return SearchResult((), 0)
        with self._changed:
            state = self._state
            known = self._known
            roles = self.roles
        block = marked_block(known, state, roles, self.numbers)
        found = self._propose(block, state.not_visible, progress)
        self.set_proposals(found.proposals)
        return found

    def set_proposals(self, proposals: Iterable[Proposal]) -> None:
        """Keep proposals, in place of those before, in a file of their own."""
        kept = tuple(proposals)
        write_proposals(self.proposed_in, kept)
        with self._changed:
            self._proposals = {proposal.mark.key: proposal for proposal in kept}
            self._is_stale = True
            self._notify()

    def confirm(self, point: str, photograph: str) -> None:
        """Make a proposal a mark. Raises ControlPointError as ``mark``, and where nothing is proposed."""
        self._check(point, photograph)
        proposal = self.snapshot().proposals.get((point, photograph))
        if proposal is None:
            raise ControlPointError(
                Said("nothing is proposed for {point} in {photograph}: mark it", point=point, photograph=photograph)
            )
        self._do(ConfirmProposals((proposal,)))

    def confirm_agreeing(self) -> int:
        """Make those proposals marks that agree with the rest, in one step; returns how many others are left."""
        snapshot = self.snapshot()
        confirmed = tuple(snapshot.proposals[place] for place in sorted(agreeing(snapshot)))
        if confirmed:
            self._do(ConfirmProposals(confirmed))
        return len(snapshot.proposals) - len(confirmed)

    def _notify(self) -> None:
        with self._changed:
            self._version += 1
            self._changed.notify_all()

    def _is_surveyed(self, point: str) -> bool:
        own = self._state.points.get(point)
        if own is not None:
            return own.position is not None
        given = self.block.control_points
        return bool(np.isfinite(given.position_world_m[given.name.index(point)]).all())

    def _check(self, point: str, photograph: str | None = None) -> int:
        if point not in self.roles:
            raise ControlPointError(Said("there is no point {name}: reload the page", name=repr(point)))
        if photograph is None:
            return -1
        if photograph not in self.numbers:
            raise ControlPointError(f"there is no photograph {photograph!r}: reload the page")
        return self.numbers[photograph]

    def _do(self, action: Action) -> None:
        if self._table is None:
            raise ControlPointError("this session only looks for targets: mark on the page of photogram mark")
        with self._acting:
            before, overruled = self.roles, dict(self._overruled)
            if isinstance(action, SetRole):
                self._overruled.pop(action.point, None)
            self._take(action)
            try:
                self._write_roles(before)
            except PhotogramError:
                self._overruled = overruled
                self._take(Redo() if isinstance(action, Undo) else Undo())
                raise

    def _take(self, action: Action) -> None:
        self._journal.append(action)
        self._actions.append(action)
        state = self._journal.state
        with self._changed:
            self._state, self._is_stale = state, True
            self._notify()
        self._write()

    def _write_roles(self, before: Mapping[str, PointRole]) -> None:
        names, now = self.block.control_points.name, self.roles
        changed = {n: role for n in names if (role := now[n]) != "tie" and role != before[n]}
        if changed and self._keep_roles is not None:
            self._keep_roles(changed)

    def _write(self) -> None:
        if self._table is not None:
            write_marks(self._table, table_of(self._state.marks, self._actions))

    # ---- what follows --------------------------------------------------------------------------------------------

    def _assess_always(self) -> None:
        self._assess()
        if not self._ended:
            self.ask_for_better()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_stale or self._ended)
                if self._ended:
                    return
            self._assess()

    def _note_basis(self, basis: str, block: Block) -> None:
        with self._changed:
            self._basis = basis
            self._known = block
            self._is_stale = True
            self._notify()

    def _assess(self) -> None:
        with self._changed:
            state = self._state
            known = self._known
            roles = self.roles
            proposals = self._open_proposals()
            self._is_stale, self._is_computing = False, True

        def assessment_of(off_target: Mapping[MarkKey, Snapped]) -> Assessment:
            assessment = assessed(known, state, roles, self.numbers, off_target)
            if not proposals:
                return assessment
            agreeing = agreeing_proposals(known, state, roles, self.numbers, proposals, off_target)
            return replace(assessment, agreeing=agreeing)

        known_off_target = self._known_off_target(state)
        assessment = assessment_of(known_off_target)
        self._publish(assessment, is_computing=True)
        off_target = self._off_target(state)
        self._publish(assessment if off_target == known_off_target else assessment_of(off_target), is_computing=False)

    def _publish(self, assessment: Assessment, is_computing: bool) -> None:
        with self._changed:
            self._assessment, self._is_computing = assessment, is_computing
            self._notify()

    def _off_target(self, state: MarkState) -> dict[MarkKey, Snapped]:
        """Return the targets that clicks taken as they are have missed; each is looked at once."""
        own = [m for m in state.marks.values() if m.kind == RAW and m.photograph in self.numbers]
        self._meant = {mark: self._meant[mark] if mark in self._meant else self._measured(mark) for mark in own}
        return self._known_off_target(state)

    def _known_off_target(self, state: MarkState) -> dict[MarkKey, Snapped]:
        """Return the targets that clicks have missed, as far as they have been looked at."""
        looked = ((mark, self._meant.get(mark)) for mark in state.marks.values())
        return {mark.key: there for mark, there in looked if there is not None and is_off_target(mark, there)}

    def _measured(self, mark: Mark) -> Snapped | None:
        if self._snap is None:
            return None
        try:
            return self._snap(self._click(mark.point, self.numbers[mark.photograph], mark.pixel, OFF_TARGET_PX))
        except ImageError:
            return None  # who looks at the photograph gets the error


def agreeing(snapshot: Snapshot) -> frozenset[MarkKey]:
    """Return the open proposals that agree with the marks and with each other, by what was computed last."""
    return frozenset() if snapshot.assessment is None else snapshot.assessment.agreeing & snapshot.proposals.keys()


def measured_mark(click: Mark, target: Snapped) -> Mark:
    """Return the mark of a click at the place that it means."""
    sigma = np.sqrt(np.diag(target.covariance_px2))
    return replace(
        click,
        pixel=target.pixel,
        sigma_px=(float(sigma[0]), float(sigma[1])),
        kind=target.kind,
        rho=float(target.covariance_px2[0, 1] / (sigma[0] * sigma[1])),
    )
