"""The epochs of a survey, from one adjustment of all photographs to a surface of each and to their differences."""

import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from photogram.arrays import BoolArray
from photogram.change.epochs.difference_errors import difference_errors
from photogram.change.files.change_files import SurfaceChange
from photogram.change.surface_change import SurfaceRequest, compare_surfaces
from photogram.errors import ProjectError
from photogram.files.stage_folders import errors_of, remove_stage_folder
from photogram.pipeline.pipeline import open_run, run_pipeline
from photogram.pipeline.stage import Watcher
from photogram.pipeline.stages.adjustment import ADJUSTMENT
from photogram.pipeline.stages.order import BEFORE_RESULTS
from photogram.pipeline.stages.stored_adjustment import stored_adjustment
from photogram.pipeline.store.pools import Pool
from photogram.pipeline.store.workspace import Workspace
from photogram.project.project import Project
from photogram.volumes.joint_errors import JointErrors
from photogram.wording import Progress, silent

SHARED = BEFORE_RESULTS[: BEFORE_RESULTS.index(ADJUSTMENT) + 1]
"""The stages that all epochs have in common."""


@dataclass(frozen=True)
class Pair:
    """Two epochs that are compared, by their names."""

    earlier: str
    later: str


def pairs_of(survey: Project) -> list[Pair]:
    """Return each epoch with the one before, and the last with the first."""
    names = [epoch.name for epoch in survey.epochs]
    pairs = [Pair(*two) for two in pairwise(names)]
    return pairs + [Pair(names[0], names[-1])] * (len(names) > 2)


def _beside(folder: Path, name: str) -> Path:
    return folder.with_name(f"{folder.name}_{name}")


def survey_of(survey: Project, epoch: str) -> Project:
    """Return the project whose surface and orthophoto are those of one epoch, in folders of its own."""
    called = replace(survey.report, name=f"{survey.report.name} – {epoch}".removeprefix(" – "))
    return replace(
        survey, epoch=epoch, report=called, results=_beside(survey.results, epoch), work=_beside(survey.work, epoch)
    )


def output_of(survey: Project, pair: Pair) -> Path:
    """Return the folder of the difference of two epochs."""
    return _beside(survey.results, f"{pair.later}_minus_{pair.earlier}")


def _linked(source: str, target: str) -> None:
    """Give a file a second name, or copy it where the file system has none."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def share_stages(whole: Workspace, own: Workspace) -> None:
    """Give the workspace of an epoch the stages up to the adjustment, as they are of all photographs."""
    for stage in SHARED:
        mark = whole.mark(stage.name)
        if mark is None or own.mark(stage.name) == mark:
            continue
        own.discard(stage.name)
        partial, complete = own.partial(stage.name), own.stage(stage.name)
        with errors_of(partial):
            shutil.copytree(whole.stage(stage.name), partial, copy_function=_linked)
            remove_stage_folder(complete)
            os.replace(partial, complete)


def adjusted_epochs(survey: Project, watcher: Watcher, pool: Pool | None = None) -> Iterator[tuple[str, Project]]:
    """Adjust the photographs of all epochs together, then yield the name of each with its project, once its surface is
    made. Raises ProjectError where the project has no epochs."""
    if not survey.epochs:
        raise ProjectError(f"{survey.path}: epochs: none are given: name two or more, as the project file describes")
    run_pipeline(survey, watcher=watcher, pool=pool)
    for epoch in survey.epochs:
        own = survey_of(survey, epoch.name)
        with Workspace(own.work).locked():
            share_stages(Workspace(survey.work), Workspace(own.work))
        run_pipeline(own, watcher=watcher, pool=pool)
        yield epoch.name, own


def _of(survey: Project, epoch: str) -> BoolArray:
    """Return which photographs (N,) are of an epoch."""
    own = next(e.photographs for e in survey.epochs if e.name == epoch)
    return np.isin(np.arange(len(survey.photographs)), own)


def joint_errors(survey: Project, pairs: Sequence[Pair]) -> list[JointErrors]:
    """Return the errors of the differences of pairs of epochs. Needs the adjustment of all photographs."""
    with open_run(survey) as run:
        result = stored_adjustment(run)
    return [
        difference_errors(result, survey.adjustment, _of(survey, pair.earlier), _of(survey, pair.later))
        for pair in pairs
    ]


def compare_epochs(
    survey: Project, pair: Pair, errors: JointErrors, polygons: Path | None = None, progress: Progress = silent
) -> SurfaceChange:
    """Compare the surfaces of two epochs that were adjusted together, and write what ``compare_surfaces`` does."""
    later, earlier = (survey_of(survey, name).results for name in (pair.later, pair.earlier))
    return compare_surfaces(SurfaceRequest(later, earlier, polygons), output_of(survey, pair), progress, errors)
