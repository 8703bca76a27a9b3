"""Kills of `photogram mark`: every mark that was answered is there afterwards, at its pixel, and no file is half.

    PYTHONPATH=benchmarks python tests/chaos/marking_interruptions.py [RUNS] [--seed 1]       default: 50

The command works on a small survey of 12 points in 4 photographs. Two tabs mark, move and remove marks as fast as they
are answered, each at places of its own, until the process is killed (SIGKILL) at random, up to 0.6 s after the first
mark was sent; every tenth run it is killed while it starts, before it gives an address. After every third kill part of
a page is appended to the log besides, as a failing power supply leaves it: a kill alone tears no single write.
The files are then read as they are, the command is started again on them, and its last step is undone and done again.

    starting   kills while the command started
    torn       logs that ended in part of a page
    answered   actions that the server said were done, and that are looked for afterwards
    lost       of these, those that the journal or, after the next start, marks.csv has not, or at another pixel
    half       times that marks.csv or the journal could not be read completely
    behind     times that marks.csv, as the kill left it, was more than one action behind the journal
    left over  files that are neither photogram's nor the user's after the next start
    undo       times that undoing the last step, or doing it again, gave other marks than before it
"""

import argparse
import http.client
import random
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from lib.marking_command import MarkCommand, Page, photogram, running

from photogram.errors import PhotogramError
from photogram.files.marks.mark_table import read_marks
from photogram.files.tables.surveyed_points import Mark, MarkKey
from photogram.marking.files.actions import Action, PlaceMarks, RemoveMarks, state_of
from photogram.marking.files.journal import read_journal
from photogram.simulation.simulated_survey import SimulatedSurvey, render_photographs, simulate
from photogram.simulation.survey_files import write_survey
from photogram.simulation.survey_plan import SurveyPlan

PLAN = SurveyPlan(
    width_px=400, height_px=300, focal_px=600.0, calibration_source="exif", flying_height_m=40.0,
    forward_overlap=0.75, side_overlap=0.7, strips=2, photographs_per_strip=2, relief_m=4.0, buildings=2,
    trees=6, target_radius_m=0.3, control_points=8, check_points=4,
)  # fmt: skip
SURVEY, TABS = 3, 2
LONGEST_S = 0.6
REMOVED_SHARE = 0.15
RAW_SHARE = 0.9
KILLED_STARTING_EVERY, TORN_EVERY = 10, 3
OWN = {"photographs", "points.csv", "truth.json", "project.yaml", "marks.csv", "work", "results", "log.txt"}
OWN_MARKING = {"journal.sqlite", "journal.sqlite-wal", "journal.sqlite-shm", "journal.lock", "proposals.csv"}
FRAME_BYTES = 24 + 4096
"""Length of a page in the journal's log, with its header."""


@dataclass(frozen=True)
class Sent:
    """A mark as a tab sent it; one that is not raw may be moved to a target, and keeps the click."""

    pixel: tuple[float, float]
    raw: bool

    def is_kept(self, mark: Mark | None) -> bool:
        """Return whether a mark is this one."""
        return mark is not None and mark.raw_pixel == self.pixel and (not self.raw or mark.pixel == self.pixel)


@dataclass
class Tab:
    """What one tab did: what was answered last of each place, None for a removal, and what was not answered."""

    places: list[MarkKey]
    answered: dict[MarkKey, Sent | None] = field(default_factory=dict)
    unanswered: tuple[MarkKey, Sent | None] | None = None
    actions: int = 0
    fault: str = ""

    def act(self, port: int, token: str, rng: random.Random, first: threading.Event) -> None:
        """Mark, move and remove until the server is gone."""
        page = Page(port, token)
        try:
            while True:
                place = rng.choice(self.places)
                names = {"point": place[0], "photograph": place[1]}
                sent = None
                if self.answered.get(place) is None or rng.random() > REMOVED_SHARE:
                    pixel = rng.uniform(0.0, PLAN.width_px - 1.0), rng.uniform(0.0, PLAN.height_px - 1.0)
                    sent = Sent(pixel, rng.random() < RAW_SHARE)
                self.unanswered = (place, sent)
                first.set()
                if sent is None:
                    page.act({"do": "remove", **names})
                else:
                    page.act({"do": "mark", **names, "u": sent.pixel[0], "v": sent.pixel[1], "raw": sent.raw})
                self.answered[place], self.unanswered = sent, None
                self.actions += 1
        except (OSError, http.client.HTTPException):
            return  # killed
        except SystemExit as refusal:
            self.fault = str(refusal)
        finally:
            page.close()

    def lost(self, marks: dict[MarkKey, Mark]) -> int:
        """Return how many of the answered actions marks do not show; what was not answered may be done or not."""
        missing = 0
        for place, sent in self.answered.items():
            found = marks.get(place)
            may_be = [sent] if self.unanswered is None or self.unanswered[0] != place else [sent, self.unanswered[1]]
            missing += not any(found is None if one is None else one.is_kept(found) for one in may_be)
        return missing

    def settle(self, marks: dict[MarkKey, Mark]) -> None:
        """Take what became of the unanswered action as it is."""
        if self.unanswered is None:
            return
        place, sent = self.unanswered
        done = place not in marks if sent is None else sent.is_kept(marks.get(place))
        if done:
            self.answered[place] = sent
        self.unanswered = None


@dataclass
class Sums:
    """What happened, over all runs."""

    answered: int = 0
    kills: int = 0
    starting: int = 0
    lost: int = 0
    half: int = 0
    behind: int = 0
    torn: int = 0
    left_over: int = 0
    undo: int = 0

    @property
    def is_held(self) -> bool:
        """Whether nothing went wrong."""
        return not (self.lost or self.half or self.behind or self.left_over or self.undo)


def written_survey(folder: Path) -> tuple[Path, SimulatedSurvey]:
    """Write the survey without marks, and its project as photogram init drafts it."""
    survey = simulate(PLAN, SURVEY)
    write_survey(folder, survey, render_photographs(survey))
    for made in ("marks.csv", "control.txt", "check.txt"):
        (folder / made).unlink()
    command: list[str | Path] = [photogram(), "init", folder / "photographs", "--control", folder / "points.csv"]
    options: list[str | Path] = ["--crs", survey.frame.crs, "--heights", "ellipsoidal"]
    project = folder / "project.yaml"
    subprocess.run([*command, *options, "--project", project], check=True, stdout=subprocess.DEVNULL)
    return project, survey


def steps_of(actions: tuple[Action, ...]) -> tuple[dict[MarkKey, Mark], dict[MarkKey, Mark]]:
    """Return the marks after all steps of a journal and before the last of them; undoing and doing again, which come in
    pairs here, change nothing."""
    marks: dict[MarkKey, Mark] = {}
    before: dict[MarkKey, Mark] = {}
    for action in actions:
        if isinstance(action, PlaceMarks):
            before = dict(marks)
            marks.update({mark.key: mark for mark in action.marks})
        elif isinstance(action, RemoveMarks):
            before = dict(marks)
            for place in action.keys:
                marks.pop(place, None)
    return marks, before


def table_of(path: Path) -> dict[MarkKey, Mark] | None:
    """Return the marks of a table, None where it is not whole."""
    try:
        return {mark.key: mark for mark in read_marks(path)}
    except PhotogramError as fault:
        print(f"{path.name}: {fault}", flush=True)
        return None


class Runs:
    """Runs that are killed, on one survey, each going on with what the one before has left."""

    def __init__(self, project: Path, places: list[MarkKey], seed: int) -> None:
        self._project, self._sums, self._rng = project, Sums(), random.Random(seed)
        self._tabs = [Tab(places[i::TABS]) for i in range(TABS)]
        self._marks, self._journal = project.with_name("marks.csv"), project.parent / "work/marking/journal.sqlite"
        self._strays = set[Path]()
        self._start_s, self._threads = 3.0, list[threading.Thread]()

    def run(self, count: int) -> Sums:
        """Run, kill and check so often, and once more start and check."""
        log = self._project.with_name("log.txt")
        for number in range(count):
            with running(self._project, log) as command:
                if number % KILLED_STARTING_EVERY == KILLED_STARTING_EVERY - 1:
                    time.sleep(self._rng.uniform(0.3, 1.0) * self._start_s)
                    self._sums.starting += 1
                else:
                    self._begin_marking(command)
            self._sums.kills += 1
            for thread in self._threads:
                thread.join()
            self._threads = []
            self._check_as_left(number)
        with running(self._project, log) as command:
            self._start_and_check(command)
        self._sums.answered = sum(tab.actions for tab in self._tabs)
        faults = [tab.fault for tab in self._tabs if tab.fault]
        if faults:
            raise SystemExit(f"refused: {faults[0]}")
        return self._sums

    def _begin_marking(self, command: MarkCommand) -> None:
        """Begin to mark in all tabs, and return at the snapshot of the kill."""
        port, token = self._start_and_check(command)
        first = threading.Event()
        self._threads = [
            threading.Thread(target=tab.act, args=(port, token, random.Random(self._rng.random()), first))
            for tab in self._tabs
        ]
        wait_s = self._rng.uniform(0.0, LONGEST_S)
        for thread in self._threads:
            thread.start()
        first.wait()
        time.sleep(wait_s)

    def _start_and_check(self, command: MarkCommand) -> tuple[int, str]:
        """Wait for the page, and check what the session before has left to it."""
        port, token, self._start_s = command.address()
        actions = self._actions()
        if actions is None:
            return port, token
        marks, before = steps_of(actions)
        self._compare("marks.csv after the start", self._table(), marks)
        folder, own = self._project.parent, self._journal.parent
        strays = {p for p in folder.iterdir() if p.name not in OWN}
        strays |= {p for p in own.iterdir() if p.name not in OWN_MARKING} | set(folder.rglob("*.partial*"))
        for path in sorted(strays - self._strays):
            print(f"left over: {path.relative_to(folder)}", flush=True)
        self._strays |= strays
        self._sums.left_over = len(self._strays)
        if marks != before:
            page = Page(port, token)
            page.act({"do": "undo"})
            undone = self._table()
            page.act({"do": "redo"})
            redone = self._table()
            page.close()
            if undone != before or redone != marks:
                print("undo: other marks than before the last step, or after doing it again", flush=True)
                self._sums.undo += 1
        return port, token

    def _check_as_left(self, number: int) -> None:
        """Check the files as the kill has left them, and tear the journal now and then."""
        if not self._journal.exists():
            return
        actions = self._actions()
        if actions is None:
            return
        marks = dict(state_of(actions).marks)
        for tab in self._tabs:
            lost = tab.lost(marks)
            if lost:
                print(f"run {number + 1}: {lost} lost from the journal", flush=True)
                self._sums.lost += lost
            tab.settle(marks)
        table = self._table()
        if table is not None and table not in (marks, dict(state_of(actions[:-1]).marks)):
            print(f"run {number + 1}: marks.csv is behind", flush=True)
            self._sums.behind += 1
        if number % TORN_EVERY == 0:
            log = self._journal.with_name(f"{self._journal.name}-wal")
            last = log.read_bytes()[-FRAME_BYTES:] if log.exists() else b""
            with log.open("ab") as stream:
                stream.write(last[: self._rng.randrange(1, FRAME_BYTES)])
            self._sums.torn += 1

    def _compare(self, what: str, table: dict[MarkKey, Mark] | None, marks: dict[MarkKey, Mark]) -> None:
        if table is None:
            return
        lost = sum(tab.lost(table) for tab in self._tabs)
        if lost or table != marks:
            print(f"{what}: {lost} lost, {len(table)} marks where the journal has {len(marks)}", flush=True)
        self._sums.lost += lost or table != marks

    def _table(self) -> dict[MarkKey, Mark] | None:
        if not self._marks.exists():
            return {}
        table = table_of(self._marks)
        self._sums.half += table is None
        return table

    def _actions(self) -> tuple[Action, ...] | None:
        try:
            return read_journal(self._journal)
        except PhotogramError as fault:
            print(f"journal: {fault}", flush=True)
            self._sums.half += 1
            return None


def main() -> None:
    """Print a line for each fault, and the sums."""
    parser = argparse.ArgumentParser()
    parser.add_argument("runs", type=int, nargs="?", default=50)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        project, survey = written_survey(Path(folder))
        names = [photograph.name for photograph in survey.photographs]
        places = [(point, name) for point in survey.control_points.name for name in names]
        began_s = time.monotonic()
        sums = Runs(project, places, given.seed).run(given.runs)
        seconds = time.monotonic() - began_s
    print("kills  starting  answered  lost  half  behind  torn  left over  undo  seconds")
    print(
        f"{sums.kills:5}  {sums.starting:8}  {sums.answered:8}  {sums.lost:4}  {sums.half:4}  {sums.behind:6}  "
        f"{sums.torn:4}  {sums.left_over:9}  {sums.undo:4}  {seconds:7.0f}"
    )
    print(f"{'held' if sums.is_held else 'not held'}: nothing that was answered is lost, no file is half or left over")
    sys.exit(not sums.is_held)


if __name__ == "__main__":
    main()
