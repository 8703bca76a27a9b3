"""The process of a task, `python -m photogram.node.process FOLDER`: the project file is written, the survey worked out
as `photogram adjust --json` does it, and what is handed back is packed. It says events, as that command.

Whatever an earlier process has finished under the same settings is not done again.
"""

import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from photogram.background.runs import COMMAND
from photogram.errors import PhotogramError, ReportError, WorkspaceError
from photogram.node.assets import make_assets
from photogram.node.options import InitArguments, Lines, Options, init_arguments, is_on, project_lines, value_of
from photogram.node.received import is_check
from photogram.node.tasks import GROUPS, TABLES, Task, TaskFolder
from photogram.pipeline.input_validation import tags_of
from photogram.pipeline.new_project import NewProject, init
from photogram.pipeline.pipeline import load_project
from photogram.pipeline.stages.publishing.report_files import print_report
from photogram.project.draft.edits import write_values
from photogram.project.project import Project
from photogram.project.validation.resources import surface_size
from photogram.terminal.events import EventLines
from photogram.wording import some, things

INTERRUPTED, FAILED = 130, 1
_CELLS = {"orthophoto-resolution": ("orthophoto", "cell_m"), "dem-resolution": ("surface", "cell_m")}


def main() -> None:
    """Do the task of the folder that is named."""
    folder, lines = TaskFolder(Path(sys.argv[1])), EventLines()
    try:
        with lines.errors():
            code = _done(folder, folder.read(), lines)
    except KeyboardInterrupt:
        code = INTERRUPTED
    except (PhotogramError, OSError, MemoryError):  # said already; a defect leaves its traceback too
        code = FAILED
    sys.exit(code)


def _done(folder: TaskFolder, task: Task, lines: EventLines) -> int:
    """Do a task and return the exit code."""
    lines.say("begin", f"photogram works on {things(task.images, 'photograph')}")
    _say_draft(_drafted(folder, init_arguments(task.options)), lines)
    named: Lines = {("report", "name"): task.name}
    write_values(folder.project, {**_settings(folder, task.options, lines), **named}, load_project)
    if (folder.path / GROUPS).is_file():
        lines.say("warning", f"{GROUPS} is not used: all photographs are adjusted in one block")
    code = _adjusted(folder, task.options, lines)
    if code:
        return code
    make_assets(load_project(folder.project), folder, task, lambda text: lines.say("end", text))
    lines.say("done", "Finished")
    return 0


def _drafted(folder: TaskFolder, said: InitArguments) -> NewProject:
    """Write the project file anew, as the photographs and tables say it."""
    tables = sorted(path for path in (folder.path / TABLES).glob("*") if path.is_file())
    return init(
        folder.images,
        control=[path for path in tables if not is_check(path.name)],
        check=[path for path in tables if is_check(path.name)],
        crs=said.crs,
        heights=said.heights,
        geoid=said.geoid,
        focal_px=said.focal_px,
        project=folder.project,
        force=True,
    )


def _say_draft(made: NewProject, lines: EventLines) -> None:
    draft = made.draft
    lines.say("begin", f"Map grid: {draft.crs} ({draft.crs_name}), {draft.crs_reason}")
    for reason, names in draft.left_out_for.items():
        lines.say("warning", f"left out, {some(names)}: {reason}")
    for site in draft.other_sites:
        lines.say("warning", f"left out, {some(site.names)}: {site.distance_m / 1000:.1f} km away from the others")
    for text in (*draft.warnings, *map(str, made.warnings)):
        lines.say("warning", text)


def _settings(folder: TaskFolder, options: Options, lines: EventLines) -> Lines:
    """Return what the options write into the project file, with cells as fine as the photographs resolve at most."""
    wanted = project_lines(options)
    if is_on(options, "ignore-gsd") or not any(wanted[key] for key in _CELLS.values()):
        return wanted
    gsd_m = ground_sampling_m(load_project(folder.project))
    for name, key in _CELLS.items():
        cell_m = wanted[key]
        if gsd_m is not None and isinstance(cell_m, float) and cell_m < gsd_m:
            wanted[key] = float(f"{gsd_m:.2g}")
            lines.say(
                "warning",
                f"{name}: {value_of(options, name):g} cm is finer than the photographs resolve, about "
                f"{100 * gsd_m:.2g} cm, which is used; ignore-gsd takes it as it is",
            )
    return wanted


def ground_sampling_m(project: Project) -> float | None:
    """Return the ground sampling distance that the tags of a project's photographs tell, None where they do not."""
    as_resolved = replace(project, surface=replace(project.surface, cell_m=None))
    size = surface_size(as_resolved, tags_of(as_resolved))
    return None if size.cell_m is None else size.cell_m / size.cell_gsd


def _adjusted(folder: TaskFolder, options: Options, lines: EventLines) -> int:
    """Work the survey out by the command, which says its own events, and return its exit code; of an interruption it is
    that of one. The report is printed where that can be."""
    code = _called(["adjust", str(folder.project), "--json"])
    if code == 0 and not is_on(options, "skip-report"):
        try:
            print_report(load_project(folder.project))
        except ReportError as error:
            lines.say("warning", f"no report.pdf, report.html is there: {error}")
    return code


def _called(arguments: Sequence[str]) -> int:
    """Call a command of photogram and return its exit code. Raises WorkspaceError where the system ended it."""
    # an interruption reaches the command too, which ends in order; a handler, and not SIG_IGN, which it would inherit
    before = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        code = subprocess.call([sys.executable, "-m", COMMAND, *arguments], stdin=subprocess.DEVNULL)
    finally:
        signal.signal(signal.SIGINT, before)
    if code >= 0:
        return code
    if code == -signal.SIGINT:
        return INTERRUPTED
    raise WorkspaceError(
        f"the system ended the work ({signal.Signals(-code).name}; where memory ran out, use fewer photographs, larger "
        f"cells or feature-quality: high)"
    )


if __name__ == "__main__":
    main()
