"""A survey opened for a notebook: brought up to date, and what its stages have written read back as the survey's own
types."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from photogram.arrays import ByteArray
from photogram.errors import ProjectError, WorkspaceError
from photogram.files.atomic import make_folder
from photogram.geodesy.crs import crs_label
from photogram.pipeline.pipeline import is_up_to_date, load_project, open_run, run_pipeline
from photogram.pipeline.stage import Stage, Watcher
from photogram.pipeline.stage_names import STAGE_NAMES, StageName
from photogram.pipeline.stages.comparison import stored_comparisons
from photogram.pipeline.stages.features import stored_features
from photogram.pipeline.stages.orientation import stored_orientation, transferred_tie_points
from photogram.pipeline.stages.publishing.report_files import NUMBERS
from photogram.pipeline.stages.stored_adjustment import CLOUDS, stored_adjustment, stored_cloud
from photogram.pipeline.stages.stored_surface import StoredSurface
from photogram.pipeline.store.run import Run
from photogram.pipeline.store.stage_summary import Summary
from photogram.project.project import Project
from photogram.quality.cloud_comparison import Comparison
from photogram.report.reading import read_report
from photogram.report.record.report import Report
from photogram.result_files import result_path
from photogram.results import Adjustment
from photogram.sfm.orientation import Orientation
from photogram.survey import Block, Features, PointCloud, Raster, TiePoints
from photogram.wording import html_table, text_table, things

ResultT = TypeVar("ResultT")


@dataclass(frozen=True)
class _Lines(Watcher):
    """A watcher that says a line for every stage that is done, and for every warning."""

    say: Callable[[str], None]

    def end(self, stage: Stage, seconds: float | None, summary: Summary) -> None:  # noqa: ARG002
        """End a stage."""
        self.say(f"{stage.title}: {'up to date' if seconds is None else f'{seconds:.1f} s'}")

    def warn(self, text: str) -> None:
        """Say what is doubtful."""
        self.say(f"Warning: {text}")


@dataclass(frozen=True, eq=False)
class OpenedSurvey:
    """A survey on disk: its ``project``, as the file said it when the survey was opened, and what its stages have made
    of it.

    ``update`` runs the stages; the other methods read what they have written, in the world frame of the block (m, east,
    north, up) or in the map grid of the project (m, easting, northing, height) as the names of the fields say. All of
    them raise WorkspaceError while another photogram works on the survey, and where a stage has not been run with the
    present project file and photographs: nothing out of date is returned.
    """

    project: Project
    _current: set[StageName] = field(default_factory=set, init=False, repr=False)

    def update(
        self,
        *,
        start: StageName | None = None,
        until: StageName | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> OpenedSurvey:
        """Do what is not done yet, as `photogram adjust` does; returns the survey itself.

        ``until`` is the last stage to be done, ``start`` a stage that is repeated with all after it (the names are in
        STAGE_NAMES of photogram.pipeline.stage_names). ``progress``, ``print`` for example, is told a line for every
        stage that is done and for every warning. Raises a PhotogramError that says what can be mended.
        """
        watcher = None if progress is None else _Lines(progress)
        self._current.clear()  # a run that fails may have made early stages anew
        run_pipeline(self.project, watcher=watcher, start=start, until=until)
        last = len(STAGE_NAMES) if until is None else STAGE_NAMES.index(until) + 1
        self._current.update(STAGE_NAMES[:last])  # type: ignore[arg-type]
        return self

    def block(self) -> Block:
        """Return the block as it was measured: no poses, no tie points. Needs the stage `photographs`."""
        return self._read("photographs", Run.block)

    def features(self, photograph: str) -> Features:
        """Return the key points of the photograph of a name. Needs the stage `features`. Raises ProjectError where
        there is no such photograph."""
        number = self._number(photograph)
        return self._read("features", lambda run: stored_features(run, number))

    def pixels(self, photograph: str) -> ByteArray:
        """Return the photograph of a name as red, green, blue (height_px, width_px, 3). Raises ProjectError where there
        is no such photograph, ImageError where its file cannot be read."""
        number = self._number(photograph)
        with open_run(self.project) as run:
            return run.pixels(number)

    def tie_points(self) -> TiePoints:
        """Return the tie points of the whole block, without positions. Needs the stage `transfer`."""
        return self._read("transfer", transferred_tie_points)

    def orientation(self) -> Orientation:
        """Return the starting poses and the resections. Needs the stage `orientation`."""
        return self._read("orientation", stored_orientation)

    def adjustment(self) -> Adjustment:
        """Return the joint adjustment: estimates, residuals, covariances. Needs the stage `adjustment`."""
        return self._read("adjustment", stored_adjustment)

    def cloud(self, name: str) -> PointCloud:
        """Return a cloud of tie points: ``adjusted`` (needs the stage `adjustment`), or intersected linearly from the
        starting poses, ``linear_2view`` or ``linear_3view`` (need the stage `intersection`). Raises ProjectError for
        another name."""
        if name not in CLOUDS:
            raise ProjectError(f"there is no cloud {name!r}; the clouds are {', '.join(sorted(CLOUDS))}")
        return self._read(CLOUDS[name], lambda run: stored_cloud(run, name))

    def surface(self) -> Raster:
        """Return the DSM, heights in m, NaN in its holes. Needs the stage `surface`."""
        return self._read("surface", lambda run: StoredSurface(run).heights())

    def surface_sigma(self) -> Raster:
        """Return the predicted standard deviations of the DSM in m, cell by cell. Needs the stage `surface`."""
        return self._read("surface", lambda run: StoredSurface(run).sigma())

    def comparisons(self) -> dict[str, Comparison]:
        """Return the comparison of every cloud with the project's reference, none without one. Needs the stage
        `comparison`."""
        return self._read("comparison", stored_comparisons)

    def report(self) -> Report:
        """Return every figure of the report, as report.json holds it (docs/report.md explains each). Needs the stage
        `results`."""
        return self._read("results", lambda run: read_report(result_path(run.project.results, NUMBERS)))

    def _number(self, photograph: str) -> int:
        names = [p.name for p in self.project.photographs]
        if photograph not in names:
            raise ProjectError(
                f"there is no photograph {photograph!r} in {self.project.path}; the first is {names[0]!r}"
            )
        return names.index(photograph)

    def _read(self, stage: StageName, read: Callable[[Run], ResultT]) -> ResultT:
        with open_run(self.project) as run:
            if stage not in self._current:
                if not is_up_to_date(run, stage):
                    raise WorkspaceError(
                        f"{self.project.path}: the stage {stage} has not been run with this project file and these "
                        f'photographs: call update(until="{stage}")'
                    )
                self._current.add(stage)
            return read(run)

    def _facts(self) -> list[tuple[str, str]]:
        project = self.project
        control = sum(point.role == "control" for point in project.control_points)
        checks = len(project.control_points) - control
        return [
            ("photographs", str(len(project.photographs))),
            ("cameras", ", ".join(camera.name for camera in project.cameras)),
            ("map grid", crs_label(project.crs)),
            ("ground points", f"{things(control, 'control point')}, {things(checks, 'check point')}"),
            ("results", str(project.results)),
        ]

    def __repr__(self) -> str:
        return f"<OpenedSurvey {self.project.path}: {things(len(self.project.photographs), 'photograph')}>"

    def _repr_html_(self) -> str:
        return html_table(str(self.project.path), (), self._facts())

    def summary(self) -> str:
        """Return what the survey is made of as a table of text."""
        return text_table(self._facts())

    def plot(self) -> None:
        """Draw its adjustment from above in the current axes of matplotlib. Needs the stage `adjustment`."""
        self.adjustment().plot()

    def write(self, folder: Path | str) -> None:
        """Write the adjustment's table of exterior orientation (``photographs.csv``), its cloud of tie points
        (``tie_points.laz``) and the DSM (``dsm.tif``) into a folder. Needs the stage `surface`."""
        target, crs = Path(folder), self.project.crs
        make_folder(target)
        self.adjustment().write(target / "photographs.csv")
        self.cloud("adjusted").write(target / "tie_points.laz", crs)
        self.surface().write(target / "dsm.tif", crs)


def open_survey(project: Path | str, photographs: Path | str | None = None) -> OpenedSurvey:
    """Open a survey by its project file; nothing is run.

    ``photographs`` is the folder of the photographs in place of the file's own. Raises ProjectError with every error of
    the file at once.
    """
    return OpenedSurvey(load_project(Path(project), None if photographs is None else Path(photographs)))
